"""Which frames are solved: sharp ones, a small motion apart, none of those in which the camera stands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from unveil_core.base.types import Float64
from unveil_core.solve.looks.motion import Motion
from unveil_core.solve.looks.thumbs import FLOW_PX

__all__ = ["Choice", "chosen_frames"]

APART_PX = 0.01 * FLOW_PX
"""Median motion between two frames that are solved. Smaller steps tell little of depth, larger ones lose features."""
FEWEST_CHOSEN = 40
"""Where the way is short, frames are solved at smaller steps, until there are so many."""
MOST_SKIPPED = 8
"""Frames between two that are solved."""
BLURRED = 0.4
"""A frame is blurred whose sharpness is below this share of that of its sharpest neighbours."""
NEAR = 4
"""Frames to either side that its sharpness is compared with."""


@dataclass(frozen=True, eq=False)
class Choice:
    """Attributes: frames: numbers of those that are solved, rising; standing, blurred: how many were left out for it."""

    frames: tuple[int, ...]
    standing: int
    blurred: int


def chosen_frames(motion: Motion, sharpness: Float64) -> Choice:
    """Choose the frames of one camera that are solved.

    Args:
        motion: between its N frames; sharpness: (N,).
    """
    count = len(sharpness)
    stands = np.concatenate([motion.stands, [False]])
    stands[-1] = count > 1 and bool(stands[-2])
    # The first frame of a stop, and the last, are kept: they are where the camera comes to and goes from.
    inside = stands & np.concatenate([[True], stands[:-1]]) if count > 1 else stands
    around = [sharpness[max(0, k - NEAR) : k + NEAR + 1].max() for k in range(count)]
    blurred = sharpness < BLURRED * np.array(around)
    total = float(motion.step[~motion.stands].sum())
    apart = min(APART_PX, total / FEWEST_CHOSEN)
    kept = [k for k in range(count) if not inside[k]] or [0]
    found, gone = [kept[0]], 0.0
    for before, k in zip(kept, kept[1:], strict=False):
        gone += float(motion.step[before:k].sum())
        if (gone >= apart and not blurred[k]) or k - found[-1] > MOST_SKIPPED:
            found.append(k)
            gone = 0.0
    if found[-1] != kept[-1]:
        found.append(kept[-1])
    sharp = _sharpest(found, sharpness, set(kept))
    return Choice(tuple(sharp), int(inside.sum()), int((blurred & ~inside).sum()))


def _sharpest(found: list[int], sharpness: Float64, allowed: set[int]) -> list[int]:
    """Each chosen frame, or the sharper one beside it where two frames lie between the chosen ones."""
    result = [found[0]]
    for k, place in enumerate(found[1:], start=1):
        low = (found[k - 1] + place) // 2 + 1
        high = place if k + 1 == len(found) else (place + found[k + 1]) // 2
        near = [
            i for i in range(max(low, result[-1] + 1), max(high, place) + 1) if i in allowed and abs(i - place) <= 1
        ]
        result.append(max(near, key=lambda i: (sharpness[i], -abs(i - place))) if near else place)
    return sorted(set(result))
