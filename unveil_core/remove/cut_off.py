"""Pieces of objects that masks drawn by hand cut off: a wheel, a mirror, the far side of a car."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import area_px, grab_cut
from unveil_core.ground.street import Ground

__all__ = ["cut_off_pixels"]

REACH = 0.03
"""How far beyond a mask pieces are looked for, as a share of the picture's width: hands cut corners, not halves."""
LEAST_M, MOST_M = 0.15, 3.5
"""Heights over the ground between which a piece may be, metres: lower is shadow and ground, higher is no vehicle."""
LEAST_PX = 24
"""Pixels at 384x256, in proportion in larger images, of which a mask must have more: of fewer no colours are told."""
ROUNDS = 3
"""Of GrabCut: more hardly change anything."""


def cut_off_pixels(photograph: NDArray[np.uint8], camera: Camera, depth: Float64, own: Mask, street: Ground) -> Mask:
    """(H, W) pixels beside a frame's own mask that have the colours of what it masks, not of what is around it, by GrabCut,
    and stand over the ground.

    Args:
        photograph: (H, W, 3).
        depth: (H, W) of the scene with everything in it.
        own: (H, W) the frame's mask.
    """
    reach = max(2, round(REACH * camera.width))
    count, part, stats, _ = cv2.connectedComponentsWithStats(own.astype(np.uint8), connectivity=8)
    found = np.zeros(own.shape, dtype=bool)
    for k in range(1, count):
        x, y, width, height, area = stats[k].tolist()
        if area <= area_px(own.shape, LEAST_PX):
            continue
        rows = slice(max(0, y - 2 * reach), y + height + 2 * reach)
        columns = slice(max(0, x - 2 * reach), x + width + 2 * reach)
        found[rows, columns] |= _like(photograph[rows, columns], part[rows, columns] == k, own[rows, columns], reach)
    found &= ~own
    rays = camera.rays()[found]
    over = street.over(street.path.to_street(camera.centre + depth[found][:, None] * rays))
    found[found] = (over > LEAST_M) & (over < MOST_M)
    return found


def _like(picture: NDArray[np.uint8], one: Mask, all_of_them: Mask, reach: int) -> Mask:
    """(H, W) pixels around ``one`` object that are more like it than like what is around it, and hang together with it."""
    near = cv2.dilate(one.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)).astype(bool)
    kind = np.where(one, cv2.GC_FGD, np.where(near, cv2.GC_PR_BGD, cv2.GC_BGD)).astype(np.uint8)
    kind[all_of_them & ~one] = cv2.GC_BGD  # another object is no background, but it is masked anyway
    if not (kind == cv2.GC_BGD).any():
        return np.zeros(one.shape, dtype=bool)
    grab_cut(picture, kind, ROUNDS)
    object_ = (kind == cv2.GC_FGD) | (kind == cv2.GC_PR_FGD)
    label = cv2.connectedComponents(object_.astype(np.uint8), connectivity=4)[1]
    return np.asarray(object_ & np.isin(label, np.unique(label[one])), dtype=bool)
