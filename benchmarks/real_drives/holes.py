"""Holes for a chart: footprints of its removed objects, pasted where the street was seen."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask

__all__ = ["Hole", "HoleSet", "footprints_of", "hole_sets", "seen_well"]

SEEN = 0.97
"""Share of a hole that must have been seen well."""
NEAREST_M = 12.0
"""Distance from which a truth was seen at most, metres: farther off a pixel of 768 across is many texels long."""
AWAY_M = 1.0
"""Distance of a truth from what really stands there, metres: beyond the dark under it."""
LEAST_M2 = 1.0
"""Area of the smallest footprint that is pasted, square metres: a bicycle."""
MOST_M2 = 14.0
"""Area of the largest one, square metres: a van."""
MARGIN_M = 0.25
"""Width around a footprint that no frame shows either, metres: the border of the masks."""
APART_M = 1.5
"""Width of seen street that is left between the holes of a set, metres."""
MOST_SHARE = 0.12
"""Share of what is seen well that one set may hide: what a row of parked cars hides of a street besides what they really hide."""
MOST_SETS = 16
"""Sets of a chart: each is a fill of 7 seconds, and a street that has room for two holes at a time has few places for them."""
TRIES = 4000
"""Places that are tried for a set: enough that hardly any would fit in any more."""


@dataclass(frozen=True)
class Hole:
    """A hole.

    Attributes:
        number: in its set, from 1; row, column: of its middle, texels.
    """

    number: int
    row: int
    column: int


@dataclass(frozen=True, eq=False)
class HoleSet:
    """Holes that are filled at once.

    Attributes:
        holes: (A, B) uint16 number of the hole; footprint: (A, B) what stood there; listed: the holes.
    """

    holes: NDArray[np.uint16]
    footprint: Mask
    listed: tuple[Hole, ...]


def footprints_of(objects: NDArray[np.uint16], texel: float) -> list[Mask]:
    """The footprints of a chart's objects, cropped, of usual sizes; where there are none, that of a car.

    Args:
        objects: (A, B) numbers of the objects, 0 = none; texel: its side, metres.
    """
    found = []
    for number in np.unique(objects[objects > 0]):
        rows, columns = np.nonzero(objects == number)
        stands = objects[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] == number
        if LEAST_M2 <= stands.sum() * texel**2 <= MOST_M2:
            found.append(np.asarray(stands))
    return found or [np.ones((round(4.4 / texel), round(1.8 / texel)), dtype=bool)]


def seen_well(source: NDArray[np.uint8], nearest: Float32, objects: NDArray[np.uint16], texel: float) -> Mask:
    """(A, B) texels whose colour is a truth: seen from near, and away from what really stands there."""
    away = cv2.distanceTransform((objects == 0).astype(np.uint8), cv2.DIST_L2, 5) * texel >= AWAY_M
    found: Mask = (source == 1) & (nearest <= NEAREST_M) & away
    return found


def hole_sets(good: Mask, stamps: list[Mask], *, count: int, texel: float, seed: int = 0) -> list[HoleSet]:
    """Sets of holes over texels that were seen well, as many holes in all as wanted, or as there is room for in so many sets.

    Args:
        good: (A, B), see :func:`seen_well`; stamps: footprints that are pasted, mirrored at will.
        count: holes in all sets; seed: of where they are.
    """
    random = np.random.default_rng(seed)
    margin, gap = round(MARGIN_M / texel), round(APART_M / texel)
    rows, columns = np.nonzero(good)
    sets: list[HoleSet] = []
    done = 0
    while done < count and len(sets) < MOST_SETS and len(rows):
        holes, footprint = np.zeros(good.shape, np.uint16), np.zeros(good.shape, dtype=bool)
        taken, hidden = np.zeros(good.shape, dtype=bool), 0
        listed: list[Hole] = []
        for at in random.integers(0, len(rows), TRIES):
            stamp = stamps[int(random.integers(len(stamps)))]
            stamp = np.pad(stamp[:: 1 - 2 * int(random.integers(2)), :: 1 - 2 * int(random.integers(2))], margin)
            hole = cv2.dilate(stamp.astype(np.uint8), np.ones((2 * margin + 1,) * 2, np.uint8)).astype(bool)
            top, left = int(rows[at]) - hole.shape[0] // 2, int(columns[at]) - hole.shape[1] // 2
            if top < 0 or left < 0 or top + hole.shape[0] > good.shape[0] or left + hole.shape[1] > good.shape[1]:
                continue
            there = slice(top, top + hole.shape[0]), slice(left, left + hole.shape[1])
            area = int(hole.sum())
            if taken[there][hole].any() or good[there][hole].mean() < SEEN:
                continue
            if hidden + area > MOST_SHARE * len(rows) and listed:
                break
            listed.append(Hole(len(listed) + 1, int(rows[at]), int(columns[at])))
            holes[there][hole] = len(listed)
            footprint[there] |= stamp
            around = tuple(slice(max(0, s.start - gap), s.stop + gap) for s in there)
            taken[around] = True
            hidden += area
            if done + len(listed) >= count:
                break
        if not listed:
            break
        sets.append(HoleSet(holes, footprint, tuple(listed)))
        done += len(listed)
    return sets
