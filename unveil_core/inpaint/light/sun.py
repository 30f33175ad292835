"""The sun's direction, found by the shadows on the ground.

Every direction is tried: the shadows that the scene's surfels would cast from there are correlated with the darkness of the ground.
Paint, kerb and sidewalk differ in brightness whatever the sun does, so both are compared within what is alike only.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.parallel import in_parallel, thread_count
from unveil_core.base.types import Float64
from unveil_core.ground.street import Ground
from unveil_core.inpaint.light.sun_kernels import draw_fallen

__all__ = ["ELEVATION_LIMITS", "Darkness", "Sun", "find_suns", "given_sun", "sun_towards"]

LEAST_SCORE = 0.2
"""Correlation under which no direction explains the dark places: no shadows in sight. A street that houses shade for 40 m has 0.24;
overcast days are told by the borders of what is dark before."""
STANDS_M, HIGHEST_M = 0.3, 30.0
"""Heights over the ground between which surfels cast, metres: lower ones shade only themselves, of higher ones too little is seen.
Chosen on the two sample streets."""
MOST_CASTERS = 12_000
"""Surfels whose shadows are drawn for each of a few hundred directions, evenly taken from all: the time of a search."""
ELEVATION_LIMITS = (8.0, 80.0)
"""Elevations that are tried, degrees: lower, shadows are longer than the street is seen; higher, a shadow lies under its object,
and noon in the tropics is not found."""
SEARCH = ((10.0, 180.0, 30.0), (4.0, 8.0, 8.0), (1.5, 3.0, 3.0), (0.5, 1.0, 1.0))
"""Passes of the search, each around the best direction so far (first: due north, 45 degrees high): step, reach in azimuth and
reach in elevation, degrees. The last step is the sun's own width."""


CANDIDATES, APART = 4, 20.0
"""How many directions are found at most, and how far they are apart, degrees: with few objects two may explain the dark places
alike, until they are looked at closely."""


@dataclass(frozen=True, eq=False)
class Sun:
    """The direction of the sun.

    Attributes:
        towards: (3,) unit vector to the sun, in the drive's frame.
        score: correlation of its shadows with the dark ground, 1 where it was given.
        azimuth, elevation: degrees, see :func:`sun_towards`.
    """

    towards: Float64
    score: float
    azimuth: float
    elevation: float


def sun_towards(azimuth: float, elevation: float) -> Float64:
    """(3,) unit vector to a sun at an azimuth and elevation in degrees.

    Azimuth runs clockwise, seen from above, from the y axis, which is north where x is east. In a drive whose own y axis is up
    that is its -z axis.
    """
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.array([np.sin(a) * np.cos(e), np.cos(a) * np.cos(e), np.sin(e)])


def given_sun(azimuth: float, elevation: float) -> Sun:
    """The sun where its direction is known, degrees, see :func:`sun_towards`."""
    return Sun(sun_towards(azimuth, elevation), 1.0, azimuth, elevation)


@dataclass(frozen=True, eq=False)
class Darkness:
    """How dark the ground is on a coarse grid, by one measure.

    Attributes:
        fall: (A, B) of its logarithmic luminance below what it is in full light.
        alike: (A, B) int, a number for ground that is compared with one another.
    """

    fall: NDArray[np.float32]
    alike: NDArray[np.int64]


