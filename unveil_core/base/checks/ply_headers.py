"""What the header of a PLY claims, before anything is taken from memory for it."""

from __future__ import annotations

import os
from dataclasses import dataclass
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
MOST_LISTS = 1 << 20
"""Rows with lists, as faces: each is read by itself, in 20 us, whether the lists hold something or not."""
BYTES = {
    b"char": 1, b"uchar": 1, b"int8": 1, b"uint8": 1, b"short": 2, b"ushort": 2, b"int16": 2, b"uint16": 2, b"int": 4, b"uint": 4,
    b"int32": 4, b"uint32": 4, b"float": 4, b"float32": 4, b"double": 8, b"float64": 8,
}  # fmt: skip
"""Of a number by its type, in binary files."""


@dataclass
class _Element:
    """Attributes: rows: that it claims; bytes_each: of a row at least; lists: whether rows hold lists."""

    rows: int
    bytes_each: int = 0
    lists: bool = False


def read_ply(path: Path, *, links: bool = False) -> PlyData:
    """A PLY whose header was looked at before anything was taken from memory for it.

    Args:
        links: whether a symbolic link is followed, see :func:`open_file`.
    Raises:
        Exception: one of :data:`UNREADABLE`: it cannot be read, tells more than the file can hold, or has more lists than can be
            read in half a minute.
    """
    with open_file(path, links=links) as stream:
        _check_counts(stream)
        stream.seek(0)
        return PlyData.read(stream)


def _check_counts(stream: BinaryIO) -> None:
    """Raise a ValueError where the header tells more than the file can hold, for room for it would be taken first; or too many
    lists."""
    size = os.fstat(stream.fileno()).st_size
    elements = _elements(stream, size)
    needed = sum(e.rows * max(e.bytes_each, 1) for e in elements)
    if needed > size:
        rows = max((e.rows for e in elements), default=0)
        raise ValueError(f"it says {rows:,} rows, which take {needed:,} bytes at least, in {size:,}")
    lists = sum(e.rows for e in elements if e.lists)
    if lists > MOST_LISTS:
        raise ValueError(
            f"it has {lists:,} faces or other lists, of which {MOST_LISTS:,} are read: save it without them"
        )


def _elements(stream: BinaryIO, size: int) -> list[_Element]:
    found: list[_Element] = []
    text = False
    for _ in range(MOST_LINES):
        words = stream.readline(MOST_LINE).split()
        if not words or words[0] == b"end_header":
            return found
        if words[:2] == [b"format", b"ascii"]:
            text = True
        elif words[0] == b"element" and len(words) > 2:
            rows = int(words[2][:20])
            # A row is a byte at least.
            if not 0 <= rows <= size:
                raise ValueError(f"it says {words[2][:20].decode()} rows in {size:,} bytes")
            found.append(_Element(rows))
        elif words[0] == b"property" and len(words) > 2 and found:
            found[-1].lists |= words[1] == b"list"
            kind = words[2] if words[1] == b"list" else words[1]
            found[-1].bytes_each += 1 if text else BYTES.get(kind, 1)
    raise ValueError("its header has no end")
