"""Binary PLYs that begin with their vertices, as any full reader of PLY finds them: not by the code that wrote them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["comments_of", "read_plain_ply"]

KINDS = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8",
}  # fmt: skip


def read_plain_ply(path: Path) -> NDArray[np.void]:
    """Its vertices by name; an AssertionError where there is nothing else in it and its length is not what the header says."""
    head, _, data = path.read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in head.decode("ascii").splitlines()]
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}[lines[1][1]]
    elements = [k for k, words in enumerate(lines) if words[0] == "element"]
    own = lines[elements[0] : elements[1] if len(elements) > 1 else None]
    assert own[0][1] == "vertex"
    table = np.frombuffer(data, [(words[2], order + KINDS[words[1]]) for words in own[1:]], int(own[0][2]))
    assert len(elements) > 1 or table.nbytes == len(data)
    return table


def comments_of(path: Path) -> list[str]:
    """The comments of its header."""
    head = path.read_bytes().partition(b"end_header\n")[0].decode("ascii")
    return [line.removeprefix("comment ") for line in head.splitlines() if line.startswith("comment ")]
