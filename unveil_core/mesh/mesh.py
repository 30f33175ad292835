"""A triangle mesh with vertex colours, and the cleaning that every fused mesh needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["Mesh", "drop_small_components", "keep_faces"]


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
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        unit: NDArray[np.float32] = (normal / np.maximum(length, 1e-20)).astype(np.float32)
        return unit


def keep_faces(mesh: Mesh, keep: NDArray[np.bool_]) -> Mesh:
    """The faces (F,) that are True, without the vertices that nobody uses any more."""
    faces = mesh.faces[keep]
    used = np.zeros(len(mesh.vertices), dtype=bool)
    used[faces.ravel()] = True
    new_index = np.cumsum(used, dtype=np.int32) - np.int32(1)
    return Mesh(mesh.vertices[used], new_index[faces], mesh.colors[used])


def drop_small_components(mesh: Mesh, smallest_triangles: int) -> Mesh:
    """The mesh without connected pieces of fewer triangles: floating specks of badly seen depth."""
    if smallest_triangles <= 1 or not len(mesh.faces):
        return mesh
    return keep_faces(mesh, _in_large_components(mesh, smallest_triangles))


def _in_large_components(mesh: Mesh, smallest_triangles: int) -> NDArray[np.bool_]:
    """(F,) faces of pieces of so many triangles and more."""
    component = _components(mesh.faces, len(mesh.vertices))[mesh.faces[:, 0]]
    large: NDArray[np.bool_] = np.bincount(component, minlength=len(mesh.vertices)) >= smallest_triangles
    return large[component]


@njit(cache=True)
def _root(parent, i):  # type: ignore[no-untyped-def]
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@njit(cache=True)
def _components(faces, vertex_count):  # type: ignore[no-untyped-def]
    """Union-find with path halving: the smallest vertex index of each vertex's component, (V,) int32."""
    parent = np.arange(vertex_count).astype(np.int32)
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
