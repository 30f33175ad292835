"""Which points a view really sees: a coarse depth buffer of the points themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from unveil_core.base.types import Float64
from unveil_core.geometry.camera import Camera

__all__ = ["PointsInView", "points_in_view"]

WIDEST = 1 / 16
"""Half the width of what a point may hide, as a share of the picture's: a lonely point near the camera is no wall. 24 pixels of
384, with which this was tried."""
DRAWN_PX = 24.0
"""Half the width, in pixels or cells, of the largest rectangle that is drawn as it is: a point costs at most 48x48 of them."""


@dataclass(frozen=True, eq=False)
class PointsInView:
    """The points that one view sees.

    Attributes:
        index: (M,) which points, ascending.
        rows, columns: (M,) the pixels they fall on, in the camera's own resolution.
        depth: (M,) metres along the optical axis.
    """

    index: NDArray[np.int64]
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    depth: NDArray[np.float64]

    def outside(self, mask: NDArray[np.bool_]) -> PointsInView:
        """Those that do not fall on the pixels of a mask (H, W)."""
        keep = ~mask[self.rows, self.columns]
        return PointsInView(self.index[keep], self.rows[keep], self.columns[keep], self.depth[keep])


class _NearestDepth:
    """A depth buffer of rectangles; large ones are drawn into buffers of coarser cells, so that none costs much."""

    def __init__(self, x: Float64, y: Float64, depth: Float64, half: tuple[Float64, Float64], shape: tuple[int, int]):
        levels = [np.ceil(np.log2(np.maximum(h / DRAWN_PX, 1.0))).astype(np.int64) for h in half]
        self.buffers: list[tuple[int, int, Float64]] = []
        for across, down in sorted(set(zip(*(level.tolist() for level in levels), strict=True))):
            own, wide, tall = (levels[0] == across) & (levels[1] == down), 1 << across, 1 << down
            buffer = np.full((-(-shape[0] // tall), -(-shape[1] // wide)), np.inf)
            # A pixel is covered where the rectangle touches it, a larger cell where it covers the middle.
            _draw(
                x[own] / wide,
                y[own] / tall,
                depth[own],
                half[0][own] / wide - (0.5 if across else 0.0),
                half[1][own] / tall - (0.5 if down else 0.0),
                buffer,
            )
            self.buffers.append((tall, wide, buffer))

    def at(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Float64:
        """(N,) depth of the nearest rectangle over pixels, inf where there is none."""
        nearest = np.full(len(rows), np.inf)
        for tall, wide, buffer in self.buffers:
            nearest = np.minimum(nearest, buffer[rows // tall, columns // wide])
        return nearest


@njit(cache=True)
def _draw(x, y, depth, half_x, half_y, buffer):  # type: ignore[no-untyped-def]
    height, width = buffer.shape
    for i in range(x.shape[0]):
        x0, x1 = max(0, int(np.floor(x[i] - half_x[i]))), min(width - 1, int(np.floor(x[i] + half_x[i])))
        y0, y1 = max(0, int(np.floor(y[i] - half_y[i]))), min(height - 1, int(np.floor(y[i] + half_y[i])))
        for row in range(y0, y1 + 1):
            for column in range(x0, x1 + 1):
                if depth[i] < buffer[row, column]:
                    buffer[row, column] = depth[i]


def points_in_view(
    positions: NDArray[np.float64],
    spacing: NDArray[np.float64],
    camera: Camera,
    *,
    near: float,
    normals: NDArray[np.float64] | None = None,
    tolerance: float = 0.06,
) -> PointsInView:
    """Project points and keep those that no nearer point hides.

    Each point covers the rectangle around its projected disc; a point is hidden where it lies behind the nearest by more than
    ``tolerance`` of its depth plus twice its spacing.

    Args:
        positions: (P, 3) world positions; spacing: (P,) distance to neighbours, metres.
        normals: (P, 3) of the surface, so that ground seen at a grazing angle does not hide itself; None = facing the camera.
        camera: the view.
        near: nearest depth that counts, metres.
        tolerance: a share of the depth.
    """
    pixels, depth = camera.project(positions)
    index = np.flatnonzero(camera.in_picture(pixels, depth, nearest=near))
    x, y, z = pixels[index, 0], pixels[index, 1], depth[index]
    radius = 0.8 * spacing[index] / z
    if normals is None:
        half_x, half_y = radius * camera.fx, radius * camera.fy
    else:
        # Extents of a disc along the camera's axes, and what its extent in depth adds by perspective.
        own = normals[index] @ camera.world_to_camera[:3, :3].T
        extent = np.sqrt(np.maximum(1 - own * own, 0.0))
        half_x = radius * (extent[:, 0] * camera.fx + extent[:, 2] * np.abs(x - camera.cx))
        half_y = radius * (extent[:, 1] * camera.fy + extent[:, 2] * np.abs(y - camera.cy))
    widest = max(DRAWN_PX, WIDEST * camera.width)
    half = np.minimum(half_x, widest), np.minimum(half_y, widest)
    nearest = _NearestDepth(x, y, z, half, (camera.height, camera.width))
    rows, columns = y.astype(np.int64), x.astype(np.int64)
    seen = z <= nearest.at(rows, columns) * (1 + tolerance) + 2 * spacing[index]
    return PointsInView(index[seen], rows[seen], columns[seen], z[seen])
