"""Binary PLYs of one element without lists, as any full reader of PLY finds them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["comments_of", "read_plain_ply"]

KINDS = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8",
}  # fmt: skip


def read_plain_ply(path: Path) -> NDArray[np.void]:
    """Its rows by name; an AssertionError where its length is not what the header says."""
    head, _, data = path.read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in head.decode().splitlines()]
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}[lines[1][1]]
    (count,) = (int(words[2]) for words in lines if words[0] == "element")
    kinds = [(words[2], order + KINDS[words[1]]) for words in lines if words[0] == "property"]
    table = np.frombuffer(data, kinds, count)
    assert table.nbytes == len(data)
    return table


def comments_of(path: Path) -> list[str]:
    """The comments of its header."""
    head = path.read_bytes().partition(b"end_header\n")[0].decode()
    return [line.removeprefix("comment ") for line in head.splitlines() if line.startswith("comment ")]
