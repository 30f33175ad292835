"""TOML of others: a parser takes long for keys of many parts, and ends where lists lie too deep within one another."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from unveil_core.base.disk.open_safely import read_bytes

__all__ = ["read_toml"]

LARGEST = 1 << 20
"""Bytes: settings are a page."""
MOST_MARKS = 2000
"""Dots, and opening brackets: five hundred classes with a colour each."""


def read_toml(path: Path) -> dict[str, Any]:
    """What a file of TOML holds.

    Raises:
        OSError: it cannot be read, or is larger than any such file.
        ValueError: it is none, or has too many parts.
    """
    content = read_bytes(path, LARGEST)
    for mark, what in ((b".", "dots"), (b"[", "lists"), (b"{", "tables")):
        if content.count(mark) > MOST_MARKS:
            raise ValueError(f"it has more than {MOST_MARKS} {what}")
    try:
        return tomllib.loads(content.decode("utf-8"))
    except RecursionError:
        raise ValueError("it has too many lists or tables within one another") from None
