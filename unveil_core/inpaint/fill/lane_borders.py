"""Where a lane ends: at a line along the street, whole or broken, or where the carriageway does."""

from __future__ import annotations

import cv2
import numpy as np

from unveil_core.base.types import Float32, Mask

__all__ = ["lane_borders"]

NEAR_M = 1.0
"""How far before and behind a row the street is looked at, metres: a border of labels is ragged by a decimetre or two."""
CONTRAST, KNOWN_SHARE = 0.1, 0.6
"""Difference of luma, in [0, 1], from the ground beside it, over the length of a dash, that makes one, and share of that length
that must be seen: as of other markings."""
DASH_M, WIDE_M, WINDOW_M = 0.8, 0.35, 15.0
"""Length over which dashes are read, width from which on paint is no dash, and how far before and behind a row they count, metres:
dashes are 1 to 6 m long, 0.1 to 0.15 m wide and 12 m apart at most; bars of crossings are 0.5 m wide."""
SHARE, LEAST, LEAST_ROAD_M = 0.12, 2, 4.0
"""Share of the street at a lateral offset that dashes cover, how many there are, and the length of street seen there, metres: 1.5 m
of paint in 12 m; the shaft of an arrow stands alone."""


def lane_borders(luma: Float32, known: Mask, road: Mask, line: Mask, row: int, *, texels_per_m: float) -> Mask:
    """(B,) columns that no lane covers at a row of the chart.

    Args:
        luma: (A, B) difference from the lateral offset's median; known: (A, B) where it can be trusted.
        road: (A, B) the carriageway; line: (A, B) lines along the street, as medians show them.
    """
    reach = round(NEAR_M * texels_per_m)
    near = slice(max(0, row - reach), row + reach)
    away = np.abs(np.arange(len(luma)) - row)
    rows = away < WINDOW_M * texels_per_m
    usable = known & (away > reach)[:, None]
    broken = _dashes(luma[rows], usable[rows], texels_per_m)
    return np.asarray((road[near].mean(axis=0) <= 0.5) | (line[near].mean(axis=0) > 0.5) | broken)


def _dashes(luma: Float32, known: Mask, per_m: float) -> Mask:
    """(B,) columns of lines of which a median shows the gaps."""
    size = (1, max(1, round(DASH_M * per_m)))
    many = cv2.blur(known.astype(np.float32), size)
    value = cv2.blur(np.where(known, luma, 0).astype(np.float32), size) / np.maximum(many, 1e-3)
    wide = cv2.morphologyEx(value, cv2.MORPH_OPEN, np.ones((1, round(WIDE_M * per_m)), np.uint8))
    sure = many > KNOWN_SHARE
    # A path strays by a texel or two from the line.
    dash = cv2.dilate((sure & (value - wide > CONTRAST)).astype(np.uint8), np.ones((1, 3), np.uint8)).astype(bool)
    length = sure.sum(axis=0)
    count = (np.diff(np.pad(dash, ((1, 0), (0, 0))).astype(np.int8), axis=0) == 1).sum(axis=0)
    enough = (count >= LEAST) & (length >= LEAST_ROAD_M * per_m)
    return np.asarray(enough & ((dash & sure).sum(axis=0) >= SHARE * length))
