"""The sun and the shadows that the scene casts on the chart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import disc, grow, luminance, masked_blur
from unveil_core.inpaint.chart.lateral_profile import lateral_profile
from unveil_core.inpaint.chart.street_chart import OBSERVED, StreetChart
from unveil_core.inpaint.light.crowns import complete_crowns
from unveil_core.inpaint.light.houses import flush_with_facades, solid_columns
from unveil_core.inpaint.light.shade import CONTACT_M, Light, read_shade
from unveil_core.inpaint.light.shadow_map import in_shadow
from unveil_core.inpaint.light.sun import ELEVATION_LIMITS, Sun, find_sun, sun_towards
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["light_of_scene", "lit_at_sunny_walls", "sun_of_scene"]

COARSE_M = 0.2
"""Cells of the grid that the sun is first looked for on, metres: the shadows of roofs and trees, not of posts."""
LEVEL_M = 12.0
"""Half length of the stretch whose bright texels give the sunlit level of a lateral offset, metres: longer than the shadow of a
house along the street. Chosen on the two sample streets."""
DARKEST_FALL = 0.7
"""Fall of log luminance at which darkness is clipped (half the light), so that tar and wet spots do not outweigh shadows."""
AHEAD_M = 10.0
"""Distance beyond both ends of the drive up to which the ground is used to find the sun, metres: farther on, a pixel covers
metres of street. Chosen on the two sample streets."""
CHINK_M = 0.25
"""Radius of lit gaps that are filled in cast shadows, metres: surfels leave holes that a wall has not."""
BORDER_M, CLOSER_M = 5.0, 0.12
"""Half length of the stretch for the medians, and spacing of the samples, where the direction is refined, metres: there the
borders of shadows count. Chosen on the two sample streets."""
REFINEMENTS = ((6.0, 2.0), (1.5, 0.75))
"""Passes of the refinement: reach around the best direction so far, and step, degrees. The first search is right to a few
degrees."""
LEAST_DARK = 100
"""Fewest dark samples that the direction is refined by."""
LARGEST_M = 0.25
"""Standard deviation from which on a surfel is left out of the refinement, metres: larger ones blur an outline."""
TREE_M = 1.0
"""Distance from a tree's shadow within which samples are left out where trees are, metres: only one side of a crown was seen."""
AT_FOOT_M = 0.6
"""Width of the ground at the foot of a wall that the wall cannot shade itself, metres: there its cast shadow is the roughness of
its surfels."""
BESIDE_M = (0.15, 0.6)
"""Distances from the border of the shade between which the light on either side of it is compared, metres: off the penumbra, and
on the same asphalt."""
MOST_LIGHT = 0.7
"""Brightness inside of the shade's border, as a share of that outside, which half of all the borders must fall below for the sun to
count as found. In the sun shade has 0.45 to 0.6; asphalt of two ages that happens to lie like the shadows of a wrong sun has 0.8 to
1. Measured on three sunny streets and a real one under thin cloud."""
LEAST_BESIDE = 0.1
"""Share of what surrounds a piece of border that must have been seen on either side."""
STANDS_M = 0.25
"""Height over the ground above which surfels cast shadows, metres: kerbs and the ground's own noise are lower."""
MAP_CELL_M, MAP_BIAS_M = 0.06, 0.15
"""Pixel of the shadow map, and how much nearer to the sun a caster must be than what it shades, metres: a texel and a half, and
the noise of the ground's surfels."""