def find_suns(
    measures: Sequence[Darkness], known: NDArray[np.bool_], s: Float64, t: Float64, ground: Ground, casters: Float64
) -> list[Sun]:
    """The directions whose shadows lie where the ground is dark, by the mean of all measures of that.

    Args:
        measures: on the same grid; known: (A, B) where they count.
        s, t: (A,), (B,) street coordinates of the grid, evenly spaced.
        casters: (N, 3) world points of what stands on the ground.
    Returns:
        the best ones, apart from each other, the best first; none where no direction explains the dark places.
    """
    if known.sum() < 100 or len(casters) < 50:
        return []
    foot = ground.path.to_street(casters)
    height = foot[:, 2] - ground.height_at(foot[:, 0], foot[:, 1])
    high = (height > STANDS_M) & (height < HIGHEST_M)
    casters = casters[high]
    casters = np.ascontiguousarray(casters[:: max(1, len(casters) // MOST_CASTERS)] @ ground.path.axes.T)
    groups = [np.unique(m.alike[known], return_inverse=True)[1] for m in measures]
    wanted = [_centred(m.fall[known], group) for m, group in zip(measures, groups, strict=True)]
    scales = [_spread(w) for w in wanted]
    if min(scales) < 1e-4:
        return []

    def score(shadow: NDArray[np.float32]) -> float:
        total = 0.0
        for want, scale, group in zip(wanted, scales, groups, strict=True):
            found = _centred(shadow, group)
            spread = _spread(found)
            total += float((found * want).mean()) / (scale * spread) if spread > 1e-4 else -1.0
        return total / len(wanted)

    def tried(start: tuple[float, float, float], turn: tuple[float, float, float]) -> list[tuple[float, float, float]]:
        (_, a0, e0), (step, reach_a, reach_e) = start, turn
        directions = [
            (a, e)
            for a in np.arange(a0 - reach_a, a0 + reach_a + 0.1, step)
            for e in np.clip(np.arange(e0 - reach_e, e0 + reach_e + 0.1, step), *ELEVATION_LIMITS)
        ]
        shadows = _shadows(casters, [sun_towards(a, e) for a, e in directions], s, t, ground)
        return [(score(shadow[known]), a, e) for shadow, (a, e) in zip(shadows, directions, strict=True)]

    starts: list[tuple[float, float, float]] = []
    for first in sorted(tried((-1.0, 0.0, 45.0), SEARCH[0]), reverse=True):
        towards = sun_towards(*first[1:])
        if all(towards @ sun_towards(*start[1:]) < np.cos(np.radians(APART)) for start in starts):
            starts.append(first)
        if len(starts) == CANDIDATES:
            break
    found = []
    for best in starts:
        for turn in SEARCH[1:]:
            best = max(best, max(tried(best, turn)))
        if best[0] >= LEAST_SCORE:
            found.append(Sun(sun_towards(*best[1:]), best[0], float(best[1] % 360), float(best[2])))
    return sorted(found, key=lambda sun: -sun.score)


def _shadows(
    casters: Float64, suns: Sequence[Float64], s: Float64, t: Float64, ground: Ground
) -> Iterator[NDArray[np.float32]]:
    """For each direction to the sun (3,), where the rays through the casters (N, 3), east, north and up, meet the ground: (A, B)
    from 0 to 1."""
    path = ground.path
    way = (*path.lookup, path.nodes, path.heading, path.start, path.step)
    heights = (ground.s_start, ground.t_start, ground.s_cell, ground.t_cell, ground.height)
    grid = (s[0], t[0], s[1] - s[0])
    together = 2 * thread_count()  # planes of a long street are large
    for first in range(0, len(suns), together):
        lights = np.stack([path.axes @ towards for towards in suns[first : first + together]])
        planes = np.zeros((len(lights), len(s), len(t)), dtype=np.float32)
        in_parallel(draw_fallen, len(lights), 1, casters, lights, way, heights, grid, planes)
        for plane in planes:
            closed = cv2.morphologyEx(plane, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
            yield cv2.GaussianBlur(closed, (0, 0), 1.0)


def _centred(values: NDArray[np.float32], group: NDArray[np.int64]) -> NDArray[np.float64]:
    """Values (K,) less the mean of their group (K,)."""
    count = np.maximum(np.bincount(group), 1)
    return values - (np.bincount(group, weights=values) / count)[group]


def _spread(values: NDArray[np.float64]) -> float:
    return float(np.sqrt((values**2).mean()))
