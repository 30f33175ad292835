"""What the header of a PLY claims, before anything is taken from memory for it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO

from plyfile import PlyData, PlyParseError

from unveil_core.base.disk.open_safely import open_file

__all__ = ["UNREADABLE", "read_ply"]

UNREADABLE = (
    PlyParseError,
    LookupError,
    TypeError,
    ValueError,
    ArithmeticError,
    MemoryError,
    EOFError,
    OSError,
    RuntimeError,
)
"""What comes of reading a file that is no PLY."""
MOST_LINES, MOST_LINE = 10_000, 65_536
"""Of a header."""


def read_ply(path: Path, *, links: bool = False) -> PlyData:
    """A PLY whose header was looked at before anything was taken from memory for it.

    Args:
        links: whether a symbolic link is followed, see :func:`open_file`.
    Raises:
        Exception: one of :data:`UNREADABLE`: it cannot be read, or tells more than the file can hold.
    """
    with open_file(path, links=links) as stream:
        _check_counts(stream)
        stream.seek(0)
        return PlyData.read(stream)


def _check_counts(stream: BinaryIO) -> None:
    """Raise a ValueError where the header tells more than the file can hold: room for it would be taken first."""
    size = os.fstat(stream.fileno()).st_size
    for _ in range(MOST_LINES):
        words = stream.readline(MOST_LINE).split()
        if not words or words[0] == b"end_header":
            return
        # A row is a byte at least.
        if words[0] == b"element" and len(words) > 2 and not 0 <= int(words[2][:20]) <= size:
            raise ValueError(f"it says {words[2][:20].decode()} rows in {size:,} bytes")
    raise ValueError("its header has no end")
