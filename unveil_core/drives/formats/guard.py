"""What no reader of a drive foresaw becomes one line all the same, whenever it is read."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import cv2

from unveil_core.base.errors import DriveError
from unveil_core.drives.drive import Drive, Frame, Sweep

__all__ = ["guarded", "with_guarded_readers"]

T = TypeVar("T")
NOT_UNDERSTOOD = (
    ArithmeticError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,
    TypeError,
    ValueError,
    cv2.error,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
)
"""What comes of reading something that is not as it should be."""


@contextmanager
def guarded(path: Path, kind: str) -> Iterator[None]:
    """Errors of reading ``path`` of a drive of some kind become a DriveError. Readers name the file and the field where they can;
    this is for what they did not think of."""
    try:
        yield
    except NOT_UNDERSTOOD as error:
        problem = f"holds something that no drive of {kind} has: {type(error).__name__} {error}"
        raise DriveError(problem, path=path, mend="export or copy it again") from error


def with_guarded_readers(drive: Drive, kind: str) -> Drive:
    """The drive with a guard also around what is read later: labels, pictures inside other files, sweeps."""

    def frame(frame: Frame) -> Frame:
        labels, image = frame.labels, frame.image_bytes
        return replace(
            frame,
            labels=None if labels is None else _guarded(labels, frame.image_path, kind),
            image_bytes=None if image is None else _guarded(image, frame.image_path, kind),
        )

    def sweep(sweep: Sweep) -> Sweep:
        return replace(sweep, read=_guarded(sweep.read, sweep.path, kind))

    return replace(drive, frames=tuple(map(frame, drive.frames)), sweeps=tuple(map(sweep, drive.sweeps)))


def _guarded(read: Callable[[], T], path: Path, kind: str) -> Callable[[], T]:
    def read_guarded() -> T:
        with guarded(path, kind):
            return read()

    return read_guarded
