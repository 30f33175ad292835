"""The sun and its shadows on the street chart, from the scene."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.cast_shadows import cast_shadows
from unveil_core.inpaint.crowns import complete_crowns
from unveil_core.inpaint.houses import solid_columns
from unveil_core.inpaint.lateral import lateral_profile
from unveil_core.inpaint.shade import CONTACT_M, Light, disc, luminance
from unveil_core.inpaint.street_chart import OBSERVED, StreetChart
from unveil_core.inpaint.sun import Sun, find_sun, sun_towards
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["light_of_scene"]

COARSE_M = 0.2
"""Texels of the grid that the sun is looked for on, metres."""
LEVEL_M = 12.0
"""Half length of the stretch whose bright texels tell what a lateral offset is like in the sun, metres."""
DARKEST_FALL = 0.7
"""Logarithm of brightness that shadow takes at most; what is darker is no more telling."""
AHEAD_M = 10.0
"""How far beyond the ends of the drive its shadows tell where the sun stands, metres."""
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
    kept = concatenate([kept, solid_columns(chart, kept, solid, cameras, unit)])
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
