"""The sun of a chart: looked for by the darkness of the ground, refined by what lies in shade, and believed by its borders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.parallel import each
from unveil_core.base.srgb import linear_light
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import grow, luminance, masked_blur
from unveil_core.inpaint.chart.lateral_profile import lateral_profile
from unveil_core.inpaint.chart.street_chart import OBSERVED, StreetChart
from unveil_core.inpaint.light.casters import Casters
from unveil_core.inpaint.light.darkness import (
    LEAST_LIGHT,
    coarse,
    in_the_dark,
    level_by_label,
    level_by_offset,
    log_light,
)
from unveil_core.inpaint.light.shade import CONTACT_M, read_shade
from unveil_core.inpaint.light.shadow_map import Discs, in_shadow
from unveil_core.inpaint.light.sun import ELEVATION_LIMITS, Darkness, Sun, find_suns, sun_towards
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["Evidence", "sun_by_shadows"]

COARSE_M = 0.2
"""Cells of the grid that the sun is first looked for on, metres: the shadows of roofs and trees, not of posts."""
DARKEST_FALL = 1.5
"""Fall of log luminance at which darkness is clipped, with a fifth of the light left, so that tar and wet spots do not outweigh
shadows."""
AHEAD_M = 10.0
"""Distance beyond both ends of the drive up to which the ground is used to find the sun, metres: farther on, a pixel covers
metres of street. Chosen on the two sample streets."""
BORDER_M, CLOSER_M = 5.0, 0.12
"""Half length of the stretch for the medians, and spacing of the samples, where the direction is refined, metres: there the
borders of shadows count. Chosen on the two sample streets."""
LEAST_AGREEMENT = 0.33
"""Correlation of what is dark with the shadows of the refined sun from which on there is one. Of eleven drawn streets on which it
was found to six degrees it is 0.37, where houses shade three quarters of the ground, and 0.58 to 0.88; of two on which something
else was found 0.27 and 0.30."""
REFINEMENTS = ((6.0, 2.0), (1.5, 0.75))
"""Passes of the refinement: reach around the best direction so far, and step, degrees. The first search is right to a few
degrees."""
BORDER_SCALE_M, LEAST_WORTH = 0.5, 0.05
"""Distance to the border of the shade over which what a place tells falls to a third, metres, and what it tells at least. On
twelve drawn streets the sun is found to 1.5 degrees on the mean, with all places alike to 2.5; on the worst, of which little shade
is seen, to 5 and 7 in two runs instead of 14. Half and twice the distance find it as well on most, and the worst to 10 and 6."""
MARGINS_M = (0.0, 0.1, 0.2)
"""By how much drawn shadows are taken to reach too far on all sides, metres; for each direction that counts which agrees best.
Surfels reach beyond the surfaces they stand for, and half of the penumbra is read as lit. Taken for the sun's doing, this turned
it by 4 degrees on a sample street and shortened the shadows of roofs by 0.3 m."""
AROUND = 8
"""Points around each place that must be in shadow, too, for the place to be in it by more than a margin."""
MOST_PLACES = 20_000
"""Places by which the direction is refined, evenly taken from all: the time of a search."""
LEAST_DARK = 100
"""Fewest dark samples by which a direction is believed, 1.4 square metres: for one black spot some direction is always found, as
on an overcast drawn street, which had 78. Fourteen sunny ones have 450 and more."""
BESIDE_M = (0.15, 0.6)
"""Distances from the border of the shade between which the light on either side of it is compared, metres: off the penumbra, and
on the same asphalt."""
MOST_LIGHT = 0.46
"""Light inside of the shade's border, as a share of that outside, which half of all the borders must fall below for the sun to
shine. In the sun shade has 0.17 to 0.33; asphalt of two ages has 0.6 to 1. The median is 0.08 to 0.4 on twelve sunny streets,
0.68 to 1 on six overcast ones and at dusk, 0.81 on a real one under thin cloud; one overcast street has 0.13, but no direction."""
LEAST_BESIDE = 0.1
"""Share of what surrounds a piece of border that must have been seen on either side."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """The observed ground by whose light and shade the sun is found.

    Attributes:
        chart: as read; footprint: (A, B) texels that removed objects stand on, None = unknown; cameras: of the drive.
    """

    chart: StreetChart
    footprint: NDArray[np.bool_] | None = None
    cameras: Sequence[Camera] = ()

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

    def dark(self, observed: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(A, B) of the ``observed`` ground (A, B), see :meth:`mask`, what lies in shade, wherever the sun stands."""
        chart, per_m = self.chart, 1.0 / self.chart.texel

        def profile(color: NDArray[np.float32], usable: NDArray[np.bool_]) -> NDArray[np.float32]:
            return lateral_profile(color, usable, window=int(BORDER_M * per_m), hop=int(0.8 * BORDER_M * per_m))[0]

        start = in_the_dark(chart, observed)
        return read_shade(chart.color, observed, start, profile, texels_per_m=per_m, belief=0.0).dark

    def light_seen(
        self, observed: NDArray[np.bool_], dark: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """World points (P, 3) on the ``observed`` ground (A, B), and whether it is ``dark`` there (P,)."""
        rows, columns = np.nonzero(observed)
        step = max(1, round(CLOSER_M / self.chart.texel))
        some = (rows % step == 0) & (columns % step == 0)
        return self.chart.world(rows[some], columns[some]), dark[rows[some], columns[some]]

    def light_at_borders(self, observed: NDArray[np.bool_], dark: NDArray[np.bool_]) -> float:
        """Light right inside the borders of what is ``dark`` (A, B), as a share of that right outside: the median over all
        borders on the ``observed`` ground (A, B), 1 where there are none."""
        per_m = 1.0 / self.chart.texel
        from_border = [cv2.distanceTransform(m.astype(np.uint8), cv2.DIST_L2, 5) for m in (dark, ~dark)]
        near, far = (m * per_m for m in BESIDE_M)
        beside = [
            observed & side & (distance > near) & (distance < far)
            for side, distance in zip((dark, ~dark), from_border, strict=True)
        ]
        level = luminance(linear_light(self.chart.color))
        inside, outside = (masked_blur(level, m, far / 2) for m in beside)
        weights = [cv2.GaussianBlur(m.astype(np.float32), (0, 0), far / 2) for m in beside]
        border = (from_border[0] > 0) & (from_border[0] < 1.5) & (np.minimum(*weights) > LEAST_BESIDE)
        if not border.any():
            return 1.0
        return float(np.median(inside[border] / np.maximum(outside[border], LEAST_LIGHT)))


def sun_by_shadows(evidence: Evidence, casters: Casters) -> Sun | None:
    """The sun; None where there is none, or it cannot be told."""
    observed = evidence.mask(CONTACT_M)
    dark = evidence.dark(observed)
    if evidence.light_at_borders(observed, dark) >= MOST_LIGHT:
        return None
    places, is_dark = evidence.light_seen(observed, dark)
    if is_dark.sum() < LEAST_DARK:
        return None
    everything = concatenate([casters.kept, casters.gone])
    suns = _coarse_suns(evidence.chart, observed, everything)
    if not suns:
        return None
    some = slice(None, None, -(-len(places) // MOST_PLACES))
    places, is_dark = places[some], is_dark[some]
    probes = _with_margins(places, evidence.chart.ground.path.axes)
    return _refined_sun(probes, is_dark, _worth(places, is_dark), Discs.of(everything), suns)


def _with_margins(places: NDArray[np.float64], axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(1 + M * K, P, 3) the places (P, 3), and for each margin but the first the points around them, in the horizontal plane of
    the ``axes`` (3, 3)."""
    angles = 2 * np.pi * np.arange(AROUND) / AROUND
    ring = np.cos(angles)[:, None] * axes[0] + np.sin(angles)[:, None] * axes[1]
    steps = np.concatenate([np.zeros((1, 3)), *(margin * ring for margin in MARGINS_M[1:])])
    return places + steps[:, None]


def _coarse_suns(chart: StreetChart, observed: NDArray[np.bool_], casters: Surfels) -> list[Sun]:
    """Where the sun may stand, to a few degrees, the likeliest first, by cast shadows and the darkness of ``observed`` ground."""
    step = max(1, round(COARSE_M / chart.texel))
    log = log_light(chart.color)
    levels = [level(chart, observed) for level in (level_by_offset, level_by_label)]
    falls = [np.clip(np.log(np.maximum(np.nan_to_num(p, nan=0.0), LEAST_LIGHT)) - log, 0, DARKEST_FALL) for p in levels]
    (by_offset, known), (by_label, _) = (coarse(fall, observed, step) for fall in falls)
    cells = np.s_[step // 2 :: step, step // 2 :: step]
    s, t = (along[step // 2 :: step] for along in chart.coordinates())
    if min(len(s), len(t)) < 2:
        return []
    means = casters.means.detach().double().numpy()
    offset = np.broadcast_to(np.arange(len(t)), by_offset.shape)
    measures = (Darkness(by_offset, offset), Darkness(by_label, chart.label[cells].astype(np.int64)))
    return find_suns(measures, known, s, t, chart.ground, means)


def _worth(places: NDArray[np.float64], is_dark: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(P,) what each of the ``places`` (P, 3) tells of the sun, ``is_dark`` (P,) or not: the more, the nearer the other is. Deep in
    the shade of a house it is dark wherever the sun stands, within 20 degrees."""
    apart = np.empty(len(places))
    for kind in (is_dark, ~is_dark):
        apart[kind] = cKDTree(places[~kind]).query(places[kind])[0] if not kind.all() else np.inf
    return np.exp(-apart / BORDER_SCALE_M) + LEAST_WORTH


def _refined_sun(
    probes: NDArray[np.float64],
    is_dark: NDArray[np.bool_],
    worth: NDArray[np.float64],
    casters: Discs,
    suns: Sequence[Sun],
) -> Sun | None:
    """The sun to a degree or two: of the directions around the candidates the one whose shadows agree best with what is dark;
    None where those of none do.

    A few degrees move the shadow of a roof by half a metre, and with it the border between light and dark over a whole kerb.

    Args:
        probes: (1 + M * K, P, 3) places on the ground and points around them, see :func:`_with_margins`.
        is_dark: (P,) whether it is dark there; worth: (P,) what that tells, see :func:`_worth`.
        suns: the likeliest first, one at least.
    """

    def agreement(azimuth: float, elevation: float, weights: NDArray[np.float64] = worth) -> float:
        shaded = in_shadow(probes.reshape(-1, 3), casters, sun_towards(azimuth, elevation)).reshape(probes.shape[:2])
        # In shadow by a margin is what is so by all smaller ones, too.
        within = np.logical_and.accumulate(shaded)[::AROUND]
        return max(_correlation(shadow, is_dark, weights) for shadow in within)

    found = []
    for sun in suns:
        best = (agreement(sun.azimuth, sun.elevation), sun.azimuth, sun.elevation)
        for reach, degrees in REFINEMENTS:
            _, a0, e0 = best
            around = np.arange(-reach, reach + 0.01, degrees)
            tried = [(a0 + da, float(np.clip(e0 + de, *ELEVATION_LIMITS))) for da in around for de in around]
            agreed = each(lambda direction: agreement(*direction), tried)
            best = max(best, max((much, a, e) for much, (a, e) in zip(agreed, tried, strict=True)))
        found.append((*best, sun.score))
    _, azimuth, elevation, score = max(found)
    if agreement(azimuth, elevation, np.ones(len(is_dark))) < LEAST_AGREEMENT:
        return None
    return Sun(sun_towards(azimuth, elevation), score, azimuth % 360, elevation)


def _correlation(a: NDArray[np.bool_], b: NDArray[np.bool_], weights: NDArray[np.float64]) -> float:
    """Of two masks (P,), weighted by (P,); -1 where one is the same everywhere."""
    share = weights / weights.sum()
    one, other = (values - float(share @ values) for values in (a, b))
    spread = float(np.sqrt((share @ one**2) * (share @ other**2)))
    return float(share @ (one * other)) / spread if spread > 1e-9 else -1.0