@dataclass(frozen=True, eq=False)
class _Evidence:
    """The observed ground by whose light and shade the sun is found; see :func:`light_of_scene`."""

    chart: StreetChart
    footprint: NDArray[np.bool_] | None
    cameras: Sequence[Camera]

    def mask(self, contact_m: float) -> NDArray[np.bool_]:
        """(A, B) observed texels near the drive, farther than ``contact_m`` from removed objects, beside which it is dark wherever
        the sun stands."""
        chart = self.chart
        observed = chart.source == OBSERVED
        if self.footprint is not None:
            observed &= ~grow(self.footprint, contact_m / chart.texel)
        if self.cameras:
            # Far ahead a pixel is a stretch of street, and a little height a great distance.
            way = chart.ground.path.to_street(np.stack([c.centre for c in self.cameras]))[:, 0]
            s, reach = chart.coordinates()[0], AHEAD_M
            observed &= ((s >= way.min() - reach) & (s <= way.max() + reach))[:, None]
        return observed

    def dark(self, contact_m: float, casters: Surfels, sun: Sun) -> NDArray[np.bool_]:
        """(A, B) ground of the :meth:`mask` that lies in shade, if that is where the sun casts the casters' shadows mostly."""
        chart, observed = self.chart, self.mask(contact_m)
        per_m = 1.0 / chart.texel
        rows, columns = np.nonzero(observed)

        def profile(color: NDArray[np.float32], usable: NDArray[np.bool_]) -> NDArray[np.float32]:
            return lateral_profile(color, usable, window=int(BORDER_M * per_m), hop=int(0.8 * BORDER_M * per_m))[0]

        expected = np.zeros_like(observed)
        expected[rows, columns] = _in_shadow(chart.world(rows, columns), casters, sun.towards)
        # What is dark must not depend on where the sun was thought to be.
        return read_shade(chart.color, observed, expected, profile, texels_per_m=per_m, belief=0.0).dark

    def light_seen(self, contact_m: float, casters: Surfels, sun: Sun) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """World points (P, 3) on the ground of the :meth:`mask`, and whether it is dark there (P,)."""
        rows, columns = np.nonzero(self.mask(contact_m))
        dark = self.dark(contact_m, casters, sun)
        step = max(1, round(CLOSER_M / self.chart.texel))
        some = (rows % step == 0) & (columns % step == 0)
        return self.chart.world(rows[some], columns[some]), dark[rows[some], columns[some]]

    def light_at_borders(self, dark: NDArray[np.bool_]) -> float:
        """Brightness right inside the borders of what is ``dark`` (A, B), as a share of that right outside: the median over all
        borders in sight, 1 where there are none."""
        observed = self.mask(CONTACT_M)
        per_m = 1.0 / self.chart.texel
        from_border = [cv2.distanceTransform(m.astype(np.uint8), cv2.DIST_L2, 5) for m in (dark, ~dark)]
        near, far = (m * per_m for m in BESIDE_M)
        beside = [
            observed & side & (distance > near) & (distance < far)
            for side, distance in zip((dark, ~dark), from_border, strict=True)
        ]
        level = luminance(self.chart.color)
        inside, outside = (masked_blur(level, m, far / 2) for m in beside)
        weights = [cv2.GaussianBlur(m.astype(np.float32), (0, 0), far / 2) for m in beside]
        border = (from_border[0] > 0) & (from_border[0] < 1.5) & (np.minimum(*weights) > LEAST_BESIDE)
        if not border.any():
            return 1.0
        return float(np.median(inside[border] / np.maximum(outside[border], 1e-3)))


def light_of_scene(
    chart: StreetChart,
    kept: Surfels,
    gone: Surfels,
    *,
    footprint: NDArray[np.bool_] | None = None,
    cameras: Sequence[Camera] = (),
    solid: Sequence[int] = (),
    plants: Sequence[int] = (),
    sun: Sun | None = None,
) -> Light | None:
    """Find the sun by its shadows, and cast those of what stays and of what is removed.

    Args:
        chart: as read.
        kept, gone: surfels of what stays and of what is removed.
        footprint: (A, B) texels that removed objects stand on; None = unknown.
        cameras: of the drive.
        solid: labels of what is solid down to the ground, as houses and walls, though their feet may be hidden.
        plants: labels of vegetation.
        sun: instead of looking for it.
    Returns:
        None where no sun explains the dark places.
    """
    casters = _Casters.of(chart, kept, gone, plants)
    evidence = _Evidence(chart, footprint, cameras)
    sun = sun or _find_sun(evidence, casters, plants)
    if sun is None:
        return None
    # Between two cars there is little else than what lies beside them.
    ground = evidence.light_seen(CONTACT_M / 4, casters.observed, sun)
    solid_ones = _with_solid_houses(evidence, casters.kept, casters.gone, solid, sun, ground)
    of_kept, of_gone = (_cast_on_chart(chart, surfels, sun) for surfels in (solid_ones, casters.gone))
    return Light(sun, of_kept, of_gone)


def sun_of_scene(
    chart: StreetChart,
    kept: Surfels,
    gone: Surfels,
    *,
    footprint: NDArray[np.bool_] | None = None,
    cameras: Sequence[Camera] = (),
    plants: Sequence[int] = (),
) -> Sun | None:
    """The sun by its shadows alone, see :func:`light_of_scene`."""
    return _find_sun(_Evidence(chart, footprint, cameras), _Casters.of(chart, kept, gone, plants), plants)


@dataclass(frozen=True, eq=False)
class _Casters:
    """What casts shadows: of what stays, with completed crowns, and of what is removed; the trees and their crowns among them; and
    all of it that was observed."""

    kept: Surfels
    gone: Surfels
    trees: Surfels
    observed: Surfels

    @staticmethod
    def of(chart: StreetChart, kept: Surfels, gone: Surfels, plants: Sequence[int]) -> _Casters:
        kept, gone = (_standing(chart, surfels, STANDS_M) for surfels in (kept, gone))
        trees = kept.select(torch.from_numpy(np.isin(kept.labels.numpy(), list(plants))))
        crowns = complete_crowns(trees, chart.ground)
        return _Casters(concatenate([kept, crowns]), gone, concatenate([trees, crowns]), concatenate([kept, gone]))


def _find_sun(evidence: _Evidence, casters: _Casters, plants: Sequence[int]) -> Sun | None:
    sun = _coarse_sun(evidence, concatenate([casters.kept, casters.gone]))
    if sun is None:
        return None
    # Only by what was observed: the far side of a crown is a guess, good enough to come near.
    places, is_dark = evidence.light_seen(CONTACT_M, casters.observed, sun)
    sun = _refined_sun(places, is_dark, casters.observed, casters.trees, plants, sun)
    dark = evidence.dark(CONTACT_M, casters.observed, sun)
    return sun if evidence.light_at_borders(dark) < MOST_LIGHT else None


