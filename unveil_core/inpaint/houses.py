"""Houses as solid columns: what parked cars hide of a wall, or the pictures' border cuts off, lets no light through either."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import grey_closing, grey_opening, label

from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.street_chart import StreetChart
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["as_high_as_beside", "of_something_long", "solid_columns"]

COLUMN_M = 0.3
"""Edge of the columns that solid things are filled in, metres."""
BEYOND_M = 10.0
"""How far houses go on where the drive begins and ends, metres."""
GOES_ON_M = 3.0
"""How far the last house that was seen is taken to go on, metres."""
OVER_M = 0.4
"""How far over the top of a column nothing must be seen for it to end there, metres."""
LEAST_M = 2.0
"""Length along the street of the shortest wall, metres."""
DENSE_M = 1.2
"""How far along a front its top is found at least once, metres."""
HOUSE_M, BESIDE_M = 2.0, 10.0
"""Least height of a house, and how far along it its height is carried, metres."""


def solid_columns(
    chart: StreetChart, surfels: Surfels, solid: Sequence[int], cameras: Sequence[Camera], unit: float
) -> Surfels:
    """Discs in the columns under the tops of what is solid, for what parked cars hid of it lets no light through."""
    path, cell = chart.ground.path, COLUMN_M * unit
    street = path.to_street(surfels.means.detach().double().numpy())[np.isin(surfels.labels.numpy(), list(solid))]
    foot = chart.ground.height_at(street[:, 0], street[:, 1])
    index = np.round(street[:, :2] / cell).astype(np.int64)
    columns, member = np.unique(index, axis=0, return_inverse=True)
    top = np.full(len(columns), -np.inf)
    np.maximum.at(top, member.ravel(), street[:, 2] - foot)
    long = of_something_long(columns)
    columns, top = columns[long], top[long]
    top = as_high_as_beside(chart, columns * cell, top, cameras, unit)
    columns, top = _continued(columns, top, round(BEYOND_M / COLUMN_M))
    levels = np.arange(1, int(np.ceil(top.max(initial=0.0) / cell)) + 1) * cell
    which, level = np.nonzero(levels[None] < top[:, None])
    at = columns[which] * cell
    height = chart.ground.height_at(at[:, 0], at[:, 1]) + levels[level]
    points = path.to_world(np.stack([at[:, 0], at[:, 1], height], axis=1))
    # Lying and standing: from any side one of the two is broad.
    up = np.repeat(path.axes[2:3], len(points), axis=0)
    across = path.to_world(np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    side = np.repeat(np.diff(across, axis=0), len(points), axis=0)
    parts = [
        surfels_from_points(
            points, np.zeros((len(points), 3), np.uint8), np.zeros(len(points), np.int64), normal,
            np.full(len(points), cell), sh_degree=surfels.sh_degree, opacity=0.95, scale_factor=0.5,
        )
        for normal in (up, side)
    ]  # fmt: skip
    return concatenate(parts)


def _in_sight(points: NDArray[np.float64], cameras: Sequence[Camera]) -> NDArray[np.bool_]:
    """(P,) bool, whether some picture shows the place (P, 3), were nothing before it."""
    seen = np.zeros(len(points), dtype=bool)
    for camera in cameras:
        pixel, depth = camera.project(points)
        seen |= (depth > 1e-6) & (pixel >= 0).all(axis=1) & (pixel < (camera.width, camera.height)).all(axis=1)
    return seen


def of_something_long(columns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(C,) whether columns (C, 2) belong together with others to something as long as a house: lamps are taken for one at times."""
    if not len(columns):
        return np.zeros(0, dtype=bool)
    index = columns - columns.min(axis=0)
    plane = np.zeros(index.max(axis=0) + 1, dtype=bool)
    plane[index[:, 0], index[:, 1]] = True
    parts, count = label(plane, np.ones((3, 3)))
    part = parts[index[:, 0], index[:, 1]]
    first, last = np.full(count + 1, np.iinfo(np.int64).max), np.full(count + 1, -1)
    np.minimum.at(first, part, index[:, 0])
    np.maximum.at(last, part, index[:, 0])
    return np.asarray((last - first)[part] * COLUMN_M >= LEAST_M)


def as_high_as_beside(
    chart: StreetChart, at: NDArray[np.float64], top: NDArray[np.float64], cameras: Sequence[Camera], unit: float
) -> NDArray[np.float64]:
    """Tops (C,) of columns at street coordinates (C, 2); houses that the pictures' border cuts off are as high as farther along,
    where it does not."""
    result, ground = top.copy(), chart.ground
    for left in (False, True):
        side = np.flatnonzero((at[:, 1] > 0) == left)
        if not len(side):
            continue
        row = np.round((at[side, 0] - at[side, 0].min()) / (COLUMN_M * unit)).astype(np.int64)
        ridge = np.full(row.max() + 1, -np.inf)
        np.maximum.at(ridge, row, top[side])
        highest = np.zeros(len(ridge), dtype=np.int64)
        highest[row[top[side] >= ridge[row]]] = side[top[side] >= ridge[row]]
        # The front is not equally dense everywhere, and chimneys are no ridge.
        size = 2 * round(DENSE_M / COLUMN_M) + 1
        ridge = grey_opening(grey_closing(np.maximum(ridge, 0.0), size), size)
        house = np.flatnonzero(ridge > HOUSE_M * unit)
        s, l = at[highest[house]].T  # noqa: E741
        over = np.stack([s, l, ground.height_at(s, l) + ridge[house] + OVER_M * unit], axis=1)
        ends = _in_sight(ground.path.to_world(over), cameras)
        known, cut = house[ends], house[~ends]
        if not len(known) or not len(cut):
            continue
        gap = np.abs(cut[:, None] - known[None])
        raised = np.zeros(len(ridge))
        raised[cut] = np.where(gap.min(axis=1) * COLUMN_M < BESIDE_M, ridge[known][gap.argmin(axis=1)], 0.0)
        # What is much lower than the front stands before the house.
        front = top[side] > 0.6 * ridge[row]
        result[side] = np.where(front, np.maximum(top[side], raised[row]), top[side])
    return result


def _continued(
    columns: NDArray[np.int64], top: NDArray[np.float64], beyond: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Columns (C, 2) with their tops (C,), and on each side the last rows drawn out along the street by ``beyond``: the
    first camera did not see the house beside it."""
    parts, tops = [columns], [top]
    for left in (False, True):
        side = (columns[:, 1] > 0) == left
        if not side.any():
            continue
        along = columns[side, 0]
        ridge = np.full(np.ptp(along) + 1, -np.inf)
        np.maximum.at(ridge, along - along.min(), top[side])
        typical = float(np.median(ridge[np.isfinite(ridge)]))
        for end, sign in ((along.min(), -1), (along.max(), 1)):
            last = side & (np.abs(columns[:, 0] - end) < beyond // 3)
            offsets = np.unique(columns[last, 1])
            step = np.arange(-beyond // 10, beyond + 1)
            rows = end + sign * step
            # The last house goes on a little; the next one is as high as the others here.
            high = np.where(step < round(GOES_ON_M / COLUMN_M), top[last].max(), typical)
            parts.append(np.stack([np.repeat(rows, len(offsets)), np.tile(offsets, len(rows))], axis=1))
            tops.append(np.repeat(high, len(offsets)))
    return np.concatenate(parts), np.concatenate(tops)
