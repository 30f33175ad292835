"""The sky of a photograph: smooth, bright, over the horizon, and never hit by a LiDAR."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask
from unveil_core.semantics.visibility import PointsInView

__all__ = ["find_sky"]

STEP = 14
"""Steps of brightness, of 255, over a few pixels, that bound a smooth patch: clouds have lower ones, roofs mostly higher ones."""
HIT_SHARE = 0.004
"""A patch of which a larger share of the pixels was hit by points is a wall."""
LEAST_SHARE = 0.0005
"""Patches that cover less of the picture are no evidence."""


def find_sky(image: NDArray[np.uint8], above: Mask, seen: PointsInView, objects: Mask) -> Float32:
    """(H, W) where the sky surely is, 1, else 0.

    Args:
        image: (H, W, 3) uint8; above: (H, W) over the horizon.
        seen: points of what stays; objects: (H, W) pixels of removable objects.
    """
    soft = cv2.GaussianBlur(image, (5, 5), 0)
    edge = cv2.morphologyEx(soft, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)).max(axis=2)
    smooth = (edge < STEP) & above & ~objects
    count, patch, stats, _ = cv2.connectedComponentsWithStats(smooth.astype(np.uint8), connectivity=4)
    hits = np.bincount(patch[seen.rows, seen.columns], minlength=count)
    area = stats[:, cv2.CC_STAT_AREA]
    bright = np.bincount(patch.ravel(), soft.max(axis=2).ravel(), minlength=count) / np.maximum(area, 1)
    blue = np.bincount(patch.ravel(), (soft[..., 2].astype(float) - soft[..., 0]).ravel(), minlength=count)
    blue /= np.maximum(area, 1)
    free = (area >= LEAST_SHARE * smooth.size) & (hits <= HIT_SHARE * area)
    free[0] = False
    if not free.any():
        return np.zeros(smooth.shape, np.float32)
    # The sky is the largest of the patches that no point hit and that reach the highest; others must look like it.
    top = stats[:, cv2.CC_STAT_TOP]
    first = int(np.argmax(np.where(free & (top <= top[free].min() + 2), area, 0)))
    alike = free & (bright > bright[first] - 45) & (blue > blue[first] - 30)
    alike[first] = True
    return alike[patch].astype(np.float32)
