"""The sun and its shadows on the street chart, from the scene."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import luminance
from unveil_core.inpaint.chart.lateral_profile import lateral_profile
from unveil_core.inpaint.chart.street_chart import OBSERVED, StreetChart
from unveil_core.inpaint.light.crowns import complete_crowns
from unveil_core.inpaint.light.houses import flush_with_fronts, solid_columns
from unveil_core.inpaint.light.shade import CONTACT_M, Light, disc, read_shade
from unveil_core.inpaint.light.shadow_map import cast_shadows
from unveil_core.inpaint.light.sun import Sun, find_sun, sun_towards
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["light_of_scene", "lit_at_sunny_walls"]

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
BORDER_M, CLOSER_M = 5.0, 0.12
"""Half length of the stretch that tells what is dark when the sun is looked for again, and its texels, metres."""
AGAIN = ((6.0, 2.0), (1.5, 0.75))
"""How far around the sun that was found it is looked for again, and in which steps, degrees."""
LARGEST_M, TREE_M = 0.25, 1.0
"""What is larger blurs an outline, and how far from a tree's shadow the ground says nothing of other things, metres."""
AT_FOOT_M = 0.6
"""Width of the ground at the foot of a wall whose shadow may be the wall's roughness, metres."""
STANDS_M = 0.25
"""What is lower than this over the ground casts no shadow to speak of, metres."""


