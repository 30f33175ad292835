"""What one gets without any 3D: single-image inpainting, frame by frame.

* Telea, *An image inpainting technique based on the fast marching method* (2004), and Bertalmio et al.,
  *Navier-Stokes, fluid dynamics, and image and video inpainting* (2001), as OpenCV has them.
* He and Sun, *Statistics of patch offsets for image completion* (2012), as OpenCV's ``xphoto`` has it: the strongest
  classical filling that needs no weights.

Every function takes an image (H, W, 3) uint8 sRGB and a mask (H, W) of what must go, grows the mask by two pixels as
anybody would (silhouettes bleed), and returns an image of which only the pixels inside the grown mask have changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.remove.regions import grow

__all__ = ["BASELINES", "GROWN_PX", "navier_stokes", "shift_map", "telea"]

Picture = NDArray[np.uint8]
Mask = NDArray[np.bool_]

GROWN_PX = 2
WHOLE_IMAGE_PX = 400_000
"""Above this many pixels the patch offsets are looked for around each hole only: the whole image costs about 1 s at
384x256 and grows faster than its area."""


def telea(image: Picture, mask: Mask) -> Picture:
    """Fast marching (Telea 2004), radius 3 px."""
    return _classic(image, mask, cv2.INPAINT_TELEA)


def navier_stokes(image: Picture, mask: Mask) -> Picture:
    """Navier-Stokes (Bertalmio 2001), radius 3 px."""
    return _classic(image, mask, cv2.INPAINT_NS)


def _classic(image: Picture, mask: Mask, method: int) -> Picture:
    hole = _hole(image, mask)
    if not hole.any() or hole.all():
        return image.copy()
    filled = cv2.inpaint(image, hole.astype(np.uint8), 3, method)
    return np.where(hole[..., None], filled, image).astype(np.uint8)


def shift_map(image: Picture, mask: Mask) -> Picture:
    """Statistics of patch offsets (He and Sun 2012).

    OpenCV wants CIELab and a mask whose non-zero pixels are *valid*; it may leave pixels black where no offset reaches
    valid ground, and it repaints a rim of valid pixels: the former are filled by :func:`telea`, the latter put back.
    """
    hole = _hole(image, mask)
    if not hole.any() or hole.all():
        return image.copy()
    result = image.copy()
    unfilled = np.zeros_like(hole)
    for window, part in _windows(hole):
        lab = cv2.cvtColor(image[window], cv2.COLOR_RGB2Lab)
        valid = np.where(hole[window], 0, 255).astype(np.uint8)
        filled = np.zeros_like(lab)
        # The method draws random numbers from OpenCV's generator of this thread. Seeded, results repeat mostly, not always:
        # it has been seen to fill the same picture differently within one process.
        cv2.setRNGSeed(0)
        cv2.xphoto.inpaint(lab, valid, filled, cv2.xphoto.INPAINT_SHIFTMAP)
        # Black with zero chroma offset, (0, 0, 0) in 8-bit Lab, is no colour that an image can have.
        unfilled[window] |= part & (filled == 0).all(axis=2)
        result[window][part] = cv2.cvtColor(filled, cv2.COLOR_Lab2RGB)[part]
    if unfilled.any():
        rest = cv2.inpaint(result, unfilled.astype(np.uint8), 3, cv2.INPAINT_TELEA)
        result[unfilled] = rest[unfilled]
    return result


BASELINES: dict[str, Callable[[Picture, Mask], Picture]] = {"telea": telea, "shift_map": shift_map}
"""The ones that every evaluation runs."""


def _hole(image: Picture, mask: Mask) -> Mask:
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"an image must be (H, W, 3) uint8, not {image.shape} {image.dtype}")
    if mask.shape != image.shape[:2]:
        raise ValueError(f"a mask of {mask.shape} does not fit an image of {image.shape[:2]}")
    return grow(mask.astype(bool), GROWN_PX)


def _windows(hole: Mask) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """The whole image, or where that is too slow a window around each component, with the pixels to take from it."""
    height, width = hole.shape
    if height * width <= WHOLE_IMAGE_PX:
        yield (slice(0, height), slice(0, width)), hole
        return
    count, component, stats, _ = cv2.connectedComponentsWithStats(hole.astype(np.uint8), connectivity=8)
    for k in range(1, count):
        x, y, w, h = (int(v) for v in stats[k, :4])
        margin = max(32, max(w, h) // 2)
        window = (
            slice(max(0, y - margin), min(height, y + h + margin)),
            slice(max(0, x - margin), min(width, x + w + margin)),
        )
        yield window, component[window] == k
