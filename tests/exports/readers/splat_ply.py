"""Splat PLYs by the rules of the programs that open them. What each knows of PLY was read in its published source.

* Unity's importer (*UnityGaussianSplatting*, ``PLYFileReader``, ``GaussianFileReader``): lines are split at single spaces; only
  ``float``, ``double`` and ``uchar`` have a size, other types count no bytes; properties that it uses must be ``float``; harmonics
  lie in 45 places of which the first 15 are red's.
* PlayCanvas and SuperSplat (``ply.js``): the first line is ``ply`` and a line feed; after comments are taken out, a header has
  ``format``, ``element`` and ``property`` alone, of eight types by their old names; harmonics are as many as 0, 9, 24 or 45.
* The reference implementation of 3D Gaussian Splatting (``load_ply`` with its usual degree): 45 coefficients, red's first.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.plain_ply import read_plain_ply

__all__ = ["Splats", "read_as_playcanvas", "read_as_reference", "read_as_unity"]

USED = [
    "x",
    "y",
    "z",
    "f_dc_0",
    "f_dc_1",
    "f_dc_2",
    "opacity",
    *(f"scale_{k}" for k in range(3)),
    *(f"rot_{k}" for k in range(4)),
]
REST = [f"f_rest_{k}" for k in range(45)]
OF_UNITY = {"float": ("<f4", 4), "double": ("<f8", 8), "uchar": ("u1", 1)}
OF_PLAYCANVAS = {
    "char": "i1", "uchar": "u1", "short": "<i2", "ushort": "<u2", "int": "<i4", "uint": "<u4", "float": "<f4", "double": "<f8",
}  # fmt: skip


@dataclass
class Splats:
    """As many as a program found: values (N, 14) in the order of :data:`USED`, harmonics (N, 15, 3)."""

    used: np.ndarray
    sh: np.ndarray

    def of(self, name: str) -> np.ndarray:
        return self.used[:, USED.index(name)]


def read_as_unity(path: Path) -> Splats:
    """What Unity's importer makes of a file; a ValueError where it refuses it."""
    content = path.read_bytes()
    at, count, stride, places, little = 0, 0, 0, {}, False
    for _ in range(9000):
        end = content.index(b"\n", at)
        line, at = content[at:end].decode().removesuffix("\r"), end + 1
        if line in ("end_header", ""):
            break
        words = line.split(" ")
        little |= words == ["format", "binary_little_endian", "1.0"]
        if len(words) == 3 and words[:2] == ["element", "vertex"]:
            count = int(words[2])
        if len(words) == 3 and words[0] == "property":
            if words[1] == "float":
                places[words[2]] = stride
            stride += OF_UNITY.get(words[1], ("", 0))[1]
    missing = [name for name in USED if name not in places]
    if not little or missing:
        raise ValueError(f"refused: {missing or 'not little endian'}")
    rows = np.frombuffer(content, np.uint8, count * stride, at).reshape(count, stride)

    def take(names: list[str]) -> np.ndarray:
        found = np.zeros((count, len(names)), "<f4")
        for k, name in enumerate(names):
            if name in places:
                found[:, k] = rows[:, places[name] : places[name] + 4].copy().view("<f4")[:, 0]
        return found

    return Splats(take(USED), take(REST).reshape(count, 3, 15).transpose(0, 2, 1))


def read_as_playcanvas(path: Path) -> Splats:
    """What PlayCanvas and SuperSplat make of a file; a ValueError where they refuse it."""
    content = path.read_bytes()
    head, _, data = content.partition(b"\nend_header\n")
    lines = [line for line in head.decode("ascii").split("\n") if not line.startswith("comment ")]
    if lines[0] != "ply" or lines[1].split(" ")[1] != "binary_little_endian":
        raise ValueError("refused: not a binary PLY")
    counts, kinds = [], []
    for line in lines[2:]:
        words = line.split(" ")
        if words[0] == "element":
            counts.append(int(words[2]))
        elif words[0] == "property":
            kinds.append((words[2], OF_PLAYCANVAS[words[1]]))
        else:
            raise ValueError(f"refused: {words[0]}")
    (count,) = counts
    table = np.frombuffer(data, kinds, count)
    if count * table.dtype.itemsize != len(data):
        raise ValueError("refused: other bytes than the header says")
    bands = {0: 0, 9: 3, 24: 8, 45: 15}[sum(name.startswith("f_rest_") for name, _ in kinds)]
    sh = np.zeros((count, 15, 3), "<f4")
    for k in range(3 * bands):
        sh[:, k % bands, k // bands] = table[f"f_rest_{k}"]
    return Splats(np.stack([table[n].astype("<f4") for n in USED], axis=1), sh)


def read_as_reference(path: Path) -> Splats:
    """What the reference implementation's ``load_ply`` makes of a file with degree 3: its reader of PLY is a full one."""
    table = read_plain_ply(path)
    rest = sorted((n for n in table.dtype.names or () if n.startswith("f_rest_")), key=lambda n: int(n.split("_")[-1]))
    if len(rest) != 45:
        raise ValueError(f"refused: {len(rest)} coefficients")
    sh = np.stack([table[n] for n in rest], axis=1).reshape(len(table), 3, 15).transpose(0, 2, 1)
    return Splats(np.stack([table[n].astype("<f4") for n in USED], axis=1), sh)
