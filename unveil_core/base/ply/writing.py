"""Writing vertices as a binary PLY with the least bytes first, whole or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.files import write_atomic

__all__ = ["write_vertices"]

NAMES = {
    "i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int", "u4": "uint", "f4": "float", "f8": "double",
}  # fmt: skip
"""The old names of kinds: some programs know no others."""
AT_ONCE = 1 << 24
"""Bytes that are handed to the system at once, so that a table is not copied as a whole."""


def write_vertices(path: Path, table: NDArray[np.void], comments: Sequence[str] = ()) -> None:
    """Write the rows of a table as vertices.

    Args:
        path: the file.
        table: (N,) structured, of numbers; its fields become the properties.
        comments: lines for the header; what is not ASCII becomes "?".
    """
    kinds = table.dtype
    lines = ["ply", "format binary_little_endian 1.0", *(f"comment {' '.join(line.split())}" for line in comments)]
    lines += [f"element vertex {len(table)}"]
    lines += [f"property {NAMES[kinds[name].str[1:]]} {name}" for name in kinds.names or ()]
    little = table.astype(kinds.newbyteorder("<"), copy=False)
    rows = np.ascontiguousarray(little).view(np.uint8) if len(table) else np.empty(0, np.uint8)

    def write(stream: BinaryIO) -> None:
        stream.write("\n".join((*lines, "end_header", "")).encode("ascii", errors="replace"))
        for first in range(0, len(rows), AT_ONCE):
            stream.write(rows[first : first + AT_ONCE].data)

    write_atomic(path, write)
