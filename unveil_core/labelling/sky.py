"""The sky of a photograph: smooth, bright, over the horizon, and never hit by a LiDAR."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import disc, within
from unveil_core.semantics.visibility import PointsInView

__all__ = ["find_sky"]

STEP = 14
"""Steps of brightness, of 255, over a few pixels, that bound a smooth patch: clouds have lower ones, roofs mostly higher ones."""
HIT_SHARE = 0.004
"""A patch of which a larger share of the pixels was hit by points is a wall."""
UNLIKE, LIKE, LEAST_PX = 30.0, 12.0, 12
"""What is darker than the sky around it by more than the first, of 255, is no sky; patches of so many pixels that no point hit and
that differ by less than the second are: the sky between wires."""
THIN_SHARE = 1 / 96
"""Things before the sky that are no wider than this share of the picture are masts and lamps: 8 pixels of 768."""
BESIDE_PX = 8
"""So close to points, pixels, they tell."""
WITHIN_PX = 4
"""Hits nearer than this to the border of a patch, pixels, are of what is beside it."""
LEAST_SHARE = 0.0005
"""Patches that cover less of the picture are no evidence."""


def find_sky(
    image: NDArray[np.uint8], above: Mask, seen: PointsInView, objects: Mask
) -> tuple[Float32, Float32, Float32]:
    """What a photograph shows over the horizon, where no point tells.

    Args:
        image: (H, W, 3) uint8; above: (H, W) over the horizon.
        seen: points of what stays; objects: (H, W) pixels of removable objects.
    Returns:
        three (H, W): where the sky surely is, solid things, and thin ones before the sky; 1, else 0.
    """
    soft = cv2.GaussianBlur(image, (5, 5), 0)
    edge = cv2.morphologyEx(soft, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)).max(axis=2)
    smooth = (edge < STEP) & above & ~objects
    count, patch, stats, _ = cv2.connectedComponentsWithStats(smooth.astype(np.uint8), connectivity=4)
    # Points on a mast fall beside it by a pixel or two: only hits well within a patch count.
    inner = cv2.erode(smooth.astype(np.uint8), disc(WITHIN_PX))
    hits = np.bincount(patch[seen.rows, seen.columns], inner[seen.rows, seen.columns], minlength=count)
    area = stats[:, cv2.CC_STAT_AREA]
    of_patch = patch.ravel()
    bright = np.bincount(of_patch, soft.max(axis=2).ravel(), minlength=count) / np.maximum(area, 1)
    bluish = (soft[..., 2].astype(np.float64) - soft[..., 0]).ravel()
    blue = np.bincount(of_patch, bluish, minlength=count) / np.maximum(area, 1)
    free = (area >= LEAST_SHARE * smooth.size) & (hits <= HIT_SHARE * area)
    free[0] = False
    nothing = np.zeros(smooth.shape, np.float32)
    if not free.any():
        return nothing, nothing, nothing
    # The sky is the largest of the patches that no point hit and that reach the highest; others must look like it.
    top = stats[:, cv2.CC_STAT_TOP]
    first = int(np.argmax(np.where(free & (top <= top[free].min() + 2), area, 0)))
    alike = free & (bright > bright[first] - 45) & (blue > blue[first] - 30)
    alike[first] = True
    darker = _darker(soft, alike[patch])
    mean = np.bincount(of_patch, np.abs(darker).ravel(), minlength=count) / np.maximum(area, 1)
    alike |= (hits == 0) & (area >= LEAST_PX) & (mean < LIKE)
    alike[0] = False
    hit = np.zeros(smooth.shape, np.uint8)
    hit[seen.rows, seen.columns] = 1
    sky = alike[patch]
    # Beside masts and wires nothing is smooth, but its colour is the sky's.
    sky |= above & ~objects & (hit == 0) & (np.abs(darker) < LIKE) & within(sky, BESIDE_PX)
    other = above & ~objects & (darker > UNLIKE) & ~sky
    wide = cv2.morphologyEx(other.astype(np.uint8), cv2.MORPH_OPEN, disc(THIN_SHARE * image.shape[1] / 2))
    solid = (wide > 0) & ~within(hit > 0, BESIDE_PX)
    thin = other & (cv2.dilate(wide, disc(3)) == 0) & (_share(sky) > 0.25)
    return sky.astype(np.float32), solid.astype(np.float32), thin.astype(np.float32)


def _darker(image: NDArray[np.uint8], sky: Mask) -> Float32:
    """(H, W) by how much the channel that differs most is darker than the sky around: clouds and the sun's glow are brighter."""
    picture = image.astype(np.float32)
    weight = sky.astype(np.float32)
    size = 2 * (image.shape[1] // 8) + 1
    near = cv2.blur(weight, (size, size))[..., None]
    around = (cv2.blur(picture * weight[..., None], (size, size)) + 1e-3 * picture[sky].mean(axis=0)) / (near + 1e-3)
    darker: Float32 = (around - picture).max(axis=2)
    return darker


def _share(mask: Mask) -> Float32:
    """(H, W) share of a mask around each pixel."""
    size = 2 * (mask.shape[1] // 48) + 1
    share: Float32 = cv2.blur(mask.astype(np.float32), (size, size))
    return share
