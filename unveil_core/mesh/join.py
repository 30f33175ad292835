"""One mesh of the meshes of neighbouring regions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.mesh.mesh import Mesh, renumber, rows_kept

__all__ = ["joined"]

JOIN_GROUPS = 16
"""So many parts of a mesh's vertices are ordered one after the other; ordering then takes a tenth of the mesh's memory."""


def joined(parts: Iterable[Mesh], sizes: Sequence[tuple[int, int]]) -> Mesh:
    """One mesh of those of all regions; vertices at their borders, which two of them have, are one.

    Args:
        parts: made one after the other, for the mesh of a long drive is too large to be held twice.
        sizes: vertices and faces of each.
    """
    if len(sizes) == 1:
        return next(iter(parts))
    vertex_count, face_count = np.sum(sizes, axis=0)
    vertices, colors = np.empty((vertex_count, 3), np.float32), np.empty((vertex_count, 3), np.uint8)
    faces = np.empty((face_count, 3), np.int32)
    at, of_faces = 0, 0
    for part in parts:
        own = slice(at, at + len(part.vertices))
        vertices[own], colors[own] = part.vertices, part.colors
        np.add(part.faces, np.int32(at), out=faces[of_faces : of_faces + len(part.faces)])
        at, of_faces = own.stop, of_faces + len(part.faces)
    same = np.arange(vertex_count, dtype=np.int32)
    for some in _groups(vertices):
        _mark_alike(vertices, some, same)
    kept = _one_of_alike(same)
    renumber(faces, same)
    return Mesh(rows_kept(vertices, kept, True), faces, rows_kept(colors, kept, True))


def _groups(vertices: NDArray[np.float32]) -> Iterator[NDArray[np.int64]]:
    """Indices of the vertices (V, 3), some at a time, rising; those that are alike come together.

    To order all vertices of a long drive at once takes as much memory as their positions.
    """
    group = _hash_rows(vertices.view(np.int32), JOIN_GROUPS)
    return (np.flatnonzero(group == number) for number in range(JOIN_GROUPS))


def _mark_alike(vertices: NDArray[np.float32], some: NDArray[np.int64], same: NDArray[np.int32]) -> None:
    """Weld duplicates: set ``same`` (V,) of each of the vertices ``some`` to the first one with equal bits."""
    bits = vertices[some].view(np.int32)
    order = np.lexsort(bits.T)
    bits = bits[order]
    new = np.ones(len(order), dtype=bool)
    new[1:] = (bits[1:] != bits[:-1]).any(axis=1)
    # A stable order: alike vertices rise.
    first = some[order[np.flatnonzero(new)]]
    same[some[order]] = first[np.cumsum(new) - 1]


@njit(cache=True)
def _one_of_alike(same):  # type: ignore[no-untyped-def]
    """Vertices that are alike become one, the first of them.

    Args:
        same: (V,) int32 of each vertex the first that is like it; becomes its index among those that stay.
    Returns:
        (V,) bool, which stay.
    """
    kept = np.zeros(same.shape[0], np.bool_)
    stay = 0
    for i in range(same.shape[0]):
        # Whom a vertex is one with comes before it and has its index.
        if same[i] == i:
            kept[i] = True
            same[i] = stay
            stay += 1
        else:
            same[i] = same[same[i]]
    return kept


@njit(cache=True)
def _hash_rows(rows, groups):  # type: ignore[no-untyped-def]
    """(V,) uint8: a number below ``groups``, at most 256, for each row of int32 (V, 3); alike rows have the same."""
    group = np.empty(rows.shape[0], np.uint8)
    for i in range(rows.shape[0]):
        key = np.uint64(0)
        for k in range(3):
            # Knuth's multiplicative hashing, by 2^64 over the golden ratio.
            key = (key ^ np.uint64(np.uint32(rows[i, k]))) * np.uint64(0x9E3779B97F4A7C15)
        group[i] = np.uint8((key >> np.uint64(32)) % np.uint64(groups))
    return group
