"""Which triangle each pixel of a camera shows, and where in it: a z-buffer on the processor."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT, in_parallel
from unveil_core.base.types import Float64
from unveil_core.geometry.camera import Camera
from unveil_core.mesh.mesh import Mesh

__all__ = ["Hits", "hit_triangles", "interpolated", "rasterize"]

NEAREST = 0.05
"""Metres; triangles that reach nearer are left out."""
BANDS = 8
"""Of rows, each drawn by one thread."""


@dataclass(frozen=True, eq=False)
class Hits:
    """What the pixels of a camera show of a mesh.

    Attributes:
        face: (H, W) int32 triangle, -1 where there is none.
        weights: (H, W, 2) float32 of its first two corners on the surface; the third has the rest of 1.
        inverse_depth: (H, W) float32 along the optical axis, 1/metres; 0 where there is none.
    """

    face: NDArray[np.int32]
    weights: NDArray[np.float32]
    inverse_depth: NDArray[np.float32]

    def values(self, faces: NDArray[np.int32], table: NDArray[np.generic]) -> NDArray[np.float32]:
        """(H, W, C) float32 interpolated from rows (V, C) of the corners; meaningless where there is no triangle.

        Args:
            faces: (F, 3) rows of each triangle's corners: those of the mesh, or of its texture coordinates.
        """
        if not len(faces):
            return np.zeros((*self.face.shape, table.shape[1]), np.float32)
        return interpolated(faces[np.maximum(self.face, 0)], self.weights, table)


def interpolated(
    corners: NDArray[np.int32], weights: NDArray[np.float32], table: NDArray[np.generic]
) -> NDArray[np.float32]:
    """(..., C) float32 between rows (V, C) of a table: ``corners`` (..., 3), by the weights (..., 2) of the first two."""
    wa, wb = weights[..., :1], weights[..., 1:]
    a, b, c = (table[corners[..., k]].astype(np.float32) for k in range(3))
    found: NDArray[np.float32] = wa * a + wb * b + (1 - wa - wb) * c
    return found


def hit_triangles(mesh: Mesh, camera: Camera) -> Hits:
    """The nearest triangle at the centre of each pixel, from both of its sides.

    Args:
        mesh: in the camera's frame of reference.
        camera: the view; triangles that reach behind it are left out.
    """
    pixels, depth = camera.project(mesh.vertices.astype(np.float64))
    return rasterize(np.column_stack([pixels, depth]), mesh.faces, (camera.height, camera.width))


def rasterize(screen: Float64, faces: NDArray[np.int32], size: tuple[int, int]) -> Hits:
    """The nearest triangle at the centre of each pixel of a screen.

    Args:
        screen: (V, 3) column, row and depth of each corner; those nearer than 5 cm are left out with their triangles.
        faces: (F, 3) rows of ``screen``.
        size: (height, width).
    """
    face, weights = np.full(size, -1, np.int32), np.zeros((*size, 2), np.float32)
    inverse = np.zeros(size, np.float32)
    in_parallel(_draw, BANDS, 1, screen, faces, face, weights, inverse)
    return Hits(face, weights, inverse)


@njit(**EXACT)
def _draw(start, stop, screen, faces, face, weights, inverse):
    """Draw the bands of rows from ``start`` to ``stop``."""
    height, width = face.shape
    for band in range(start, stop):
        top, bottom = height * band // BANDS, height * (band + 1) // BANDS
        for f in range(faces.shape[0]):
            a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
            za, zb, zc = screen[a, 2], screen[b, 2], screen[c, 2]
            if za < NEAREST or zb < NEAREST or zc < NEAREST:
                continue
            ya, yb, yc = screen[a, 1], screen[b, 1], screen[c, 1]
            y0 = max(top, int(np.ceil(max(min(ya, yb, yc), -1.0) - 0.5)))
            y1 = min(bottom - 1, int(np.floor(min(max(ya, yb, yc), height + 1.0) - 0.5)))
            if y1 < y0:
                continue
            xa, xb, xc = screen[a, 0], screen[b, 0], screen[c, 0]
            x0 = max(0, int(np.ceil(max(min(xa, xb, xc), -1.0) - 0.5)))
            x1 = min(width - 1, int(np.floor(min(max(xa, xb, xc), width + 1.0) - 0.5)))
            area = (xb - xa) * (yc - ya) - (xc - xa) * (yb - ya)
            if x1 < x0 or abs(area) < 1e-12:
                continue
            for y in range(y0, y1 + 1):
                py = y + 0.5
                for x in range(x0, x1 + 1):
                    px = x + 0.5
                    wa = ((xb - px) * (yc - py) - (xc - px) * (yb - py)) / area
                    wb = ((xc - px) * (ya - py) - (xa - px) * (yc - py)) / area
                    wc = 1 - wa - wb
                    if wa < -1e-9 or wb < -1e-9 or wc < -1e-9:
                        continue
                    # What is linear on the surface is linear over depth on the screen.
                    ia, ib, ic = wa / za, wb / zb, wc / zc
                    total = ia + ib + ic
                    if total <= inverse[y, x]:
                        continue
                    inverse[y, x] = total
                    face[y, x] = f
                    weights[y, x, 0], weights[y, x, 1] = ia / total, ib / total
