"""OpenCV's classical inpainting methods, made reproducible: the same image always gives the same result.

* Telea, *An image inpainting technique based on the fast marching method* (2004), and Bertalmio et al., *Navier-Stokes, fluid
  dynamics, and image and video inpainting* (2001).
* Shift-map: He and Sun, *Statistics of patch offsets for image completion* (2012).
* FSR: Genser et al., *Spectral constrained frequency selective extrapolation for rapid image error concealment* (2018).

Every function takes an image (H, W, 3), levels of 255, and a mask (H, W), True = to fill, and changes only the pixels in the mask.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np

from unveil_core.base.pictures.levels import as_bytes
from unveil_core.base.types import Levels, Mask, Picture

__all__ = ["classic", "fsr", "shift_map"]

WHOLE_IMAGE_PX = 400_000
"""Above this many pixels the patch offsets are looked for around each hole only: the whole image costs about 1 s at
384x256 and grows faster than its area."""
SMALLEST_PX = 8
"""Smaller pictures are left to Telea's method: there is nothing to learn from."""
PATCH_PX, LEAST_PATCHES = 8, 64
"""Side of the patches that shift-map compares, pixels, as in OpenCV, and how many of them must be known in full: with fewer there
is nothing to compare."""
TRIES = 4
"""Times that shift-map is run again at most until the same answer has come twice."""
FSR_CONTEXT_PX = 48
"""FSR looks no farther than the block of pixels it works on: a hole is given this much of its surroundings."""
FSR_NOTHING = (0, 135, 0)
"""What YCbCr (0, 0, 0) looks like."""


def shift_map(image: Levels, mask: Mask, *, settled: bool = True) -> Levels:
    """Statistics of patch offsets (He and Sun 2012).

    OpenCV wants CIELab and a mask whose non-zero pixels are *valid*; it may leave pixels black where no offset reaches
    valid ground, and it repaints a rim of valid pixels: the former are filled by Telea's method, the latter put back.

    Args:
        settled: take an answer only when the method has given it twice: OpenCV's code, though its random numbers are seeded
            here, has been seen to fill the same picture differently, hardly ever, and where little is known. Twice the time.
    """
    if not mask.any() or mask.all():
        return image.copy()
    result = image.copy()
    unfilled = np.zeros_like(mask)
    for crop, part in _crops(mask):
        lab = cv2.cvtColor(as_bytes(image[crop]), cv2.COLOR_RGB2Lab)
        # What lies in the hole must not matter.
        lab[mask[crop]] = 0
        filled = _by_offsets(lab, mask[crop])
        for _ in range(TRIES if settled else 0):
            again = _by_offsets(lab, mask[crop])
            if np.array_equal(again, filled):
                break
            filled = again
        # Black with zero chroma offset, (0, 0, 0) in 8-bit Lab, is no colour that an image can have.
        unfilled[crop] |= part & (filled == 0).all(axis=2)
        result[crop][part] = cv2.cvtColor(filled, cv2.COLOR_Lab2RGB)[part]
    return classic(result, unfilled, 3, cv2.INPAINT_TELEA) if unfilled.any() else result


def _by_offsets(lab: Picture, mask: Mask) -> Picture:
    """What OpenCV makes of a crop (H, W, 3) in CIELab; 0 where it fails."""
    filled = np.zeros_like(lab)
    known = cv2.erode((~mask).astype(np.uint8), np.ones((PATCH_PX, PATCH_PX), np.uint8), borderValue=0)
    if np.count_nonzero(known) >= LEAST_PATCHES:
        cv2.setRNGSeed(0)  # the method draws from OpenCV's generator of this thread
        cv2.xphoto.inpaint(lab, np.where(mask, 0, 255).astype(np.uint8), filled, cv2.xphoto.INPAINT_SHIFTMAP)
    return filled


def classic(image: Levels, mask: Mask, radius: int, method: int) -> Levels:
    """``cv2.inpaint``, only inside the mask. Of pictures of one row or column it reads memory beyond their ends: it gets two."""
    twice = tuple(2 if side == 1 else 1 for side in mask.shape)
    if max(twice) > 1:
        wide = classic(np.tile(image, (*twice, 1)), np.tile(mask, twice), radius, method)
        return np.ascontiguousarray(wide[: mask.shape[0], : mask.shape[1]])
    hole = mask.astype(np.uint8)
    planes = [image] if image.dtype == np.uint8 else cv2.split(image)  # OpenCV takes floats by channel
    filled = np.dstack([cv2.inpaint(plane, hole, radius, method) for plane in planes])
    return np.where(mask[..., None], filled, image)


def fsr(image: Levels, mask: Mask) -> Levels:
    """Frequency selective reconstruction (Genser et al. 2018) at OpenCV's fast setting; the best one takes twenty times as long.

    About 0.2 ms per pixel of the hole. It draws no random numbers: the same picture gives the same bytes, in every process.
    Where it has nothing to go on, such as in pictures of a few pixels, it leaves YCbCr (0, 0, 0), and Telea's method fills.
    """
    if not mask.any() or mask.all():
        return image.copy()
    result = image.copy()
    unfilled = np.zeros_like(mask)
    for crop, part in _apart(mask, FSR_CONTEXT_PX):
        bgr = np.ascontiguousarray(as_bytes(image[crop])[..., ::-1])
        filled = np.zeros_like(bgr) + np.array(FSR_NOTHING, np.uint8)
        if min(bgr.shape[:2]) >= SMALLEST_PX:  # it reads beyond the ends of narrow ones
            valid = np.where(mask[crop], 0, 255).astype(np.uint8)
            cv2.xphoto.inpaint(bgr, valid, filled, cv2.xphoto.INPAINT_FSR_FAST)
        unfilled[crop] |= part & (filled == FSR_NOTHING).all(axis=2)
        result[crop][part] = filled[..., ::-1][part]
    return classic(result, unfilled, 3, cv2.INPAINT_TELEA) if unfilled.any() else result


def _crops(mask: Mask) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """The whole image, or where that is too slow a crop around each component, with the pixels to take from it."""
    if mask.size <= WHOLE_IMAGE_PX:
        yield (slice(0, mask.shape[0]), slice(0, mask.shape[1])), mask
        return
    yield from _around_each(mask, lambda side: max(32, side // 2))


def _around_each(mask: Mask, margin_of: Callable[[int], int]) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """A crop around each component, with a margin by its longer side, and the component's pixels in it."""
    height, width = mask.shape
    count, component, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    for k in range(1, count):
        x, y, w, h = (int(v) for v in stats[k, :4])
        margin = margin_of(max(w, h))
        crop = (
            slice(max(0, y - margin), min(height, y + h + margin)),
            slice(max(0, x - margin), min(width, x + w + margin)),
        )
        yield crop, component[crop] == k


def _apart(mask: Mask, context: int) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """Crops around holes that are farther apart than their context reaches, with the pixels to take from each: many specks
    that lie together are one."""
    near = cv2.dilate(mask.astype(np.uint8), np.ones((2 * context + 1,) * 2, np.uint8))
    count, component, stats, _ = cv2.connectedComponentsWithStats(near, connectivity=8)
    for k in range(1, count):
        x, y, w, h = (int(v) for v in stats[k, :4])
        crop = (slice(y, y + h), slice(x, x + w))
        yield crop, mask[crop] & (component[crop] == k)
