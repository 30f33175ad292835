"""What is fuzzed: a reader, the files that it reads, and what it may say of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from unveil_core.base.errors import UnveilError

__all__ = ["Opened", "Reader", "Wrong"]


class Wrong(Exception):
    """A reader took what it must not take, or said what no user can read."""


@dataclass(frozen=True)
class Opened:
    """A reader with sound files in a folder.

    Attributes:
        files: that are changed, one at a time.
        read: reads them all and checks what came of it; given the one that was changed.
    """

    files: tuple[Path, ...]
    read: Callable[[Path], object]


@dataclass(frozen=True)
class Reader:
    """One reader.

    Attributes:
        name: for tables and ``--reader``.
        kind: "text", "binary" or "drive" (a whole one, of many files).
        prepare: writes sound files into an empty folder.
        errors: that it may raise; line: what a user is shown of one.
        inputs: tried at most, by default: what takes long is tried less often.
    """

    name: str
    kind: str
    prepare: Callable[[Path], Opened]
    errors: tuple[type[Exception], ...] = (UnveilError,)
    line: Callable[[Exception], str] = str
    inputs: int | None = None
