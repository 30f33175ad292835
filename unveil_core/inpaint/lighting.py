"""The sun and its shadows on the street chart, from the scene."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

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
LEVEL_M = 12.0
"""Half length of the stretch whose bright texels tell what a lateral offset is like in the sun, metres."""
DARKEST_FALL = 0.7
"""Logarithm of brightness that shadow takes at most; what is darker is no more telling."""
AHEAD_M = 10.0
"""How far beyond the ends of the drive its shadows tell where the sun stands, metres."""
STANDS_M = 0.25
"""What is lower than this over the ground casts no shadow to speak of, metres."""


def light_of_scene(
    chart: StreetChart,
    kept: Surfels,
    gone: Surfels,
    *,
    unit: float,
    footprint: NDArray[np.bool_] | None = None,
    drive: tuple[float, float] | None = None,
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
        drive: arc lengths at which the drive begins and ends, None = unknown.
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
        sun = _look_for_sun(chart, footprint, drive, concatenate([kept, gone]), unit)
    if sun is None:
        return None
    kept = concatenate([kept, _down_to_ground(chart, kept, solid, unit)])
    shape = chart.source.shape
    s, l = chart.coordinates()  # noqa: E741
    inside = chart.ground.inside(np.repeat(s, shape[1]), np.tile(l, shape[0])).reshape(shape)
    rows, columns = np.nonzero(inside)
    points = chart.world(rows, columns)
    planes = []
    for surfels in (kept, gone):
        plane = np.zeros(shape, dtype=bool)
        plane[rows, columns] = cast_shadows(points, surfels, sun.towards, cell=0.06 * unit, bias=0.15 * unit)
        planes.append(plane)
    return Light(sun, planes[0], planes[1])


def _standing(chart: StreetChart, surfels: Surfels, height: float) -> Surfels:
    street = chart.ground.path.to_street(surfels.means.detach().double().numpy())
    over = street[:, 2] - chart.ground.height_at(street[:, 0], street[:, 1])
    return surfels.select(torch.from_numpy(over > height))


def _down_to_ground(chart: StreetChart, surfels: Surfels, solid: Sequence[int], unit: float) -> Surfels:
    """Discs in the columns under the tops of what is solid, for what parked cars hid of it lets no light through."""
    path, cell = chart.ground.path, COLUMN_M * unit
    street = path.to_street(surfels.means.detach().double().numpy())[np.isin(surfels.labels.numpy(), list(solid))]
    foot = chart.ground.height_at(street[:, 0], street[:, 1])
    index = np.round(street[:, :2] / cell).astype(np.int64)
    columns, member = np.unique(index, axis=0, return_inverse=True)
    top = np.full(len(columns), -np.inf)
    np.maximum.at(top, member.ravel(), street[:, 2] - foot)
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
        for end, sign in ((along.min(), -1), (along.max(), 1)):
            last = side & (np.abs(columns[:, 0] - end) < beyond // 3)
            offsets, member = np.unique(columns[last, 1], return_inverse=True)
            highest = np.full(len(offsets), -np.inf)
            np.maximum.at(highest, member, top[last])
            # At the edge of the view only the lower part was seen.
            rows = end + sign * np.arange(-beyond // 10, beyond + 1)
            parts.append(np.stack([np.repeat(rows, len(offsets)), np.tile(offsets, len(rows))], axis=1))
            tops.append(np.tile(highest, len(rows)))
    return np.concatenate(parts), np.concatenate(tops)


def _look_for_sun(
    chart: StreetChart, footprint: NDArray[np.bool_] | None, drive: tuple[float, float] | None, casters: Surfels, unit: float
) -> Sun | None:  # fmt: skip
    step = max(1, round(COARSE_M * unit / chart.texel))
    per_m = unit / chart.texel
    observed = chart.source == OBSERVED
    if footprint is not None:
        # Beside an object it is dark wherever the sun stands.
        observed &= ~cv2.dilate(footprint.astype(np.uint8), disc(CONTACT_M * per_m)).astype(bool)
    if drive is not None:
        # Far ahead a pixel is a stretch of street, and a little height a great distance.
        s, reach = chart.coordinates()[0], AHEAD_M * unit
        observed &= ((s >= drive[0] - reach) & (s <= drive[1] + reach))[:, None]
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
