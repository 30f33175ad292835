"""Short gaps of a facade, bridged along the street: plinths, sills and plaster go on behind a person or a bicycle.

Copying whole columns (:mod:`unveil_core.inpaint.facade.facade_fill`) draws a door into a plinth where the door's column looks alike
above; over a short way what is the same on both sides is the same between.
"""

from __future__ import annotations

import cv2
import numpy as np

from unveil_core.base.types import Float32, Mask
from unveil_core.inpaint.facade.plaster import DARKEST

__all__ = ["bridge_gaps"]

WIDE_M = 2.5
"""Longest piece of a facade that is bridged, metres: a bicycle along the wall, and its border. Of 21 facades of eleven streets ten
gain by it and one, of a square metre, loses; with 1.5 m the bicycle is lost."""
BESIDE_M = 0.2
"""Length on either side whose mean is a gap's colour there, metres."""
ALIKE = 0.25
"""Largest difference of the two sides, as a share of their mean brightness: over metres light changes. With 0.15 the plinth behind
a bicycle is not bridged."""


def bridge_gaps(color: Float32, known: Mask, wanted: Mask, texels_per_m: float) -> tuple[Float32, Mask]:
    """Interpolate along the street where both sides of a short gap are alike.

    Args:
        color: (A, B, 3) along the street, upwards; known: (A, B); wanted: (A, B) what is to be filled.
    Returns:
        (A, B, 3) the colours, with the bridges; (A, B) these.
    """
    result, bridged = color.copy(), np.zeros_like(wanted)
    narrow = _narrow(~known, WIDE_M * texels_per_m)
    wanted = wanted & narrow
    beside = max(1, round(BESIDE_M * texels_per_m))
    for height in np.flatnonzero(wanted.any(axis=0)):
        here, colors = known[:, height], color[:, height]
        edges = np.flatnonzero(np.diff(np.concatenate([[1], here.astype(np.int8), [1]])))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            if not narrow[first, height] or first == 0 or last == len(here):
                continue
            parts = np.s_[max(0, first - beside) : first], np.s_[last : last + beside]
            before, after = (colors[part][here[part]].mean(axis=0) for part in parts)
            if np.abs(before - after).max() > ALIKE * max(float((before + after).mean()) / 2, DARKEST):
                continue
            rows = first + np.flatnonzero(wanted[first:last, height])
            share = ((rows - first + 0.5) / (last - first))[:, None]
            result[rows, height] = before * (1 - share) + after * share
            bridged[rows, height] = True
    return result, bridged


def _narrow(gap: Mask, longest: float) -> Mask:
    """(A, B) the pieces of a mask that are nowhere longer along the street than ``longest`` texels."""
    _, piece, boxes, _ = cv2.connectedComponentsWithStats(gap.astype(np.uint8), connectivity=4)
    narrow: Mask = gap & (boxes[piece, cv2.CC_STAT_HEIGHT] <= longest)
    return narrow
