"""What a house usually shows at a height: plinth, plaster, the band over the shop windows.

Behind a row of parked cars the foot of a house is seen between two of them, or beside a door, and is much the same all along.
"""

from __future__ import annotations

import numpy as np

from unveil_core.base.types import Float32, Mask
from unveil_core.inpaint.facade.plaster import DARKEST, unlike_plaster

__all__ = ["PLINTH_M", "usual_colors"]

AROUND_M, HOP_M = 8.0, 0.5
"""Distance along the street within which a house tells what it shows at a height, a house's width, and between the places that
are asked, metres."""
LEAST_M = 0.6
"""Length that must be seen of a height, metres: less may be a door, or what stands before the wall."""
SAME_PLASTER = 0.15
"""Difference of the plasters' colours, as a share of their brightness, up to which two places are taken for one house."""
PLINTH_M = 0.8
"""Height up to which a house may have a plinth, metres."""


def usual_colors(color: Float32, known: Mask, wall: Float32, texels_per_m: float) -> tuple[Float32, Mask]:
    """The median colour of each height on the house that stands at a place.

    Args:
        color: (A, B, 3) of a facade, rows along the street; known: (A, B) texels that were seen; wall: (A, 3) the plaster's
            colour.
    Returns:
        (A, B, 3) the colours, and (A, B) where enough of a height was seen.
    """
    hop, around = (max(1, round(m * texels_per_m)) for m in (HOP_M, AROUND_M))
    step = max(1, hop // 4)
    usual, told = np.zeros_like(color), np.zeros_like(known)
    for first in range(0, len(color), hop):
        here = np.s_[first : first + hop]
        near = np.s_[max(0, first - around) : first + hop + around : step]
        own = wall[min(first + hop // 2, len(wall) - 1)]
        same = np.abs(wall[near] - own).max(axis=1) < SAME_PLASTER * max(float(own.mean()), DARKEST)
        part, seen = color[near], known[near]
        enough = (seen & same[:, None]).sum(axis=0) * step >= LEAST_M * texels_per_m
        for height in np.flatnonzero(enough):
            usual[here, height] = np.median(part[seen[:, height] & same, height], axis=0)
        told[here] = enough
        # Or else a plinth like its neighbours'.
        of_neighbours = ~enough & (seen.sum(axis=0) * step >= LEAST_M * texels_per_m)
        for height in np.flatnonzero(of_neighbours[: round(PLINTH_M * texels_per_m)]):
            there = seen[:, height]
            shown, plaster = np.median(part[there, height], axis=0), np.median(wall[near][there], axis=0)
            if unlike_plaster(shown, plaster):
                usual[here, height], told[here, height] = shown, True
    return usual, told