def _with_solid_houses(
    evidence: _Evidence,
    kept: Surfels,
    gone: Surfels,
    solid: Sequence[int],
    sun: Sun,
    ground: tuple[NDArray[np.float64], NDArray[np.bool_]],
) -> Surfels:
    """What stays, with houses as solid columns, those beyond the drive's ends chosen by the shadows that were observed.

    Args:
        ground: world points (P, 3) and whether it is dark there (P,), see :meth:`_Evidence.light_seen`.
    """
    places, is_dark = ground
    kept = kept.select(torch.from_numpy(flush_with_facades(evidence.chart, kept, solid)))
    shaded = _in_shadow(places, concatenate([kept, gone]), sun.towards)

    def judge(added: Surfels) -> float | None:
        more = _in_shadow(places, added, sun.towards) & ~shaded
        # Of what only the added would darken, is more dark or light? Nothing added scores 0.
        return float(np.where(is_dark[more], 1.0, -1.0).sum()) if len(places) else None

    return concatenate([kept, solid_columns(evidence.chart, kept, solid, evidence.cameras, judge)])


def _cast_on_chart(chart: StreetChart, casters: Surfels, sun: Sun) -> NDArray[np.bool_]:
    """(A, B) ground in the shadow of the casters."""
    shape = chart.source.shape
    s, t = chart.coordinates()
    inside = chart.ground.inside(np.repeat(s, shape[1]), np.tile(t, shape[0])).reshape(shape)
    rows, columns = np.nonzero(inside)
    plane = np.zeros(shape, dtype=bool)
    plane[rows, columns] = _in_shadow(chart.world(rows, columns), casters, sun.towards)
    # No light comes through chinks, nor between a wall and the ground at its foot.
    chinks = disc(CHINK_M / chart.texel)
    plane = cv2.morphologyEx((plane | ~inside).astype(np.uint8), cv2.MORPH_CLOSE, chinks).astype(bool) & inside
    return lit_at_sunny_walls(chart, plane, inside, sun.towards, round(AT_FOOT_M / chart.texel))


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


def _coarse_sun(evidence: _Evidence, casters: Surfels) -> Sun | None:
    """The sun to a few degrees, by the correlation of cast shadows with the ground's darkness."""
    chart = evidence.chart
    step = max(1, round(COARSE_M / chart.texel))
    per_m = 1.0 / chart.texel
    observed = evidence.mask(CONTACT_M)
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


def _in_shadow(points: NDArray[np.float64], casters: Surfels, towards: NDArray[np.float64]) -> NDArray[np.bool_]:
    return in_shadow(points, casters, towards, cell=MAP_CELL_M, bias=MAP_BIAS_M)


def _refined_sun(
    places: NDArray[np.float64],
    is_dark: NDArray[np.bool_],
    casters: Surfels,
    trees: Surfels,
    plants: Sequence[int],
    sun: Sun,
) -> Sun:
    """The sun to a degree or two: of the directions around it the one whose shadows overlap most with what is dark.

    A few degrees move the shadow of a roof by half a metre, and with it the border between light and dark over a whole kerb.
    Trees count half: only one side of a crown is seen, and the overlap is taken once with them and once without, away from them.
    """
    if is_dark.sum() < LEAST_DARK:
        return sun
    # Large surfels reach beyond the outline of what they are part of.
    casters = casters.select(casters.log_scales.detach().exp().amax(dim=1) < LARGEST_M)
    hard = casters.select(torch.from_numpy(~np.isin(casters.labels.numpy(), list(plants))))
    under = _in_shadow(places, trees, sun.towards)
    away = np.ones(len(places), dtype=bool)
    if under.any():
        away = cKDTree(places[under]).query(places, distance_upper_bound=TREE_M)[0] > TREE_M
    parts = [(places, is_dark, casters)]
    if is_dark[away].sum() >= LEAST_DARK:
        parts.append((places[away], is_dark[away], hard))

    def overlap(azimuth: float, elevation: float) -> float:
        total = 0.0
        for at, dark, part in parts:
            shaded = _in_shadow(at, part, sun_towards(azimuth, elevation))
            total += float((shaded & dark).sum()) / max(1, int((shaded | dark).sum()))
        return total

    best = (-1.0, sun.azimuth, sun.elevation)
    for reach, degrees in REFINEMENTS:
        _, a0, e0 = best
        around = np.arange(-reach, reach + 0.01, degrees)
        tried = [(a0 + da, float(np.clip(e0 + de, *ELEVATION_LIMITS))) for da in around for de in around]
        best = max(best, max((overlap(a, e), a, e) for a, e in tried))
    _, azimuth, elevation = best
    return Sun(sun_towards(azimuth, elevation), sun.score, azimuth % 360, elevation)
