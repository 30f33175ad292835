"""A triangle mesh with vertex colours, and the cleaning that every fused mesh needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit

__all__ = ["Mesh", "drop_small_components", "keep_faces", "renumber", "rows_kept"]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with vertex colours.

    Attributes:
        vertices: (V, 3) float32 positions in the drive's local frame.
        faces: (F, 3) int32 vertex indices, counter-clockwise as seen from outside.
        colors: (V, 3) uint8 sRGB.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]
    colors: NDArray[np.uint8]

    @staticmethod
    def empty() -> Mesh:
        """No triangles."""
        return Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros((0, 3), np.uint8))

    def face_normals(self) -> NDArray[np.float32]:
        """(F, 3) unit normals, zero for degenerate triangles."""
        normal = self._edge_products()
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        unit: NDArray[np.float32] = (normal / np.maximum(length, 1e-20)).astype(np.float32)
        return unit

    @property
    def area(self) -> float:
        """Of all triangles, square metres."""
        return float(np.linalg.norm(self._edge_products().astype(np.float64), axis=1).sum()) / 2

    def _edge_products(self) -> NDArray[np.float32]:
        """(F, 3) cross products of two edges: along the normals, twice as long as the triangles are large."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        product: NDArray[np.float32] = np.cross(b - a, c - a)
        return product


def keep_faces(mesh: Mesh, keep: NDArray[np.bool_], *, overwrite: bool = False) -> Mesh:
    """The faces (F,) that are True, without the vertices that nobody uses any more.

    Args:
        overwrite: the mesh's own arrays may be used for the result, for who has no room for two.
    """
    faces = rows_kept(mesh.faces, keep, overwrite)
    used = np.zeros(len(mesh.vertices), dtype=bool)
    _mark_used(faces, used)
    renumber(faces, np.cumsum(used, dtype=np.int32) - np.int32(1))
    return Mesh(rows_kept(mesh.vertices, used, overwrite), faces, rows_kept(mesh.colors, used, overwrite))


def drop_small_components(mesh: Mesh, smallest_triangles: int, *, overwrite: bool = False) -> Mesh:
    """The mesh without connected pieces of fewer triangles: floating specks of badly seen depth.

    Args:
        overwrite: see :func:`keep_faces`.
    """
    if smallest_triangles <= 1 or not len(mesh.faces):
        return mesh
    keep = _in_large_components(mesh.faces, _components(mesh.faces, len(mesh.vertices)), smallest_triangles)
    return mesh if keep.all() else keep_faces(mesh, keep, overwrite=overwrite)


def rows_kept(table: NDArray[Any], keep: NDArray[np.bool_], overwrite: bool) -> NDArray[Any]:
    """The rows of ``table`` (N, 3) that are True in ``keep`` (N,), in their order; with ``overwrite`` in its own memory."""
    return table[: _move_up(table, keep)] if overwrite else table[keep]


# Compiled, for NumPy makes 64-bit copies of what it indexes by: of a long drive's mesh several hundred MB.


@njit(cache=True)
def renumber(faces, new_index):  # type: ignore[no-untyped-def]
    """Replace the vertex indices of faces (F, 3), in place."""
    for f in range(faces.shape[0]):
        for k in range(3):
            faces[f, k] = new_index[faces[f, k]]


@njit(cache=True)
def _move_up(rows, keep):  # type: ignore[no-untyped-def]
    """Move the rows (N, 3) that are kept to the beginning, in their order; how many they are."""
    count = 0
    for i in range(rows.shape[0]):
        if keep[i]:
            for k in range(3):
                rows[count, k] = rows[i, k]
            count += 1
    return count


@njit(cache=True)
def _mark_used(faces, used):  # type: ignore[no-untyped-def]
    for f in range(faces.shape[0]):
        for k in range(3):
            used[faces[f, k]] = True


@njit(cache=True)
def _in_large_components(faces, component, smallest):  # type: ignore[no-untyped-def]
    """(F,) bool, faces of pieces of so many triangles and more; ``component``: (V,) of each vertex."""
    count = np.zeros(component.shape[0], np.int32)
    for f in range(faces.shape[0]):
        count[component[faces[f, 0]]] += 1
    large = np.zeros(faces.shape[0], np.bool_)
    for f in range(faces.shape[0]):
        large[f] = count[component[faces[f, 0]]] >= smallest
    return large


@njit(cache=True)
def _root(parent, i):  # type: ignore[no-untyped-def]
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True)
def _components(faces, vertex_count):  # type: ignore[no-untyped-def]
    """Union-find with path halving: the smallest vertex index of each vertex's component, (V,) int32."""
    parent = np.empty(vertex_count, np.int32)
    for i in range(vertex_count):
        parent[i] = i
    for f in range(faces.shape[0]):
        a = _root(parent, faces[f, 0])
        for k in range(1, 3):
            b = _root(parent, faces[f, k])
            if a < b:
                parent[b] = a
            elif b < a:
                parent[a] = b
                a = b
    for i in range(vertex_count):
        parent[i] = _root(parent, i)
    return parent
