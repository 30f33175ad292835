"""The sun and its shadows on the street chart, from the scene."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import grey_closing, grey_opening, label

from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.cast_shadows import cast_shadows
from unveil_core.inpaint.crowns import complete_crowns
from unveil_core.inpaint.lateral import lateral_profile
from unveil_core.inpaint.shade import CONTACT_M, Light, disc, luminance
from unveil_core.inpaint.street_chart import OBSERVED, StreetChart
from unveil_core.inpaint.sun import Sun, find_sun, sun_towards
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["light_of_scene"]

COARSE_M = 0.2
"""Texels of the grid that the sun is looked for on, metres."""
COLUMN_M = 0.3
"""Edge of the columns that solid things are filled in, metres."""
BEYOND_M = 10.0
"""How far houses go on where the drive begins and ends, metres."""
GOES_ON_M = 3.0
"""How far the last house that was seen is taken to go on, metres."""
LEVEL_M = 12.0
"""Half length of the stretch whose bright texels tell what a lateral offset is like in the sun, metres."""
DARKEST_FALL = 0.7
"""Logarithm of brightness that shadow takes at most; what is darker is no more telling."""
AHEAD_M = 10.0
"""How far beyond the ends of the drive its shadows tell where the sun stands, metres."""
OVER_M = 0.4
"""How far over the top of a column nothing must be seen for it to end there, metres."""
LEAST_M = 2.0
"""Length along the street of the shortest wall, metres."""
DENSE_M = 1.2
"""How far along a front its top is found at least once, metres."""
HOUSE_M, BESIDE_M = 2.0, 10.0
"""Least height of a house, and how far along it its height is carried, metres."""
CHINK_M = 0.25
"""Half width of gaps in a shadow that are none, metres."""
STANDS_M = 0.25
"""What is lower than this over the ground casts no shadow to speak of, metres."""


def light_of_scene(
    chart: StreetChart,
    kept: Surfels,
    gone: Surfels,
    *,
    unit: float,
    footprint: NDArray[np.bool_] | None = None,
    cameras: Sequence[Camera] = (),
    solid: Sequence[int] = (),
    plants: Sequence[int] = (),
    given: tuple[float, float] | None = None,
) -> Light | None:
    """Find the sun by its shadows and cast those of what stays and of what goes.

    Args:
        chart: as read.
        kept, gone: surfels of what stays and of what is removed.
        unit: world units per metre.
        footprint: (A, B) texels that removed objects stand on; None = unknown.
        cameras: of the drive.
        solid: labels of what is solid down to the ground, as houses and walls, though their feet may be hidden.
        plants: labels of vegetation.
        given: azimuth and elevation of the sun, degrees (see ``sun_towards``), instead of looking for it.
    Returns:
        None where no sun explains the dark places.
    """
    kept, gone = (_standing(chart, surfels, STANDS_M * unit) for surfels in (kept, gone))
    trees = kept.select(torch.from_numpy(np.isin(kept.labels.numpy(), list(plants))))
    kept = concatenate([kept, complete_crowns(trees, chart.ground, unit=unit)])
    if given is not None:
        sun: Sun | None = Sun(sun_towards(*given, chart.ground.path.axes[2]), 1.0, *given)
    else:
        sun = _look_for_sun(chart, footprint, cameras, concatenate([kept, gone]), unit)
    if sun is None:
        return None
    kept = concatenate([kept, _down_to_ground(chart, kept, solid, cameras, unit)])
    shape = chart.source.shape
    s, l = chart.coordinates()  # noqa: E741
    inside = chart.ground.inside(np.repeat(s, shape[1]), np.tile(l, shape[0])).reshape(shape)
    rows, columns = np.nonzero(inside)
    points = chart.world(rows, columns)
    planes = []
    for surfels in (kept, gone):
        plane = np.zeros(shape, dtype=bool)
        plane[rows, columns] = cast_shadows(points, surfels, sun.towards, cell=0.06 * unit, bias=0.15 * unit)
        # No light comes through chinks, nor between a wall and the ground at its foot.
        chinks = disc(CHINK_M * unit / chart.texel)
        planes.append(
            cv2.morphologyEx((plane | ~inside).astype(np.uint8), cv2.MORPH_CLOSE, chinks).astype(bool) & inside
        )
    return Light(sun, planes[0], planes[1])


def _standing(chart: StreetChart, surfels: Surfels, height: float) -> Surfels:
    street = chart.ground.path.to_street(surfels.means.detach().double().numpy())
    over = street[:, 2] - chart.ground.height_at(street[:, 0], street[:, 1])
    return surfels.select(torch.from_numpy(over > height))


def _down_to_ground(
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
    long = _of_something_long(columns)
    columns, top = columns[long], top[long]
    top = _as_high_as_beside(chart, columns * cell, top, cameras, unit)
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


def _of_something_long(columns: NDArray[np.int64]) -> NDArray[np.bool_]:
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


def _as_high_as_beside(
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


def _look_for_sun(
    chart: StreetChart, footprint: NDArray[np.bool_] | None, cameras: Sequence[Camera], casters: Surfels, unit: float
) -> Sun | None:  # fmt: skip
    step = max(1, round(COARSE_M * unit / chart.texel))
    per_m = unit / chart.texel
    observed = chart.source == OBSERVED
    if footprint is not None:
        # Beside an object it is dark wherever the sun stands.
        observed &= ~cv2.dilate(footprint.astype(np.uint8), disc(CONTACT_M * per_m)).astype(bool)
    if cameras:
        # Far ahead a pixel is a stretch of street, and a little height a great distance.
        way = chart.ground.path.to_street(np.stack([c.centre for c in cameras]))[:, 0]
        s, reach = chart.coordinates()[0], AHEAD_M * unit
        observed &= ((s >= way.min() - reach) & (s <= way.max() + reach))[:, None]
    _, lit = lateral_profile(chart.color, observed, window=int(LEVEL_M * per_m), hop=int(LEVEL_M / 3 * per_m))
    fall = np.log(np.maximum(lit, 0.01)) - np.log(np.maximum(luminance(chart.color), 0.02))
    darkness = np.clip(fall, 0, DARKEST_FALL)
    weight = cv2.blur(observed.astype(np.float32), (step, step))
    mean = cv2.blur(np.where(observed, darkness, 0).astype(np.float32), (step, step)) / np.maximum(weight, 1e-6)

    cells = np.s_[step // 2 :: step, step // 2 :: step]
    s, l = (along[step // 2 :: step] for along in chart.coordinates())  # noqa: E741
    if min(len(s), len(l)) < 2:
        return None
    means = casters.means.detach().double().numpy()
    known = weight[cells] > 0.5
    return find_sun(mean[cells].astype(np.float32), known, s, l, chart.ground, means, unit=unit)