def light_of_scene(
    chart: StreetChart,
    kept: Surfels,
    gone: Surfels,
    *,
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
        footprint: (A, B) texels that removed objects stand on; None = unknown.
        cameras: of the drive.
        solid: labels of what is solid down to the ground, as houses and walls, though their feet may be hidden.
        plants: labels of vegetation.
        given: azimuth and elevation of the sun, degrees (see ``sun_towards``), instead of looking for it.
    Returns:
        None where no sun explains the dark places.
    """
    kept, gone = (_standing(chart, surfels, STANDS_M) for surfels in (kept, gone))
    trees = kept.select(torch.from_numpy(np.isin(kept.labels.numpy(), list(plants))))
    seen_casters = concatenate([kept, gone])
    crowns = complete_crowns(trees, chart.ground)
    kept = concatenate([kept, crowns])
    if given is not None:
        sun: Sun | None = Sun(sun_towards(*given, chart.ground.path.axes[2]), 1.0, *given)
    else:
        sun = _look_for_sun(chart, footprint, cameras, concatenate([kept, gone]))
    if sun is None:
        return None
    if given is None:
        # Only by what was seen itself: the far side of a crown is a guess, good enough to come near.
        sun = _looked_again(
            *_light_seen(chart, _telling(chart, footprint, cameras, CONTACT_M), seen_casters, sun),
            seen_casters, concatenate([trees, crowns]), plants, sun, chart.ground.path.axes[2],
        )  # fmt: skip
    # Between two cars there is little else than what lies beside them.
    places, is_dark = _light_seen(chart, _telling(chart, footprint, cameras, CONTACT_M / 4), seen_casters, sun)
    kept = kept.select(torch.from_numpy(flush_with_fronts(chart, kept, solid)))
    known = _cast(places, concatenate([kept, gone]), sun.towards)

    def judge(added: Surfels) -> float | None:
        more = _cast(places, added, sun.towards) & ~known
        # Of what only the added would darken, is more dark or light? Nothing added scores 0.
        return float(np.where(is_dark[more], 1.0, -1.0).sum()) if len(places) else None

    kept = concatenate([kept, solid_columns(chart, kept, solid, cameras, judge)])
    shape = chart.source.shape
    s, t = chart.coordinates()
    inside = chart.ground.inside(np.repeat(s, shape[1]), np.tile(t, shape[0])).reshape(shape)
    rows, columns = np.nonzero(inside)
    points = chart.world(rows, columns)
    planes = []
    for surfels in (kept, gone):
        plane = np.zeros(shape, dtype=bool)
        plane[rows, columns] = _cast(points, surfels, sun.towards)
        # No light comes through chinks, nor between a wall and the ground at its foot.
        chinks = disc(CHINK_M / chart.texel)
        plane = cv2.morphologyEx((plane | ~inside).astype(np.uint8), cv2.MORPH_CLOSE, chinks).astype(bool) & inside
        planes.append(lit_at_sunny_walls(chart, plane, inside, sun.towards, round(AT_FOOT_M / chart.texel)))
    return Light(sun, planes[0], planes[1])


def lit_at_sunny_walls(
    chart: StreetChart, plane: NDArray[np.bool_], inside: NDArray[np.bool_], towards: NDArray[np.float64], width: int
) -> NDArray[np.bool_]:
    """The shadows (A, B) without those that lie only along the ground's border on the side away from the sun: a wall there, which
    is as rough as its surfels, cannot shade its own foot.

    Args:
        inside: (A, B) the ground; towards: (3,) the sun; width: of the border, texels.
    """
    path = chart.ground.path
    rows, columns = plane.shape
    s = chart.coordinates()[0]
    heading = np.interp(s, path.start + path.step * np.arange(len(path.heading)), path.heading)
    local = path.axes @ towards
    from_left = -local[0] * np.sin(heading) + local[1] * np.cos(heading) > 0
    first, last = inside.argmax(axis=1), columns - 1 - inside[:, ::-1].argmax(axis=1)
    # Lateral offsets grow to the left.
    edge = np.clip(np.where(from_left, first + width, last - width), 0, columns - 1)
    column = np.arange(columns)[None]
    border = np.where(from_left[:, None], column < edge[:, None], column > edge[:, None])
    return plane & (~border | plane[np.arange(rows), edge][:, None])


def _standing(chart: StreetChart, surfels: Surfels, height: float) -> Surfels:
    street = chart.ground.path.to_street(surfels.means.detach().double().numpy())
    over = chart.ground.over(street)
    return surfels.select(torch.from_numpy(over > height))


def _look_for_sun(
    chart: StreetChart, footprint: NDArray[np.bool_] | None, cameras: Sequence[Camera], casters: Surfels
) -> Sun | None:  # fmt: skip
    step = max(1, round(COARSE_M / chart.texel))
    per_m = 1.0 / chart.texel
    observed = _telling(chart, footprint, cameras, CONTACT_M)
    _, lit = lateral_profile(chart.color, observed, window=int(LEVEL_M * per_m), hop=int(LEVEL_M / 3 * per_m))
    fall = np.log(np.maximum(lit, 0.01)) - np.log(np.maximum(luminance(chart.color), 0.02))
    darkness = np.clip(fall, 0, DARKEST_FALL)
    weight = cv2.blur(observed.astype(np.float32), (step, step))
    mean = cv2.blur(np.where(observed, darkness, 0).astype(np.float32), (step, step)) / np.maximum(weight, 1e-6)

    cells = np.s_[step // 2 :: step, step // 2 :: step]
    s, t = (along[step // 2 :: step] for along in chart.coordinates())
    if min(len(s), len(t)) < 2:
        return None
    means = casters.means.detach().double().numpy()
    known = weight[cells] > 0.5
    return find_sun(mean[cells].astype(np.float32), known, s, t, chart.ground, means)


def _telling(
    chart: StreetChart, footprint: NDArray[np.bool_] | None, cameras: Sequence[Camera], contact_m: float
) -> NDArray[np.bool_]:
    """(A, B) texels whose light tells where the sun stands."""
    observed = chart.source == OBSERVED
    if footprint is not None:
        # Beside an object it is dark wherever the sun stands.
        observed &= ~cv2.dilate(footprint.astype(np.uint8), disc(contact_m / chart.texel)).astype(bool)
    if cameras:
        # Far ahead a pixel is a stretch of street, and a little height a great distance.
        way = chart.ground.path.to_street(np.stack([c.centre for c in cameras]))[:, 0]
        s, reach = chart.coordinates()[0], AHEAD_M
        observed &= ((s >= way.min() - reach) & (s <= way.max() + reach))[:, None]
    return observed


def _cast(points: NDArray[np.float64], casters: Surfels, towards: NDArray[np.float64]) -> NDArray[np.bool_]:
    return cast_shadows(points, casters, towards, cell=0.06, bias=0.15)


def _light_seen(
    chart: StreetChart, observed: NDArray[np.bool_], casters: Surfels, sun: Sun
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """World points (P, 3) of the ground that was ``observed`` (A, B), and whether it is dark there (P,)."""
    per_m = 1.0 / chart.texel
    rows, columns = np.nonzero(observed)

    def profile(color: NDArray[np.float32], usable: NDArray[np.bool_]) -> NDArray[np.float32]:
        return lateral_profile(color, usable, window=int(BORDER_M * per_m), hop=int(0.8 * BORDER_M * per_m))[0]

    expected = np.zeros_like(observed)
    expected[rows, columns] = _cast(chart.world(rows, columns), casters, sun.towards)
    # What is dark must not depend on where the sun was thought to be.
    dark = read_shade(chart.color, observed, expected, profile, texels_per_m=per_m, belief=0.0).dark
    step = max(1, round(CLOSER_M * per_m))
    some = (rows % step == 0) & (columns % step == 0)
    return chart.world(rows[some], columns[some]), dark[rows[some], columns[some]]


def _looked_again(
    places: NDArray[np.float64], is_dark: NDArray[np.bool_], casters: Surfels, trees: Surfels, plants: Sequence[int],
    sun: Sun, up: NDArray[np.float64],
) -> Sun:  # fmt: skip
    """The sun to a degree or two: of the directions around it the one whose shadows overlap most with what is dark.

    A few degrees move the shadow of a roof by half a metre, and with it the border between light and dark over a whole kerb.
    Trees count half: only one side of a crown is seen, and the overlap is taken once with them and once without, away from them.
    """
    if is_dark.sum() < 100:
        return sun
    # Large surfels reach beyond the outline of what they are part of.
    casters = casters.select(casters.log_scales.detach().exp().amax(dim=1) < LARGEST_M)
    hard = casters.select(torch.from_numpy(~np.isin(casters.labels.numpy(), list(plants))))
    under = _cast(places, trees, sun.towards)
    away = np.ones(len(places), dtype=bool)
    if under.any():
        away = cKDTree(places[under]).query(places, distance_upper_bound=TREE_M)[0] > TREE_M
    parts = [(places, is_dark, casters)]
    if is_dark[away].sum() >= 100:
        parts.append((places[away], is_dark[away], hard))

    def overlap(azimuth: float, elevation: float) -> float:
        total = 0.0
        for at, dark, part in parts:
            shaded = _cast(at, part, sun_towards(azimuth, elevation, up))
            total += float((shaded & dark).sum()) / max(1, int((shaded | dark).sum()))
        return total

    best = (-1.0, sun.azimuth, sun.elevation)
    for reach, degrees in AGAIN:
        _, a0, e0 = best
        around = np.arange(-reach, reach + 0.01, degrees)
        tried = [(a0 + da, float(np.clip(e0 + de, 8.0, 80.0))) for da in around for de in around]
        best = max(best, max((overlap(a, e), a, e) for a, e in tried))
    _, azimuth, elevation = best
    return Sun(sun_towards(azimuth, elevation, up), sun.score, azimuth % 360, elevation)
