"""Where another frame shows what a frame shows: by the depth of the empty street in both."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.delivery.views import NEAREST_M, SAME_DEPTH, EmptyDepth

__all__ = ["positions_in", "shown_in"]

SKY_M = 1e5
"""Depth of what has no surface: a place so far off lies in the same direction for all cameras of a drive."""


def positions_in(here: EmptyDepth, there: EmptyDepth, wanted: Mask) -> Float32:
    """(H, W, 2) positions in frame ``there`` of what the pixels of frame ``here`` show; NaN where it does not show that.

    Args:
        wanted: (H, W) of ``there``: pixels that are asked for. What lies beside them is NaN, too.
    """
    found = np.full((*here.depth.shape, 2), np.nan, np.float32)
    rows, columns = np.nonzero(wanted)
    if not len(rows):
        return found
    depth = np.where(here.depth > 0, here.depth, SKY_M).astype(np.float64)
    points = here.camera.centre + depth[..., None] * here.camera.rays()
    index, pixels = shown_in(there, points.reshape(-1, 3), wanted)
    found.reshape(-1, 2)[index] = pixels
    return found


def shown_in(there: EmptyDepth, points: Float64, wanted: Mask) -> tuple[NDArray[np.int64], Float64]:
    """Which places a frame shows, itself and not what lies before them.

    Args:
        points: (N, 3); wanted: (H, W) of the frame: pixels that are asked for.
    Returns:
        which (M,), rising, and their positions (M, 2).
    """
    index, pixels, far = there.camera.shown(points, nearest=NEAREST_M)
    column, row = pixels.astype(np.int64).T
    # Near the border of what is wanted its colours still count: a sample mixes the pixels around it.
    around = cv2.dilate(wanted.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
    asked = around[row, column]
    index, pixels, far, row, column = index[asked], pixels[asked], far[asked], row[asked], column[asked]
    shown = np.where(there.depth > 0, there.depth, SKY_M).astype(np.float32)
    # On a road far off neighbouring pixels lie metres apart.
    spread = _spread(shown)[row, column]
    near = np.abs(shown[row, column] - far) < SAME_DEPTH * far + spread
    return index[near], pixels[near]


def _spread(depth: Float32) -> NDArray[np.float32]:
    """(H, W) how far the depths of a pixel's neighbours lie from each other, on one surface: an edge between two is no spread."""
    box = np.ones((3, 3), np.uint8)
    low, high = cv2.erode(depth, box), cv2.dilate(depth, box)
    return np.where(high < 1.25 * low, high - low, 0).astype(np.float32)
