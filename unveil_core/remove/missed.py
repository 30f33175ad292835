"""Objects that a frame's labels miss: a network overlooks a car in one frame, and the scene knows it from the others."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import area_px, border_px, grow

__all__ = ["missed_pixels"]

SHARE = 0.5
"""Share of a pixel from which on it shows what is removed: half of the light comes from it."""
LEAST_PX = 12
"""Pixels at 384x256, in proportion in larger images, below which what the labels lack is their border's error."""
ALIKE = 0.08
"""Difference between photograph and scene, levels from 0 to 1, up to which both show the same: more than that of noise and of a
little exposure, less than that of a car and the road."""


def missed_pixels(
    photograph: NDArray[np.uint8], rendered: Float32, share: Float32, own: Mask, backed: Callable[[Mask], Mask]
) -> Mask:
    """(H, W) pixels of removed objects that are not in the frame's own mask.

    Where the scene has a removed object, and the photograph shows the scene's colours, the object is there; where it shows others,
    something stands in front, or the object has moved on. Other frames' labels must have the object there, too: where most lack it,
    the scene is wrong, as between parked cars whose borders photographs alone do not tell.

    Args:
        photograph: (H, W, 3); rendered: (H, W, 3) the scene in the same colours, sRGB from 0 to 1.
        share: (H, W) of each pixel that surfels of removed objects have; own: (H, W) the frame's own mask.
        backed: of (H, W) pixels those at whose place most other frames have a removed object; asked only where it decides.
    """
    candidate = (share > SHARE) & ~own
    border = border_px(share.shape[1], 1)
    side = 2 * border + 1
    core = cv2.erode(candidate.astype(np.uint8), np.ones((side, side), np.uint8))
    apart = np.abs(photograph.astype(np.float32) / 255 - rendered).mean(axis=2)
    count, component, stats, _ = cv2.connectedComponentsWithStats(core, connectivity=8)
    is_missed = stats[:, cv2.CC_STAT_AREA] >= area_px(share.shape, LEAST_PX)
    is_missed &= np.asarray(ndimage.median(apart, component, np.arange(count))) < ALIKE
    is_missed[0] = False
    if is_missed.any():
        shown = np.bincount(component[backed(is_missed[component])], minlength=count)
        is_missed &= shown > 0.5 * stats[:, cv2.CC_STAT_AREA]
    missed = is_missed[component]
    found: Mask = grow(missed, border) & candidate
    return found
