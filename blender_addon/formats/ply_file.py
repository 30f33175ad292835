# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading the PLY files of a workspace with nothing but numpy: points, meshes, surfels. No bpy here."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .open_safely import LARGEST_SCENE, open_file

__all__ = ["Ply", "read_ply"]

KINDS = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
MOST_LINES = 10_000
"""Of a header."""


@dataclass(frozen=True, eq=False)
class Ply:
    """What a file holds.

    Attributes:
        vertices: (V,) structured, fields by the file's names.
        triangles: (F, 3) int32, empty where it has no faces.
        comments: of the header, without the word.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    comments: tuple[str, ...]

    @property
    def positions(self) -> np.ndarray:
        """(V, 3) float64, column by column in memory."""
        found = np.empty((len(self.vertices), 3), order="F")
        for i, name in enumerate("xyz"):
            found[:, i] = self.vertices[name]
        return found

    @property
    def colors(self) -> np.ndarray | None:
        """(V, 3) uint8 sRGB, None where it has none."""
        names = self.vertices.dtype.names or ()
        if not {"red", "green", "blue"} <= set(names):
            return None
        return np.stack([self.vertices[n] for n in ("red", "green", "blue")], axis=1).astype(np.uint8)

    def some(self, chosen: np.ndarray) -> Ply:
        """Some of its vertices, by their indices, without triangles."""
        return Ply(self.vertices[chosen], np.zeros((0, 3), np.int32), self.comments)

    def comment(self, name: str) -> str | None:
        """What follows ``name`` in the comment that begins with it."""
        return next((c[len(name) :].strip() for c in self.comments if c.startswith(f"{name} ")), None)


def read_ply(path: str | Path) -> Ply:
    """Read a binary little-endian PLY of vertices and, maybe, triangles.

    Raises:
        ValueError: it is something else, or cut short; the message names the file.
        OSError: it cannot be read.
    """
    with open_file(path, LARGEST_SCENE) as stream:
        try:
            elements, comments = _header(stream)
            vertices, triangles = np.zeros(0, np.dtype([(n, "<f4") for n in "xyz"])), np.zeros((0, 3), np.int32)
            for name, count, properties in elements:
                if name == "face":
                    triangles = _triangles(stream, count, properties)
                    continue
                kind = np.dtype([(n, "<" + KINDS[k]) for n, k in properties])
                table = _take(stream, count, kind)
                if name == "vertex":
                    vertices = table
            _check(vertices, triangles)
        except (LookupError, TypeError, ValueError, ArithmeticError, MemoryError) as error:
            problem = str(error) or type(error).__name__
            raise ValueError(f"{path}: Not a PLY that can be read here: {problem[:200]}") from error
    return Ply(vertices, triangles, tuple(comments))


def _check(vertices: np.ndarray, triangles: np.ndarray) -> None:
    """Raise a ValueError where Blender would read outside its memory, or meet numbers that are none."""
    missing = [n for n in "xyz" if n not in (vertices.dtype.names or ())]
    if missing:
        raise ValueError(f"its vertices have no {missing[0]}")
    if not all(np.isfinite(vertices[n]).all() for n in "xyz"):
        raise ValueError("a vertex is not finite")
    if len(triangles) and not (triangles.min() >= 0 and triangles.max() < len(vertices)):
        raise ValueError("a triangle names a vertex that is not there")


Elements = list[tuple[str, int, list[tuple[str, str]]]]


def _header(stream: BinaryIO) -> tuple[Elements, list[str]]:
    elements: Elements = []
    comments: list[str] = []
    if stream.readline(64).strip() != b"ply":
        raise ValueError("it does not begin as one")
    for _ in range(MOST_LINES):
        line = stream.readline(4096)
        if not line:
            break
        words = line.decode("ascii").split()
        if not words:
            continue
        if words[0] == "end_header":
            return elements, comments
        if words[0] == "format" and words[1:2] != ["binary_little_endian"]:
            raise ValueError(f"its format is {' '.join(words[1:2]) or 'not told'}")
        if words[0] == "comment":
            comments.append(" ".join(words[1:]))
        elif words[0] == "element":
            elements.append((words[1], int(words[2]), []))
        elif words[0] == "property":
            elements[-1][2].append((words[-1], " ".join(words[1:-1])))
    raise ValueError("its header has no end")


def _take(stream: BinaryIO, count: int, kind: np.dtype) -> np.ndarray:
    """Rows of a table, if the file is that long: nothing is taken from memory for rows that it only claims."""
    size = count * kind.itemsize
    left = os.fstat(stream.fileno()).st_size - stream.tell()
    if not 0 <= size <= left:
        raise ValueError("it is cut short" if count >= 0 else f"it tells {count} rows")
    return np.frombuffer(stream.read(size), kind) if size else np.zeros(count, kind)


def _triangles(stream: BinaryIO, count: int, properties: list[tuple[str, str]]) -> np.ndarray:
    if len(properties) != 1 or not properties[0][1].startswith("list "):
        raise ValueError("its faces hold more than vertices")
    _, length, index = properties[0][1].split()
    if KINDS[length][0] == "f" or KINDS[index][0] == "f":
        raise ValueError("its faces are no whole numbers")
    kind = np.dtype([("length", "<" + KINDS[length]), ("corners", "<" + KINDS[index], 3)])
    table = _take(stream, count, kind)
    if (table["length"] != 3).any():
        raise ValueError("its faces are no triangles")
    corners = table["corners"]
    if corners.size and int(corners.max()) > np.iinfo(np.int32).max:
        raise ValueError("a triangle names a vertex that is not there")
    return corners.astype(np.int32)
