"""Which points a view really sees: a coarse depth buffer of the points themselves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT, in_parallel
from unveil_core.base.types import Float64
from unveil_core.drives.depth_range import ASKED_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.grid import PointGrid
from unveil_core.geometry.projection import pixel_of

__all__ = ["PointsInView", "PointsNear", "points_in_view"]

WIDEST = 1 / 16
"""Half the width of what a point may hide, as a share of the picture's: a lonely point near the camera is no wall. 24 pixels of
384, with which this was tried."""
DRAWN_PX = 24.0
"""Half the width, in pixels or cells, of the largest rectangle that is drawn as it is: a point costs at most 48x48 of them."""
POINTS = 16_384
"""That a thread takes at a time: some tenths of a millisecond of work."""


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
        size = levels[0] << 8 | levels[1]
        self.buffers: list[tuple[int, int, Float64]] = []
        for kind in np.unique(size).tolist():
            own, across, down = size == kind, kind >> 8, kind & 255
            wide, tall = 1 << across, 1 << down
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


@njit(**EXACT)
def _discs(start, stop, positions, spacing, normals, turn, shift, intrinsics, near, widest, found):  # type: ignore[no-untyped-def]
    """Pixel x, y, depth, and half the width and height of each point's projected disc, (P, 5); depth 0 outside the picture."""
    _, _, fx, fy, cx, cy = intrinsics
    for i in range(start, stop):
        x, y, z = pixel_of(positions[i, 0], positions[i, 1], positions[i, 2], turn, shift, intrinsics, near)
        found[i, 2] = z
        if z == 0:
            continue
        radius = 0.8 * spacing[i] / z
        half_x, half_y = radius * fx, radius * fy
        if len(normals):
            # Extents of a disc along the camera's axes, and what its extent in depth adds by perspective.
            a, b, c = normals[i, 0], normals[i, 1], normals[i, 2]
            own_x = turn[0, 0] * a + turn[0, 1] * b + turn[0, 2] * c
            own_y = turn[1, 0] * a + turn[1, 1] * b + turn[1, 2] * c
            own_z = turn[2, 0] * a + turn[2, 1] * b + turn[2, 2] * c
            deep = np.sqrt(max(1 - own_z * own_z, 0.0))
            half_x = radius * (np.sqrt(max(1 - own_x * own_x, 0.0)) * fx + deep * abs(x - cx))
            half_y = radius * (np.sqrt(max(1 - own_y * own_y, 0.0)) * fy + deep * abs(y - cy))
        found[i, 0], found[i, 1] = x, y
        found[i, 3], found[i, 4] = min(half_x, widest), min(half_y, widest)


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
    widest = max(DRAWN_PX, WIDEST * camera.width)
    toward = np.empty((0, 3)) if normals is None else np.ascontiguousarray(normals, dtype=np.float64)
    found = np.empty((len(positions), 5))
    places, apart = (np.ascontiguousarray(a, dtype=np.float64) for a in (positions, spacing))
    in_parallel(
        _discs, len(places), POINTS, places, apart, toward, *camera.pose, camera.intrinsics, near, widest, found
    )
    index = np.flatnonzero(found[:, 2] > 0)
    x, y, z, *half = found[index].T.copy()
    nearest = _NearestDepth(x, y, z, (half[0], half[1]), (camera.height, camera.width))
    rows, columns = y.astype(np.int64), x.astype(np.int64)
    seen = z <= nearest.at(rows, columns) * (1 + tolerance) + 2 * spacing[index]
    return PointsInView(index[seen], rows[seen], columns[seen], z[seen])


class PointsNear:
    """Points of a whole drive, of which a view is only asked about those near it.

    Args:
        positions: (P, 3) world positions; spacing: (P,) distance to neighbours, metres.
        normals: (P, 3) or None, see :func:`points_in_view`.
    """

    def __init__(
        self,
        positions: NDArray[np.float64],
        spacing: NDArray[np.float64],
        normals: NDArray[np.float64] | None = None,
    ) -> None:
        self._positions, self._spacing, self._normals = positions, spacing, normals
        self._grid = PointGrid(positions)

    def seen_by(self, camera: Camera, *, near: float) -> PointsInView:
        """Those within ``ASKED_M`` of a view, and some beyond, that no nearer one of them hides."""
        index = self._grid.near(camera.centre, ASKED_M)
        normals = None if self._normals is None else self._normals[index]
        seen = points_in_view(self._positions[index], self._spacing[index], camera, near=near, normals=normals)
        return replace(seen, index=index[seen.index])
