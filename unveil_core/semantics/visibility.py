"""Which points a view really sees: a coarse depth buffer of the points themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera

__all__ = ["PointsInView", "points_in_view"]


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


@njit(cache=True)
def _splat_depth(x, y, depth, half_x, half_y, height, width):  # type: ignore[no-untyped-def]
    buffer = np.full((height, width), np.inf)
    for i in range(x.shape[0]):
        x0, x1 = max(0, int(np.floor(x[i] - half_x[i]))), min(width - 1, int(np.floor(x[i] + half_x[i])))
        y0, y1 = max(0, int(np.floor(y[i] - half_y[i]))), min(height - 1, int(np.floor(y[i] + half_y[i])))
        for row in range(y0, y1 + 1):
            for column in range(x0, x1 + 1):
                if depth[i] < buffer[row, column]:
                    buffer[row, column] = depth[i]
    return buffer


def points_in_view(
    positions: NDArray[np.float64],
    spacing: NDArray[np.float64],
    camera: Camera,
    *,
    near: float,
    normals: NDArray[np.float64] | None = None,
    tolerance: float = 0.06,
    max_radius_px: float = 24.0,
) -> PointsInView:
    """Project points and keep those that no nearer point hides.

    Each point covers the rectangle around its projected disc; a point is hidden where it lies behind the nearest by more than
    ``tolerance`` of its depth plus twice its spacing.

    Args:
        positions: (P, 3) world positions; spacing: (P,) distance to neighbours, metres.
        normals: (P, 3) of the surface, so that ground seen at a grazing angle does not hide itself; None = facing the camera.
        camera: the view.
        near: nearest depth that counts, metres.
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
    buffer = _splat_depth(
        x, y, z, np.minimum(half_x, max_radius_px), np.minimum(half_y, max_radius_px), camera.height, camera.width
    )
    rows, columns = y.astype(np.int64), x.astype(np.int64)
    seen = z <= buffer[rows, columns] * (1 + tolerance) + 2 * spacing[index]
    return PointsInView(index[seen], rows[seen], columns[seen], z[seen])
