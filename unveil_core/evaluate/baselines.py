"""Baselines without 3D: single-image inpainting, frame by frame.

* Telea, *An image inpainting technique based on the fast marching method* (2004), and Bertalmio et al.,
  *Navier-Stokes, fluid dynamics, and image and video inpainting* (2001), as OpenCV has them.
* He and Sun, *Statistics of patch offsets for image completion* (2012), as OpenCV's ``xphoto`` has it: the strongest
  classical filling that needs no weights.

Every function takes an image (H, W, 3) uint8 sRGB and a mask (H, W) of what is removed, grows the mask by the border that ours
is grown by (:func:`with_border`), and returns an image of which only the pixels inside the grown mask have changed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import cv2
import numpy as np

from unveil_core.base.types import Mask, Picture
from unveil_core.geometry.images import border_px, grow
from unveil_core.inpaint.single_image import opencv

__all__ = ["BASELINES", "BASELINE_FRAMES", "navier_stokes", "shift_map", "telea", "with_border", "with_neighbours"]

RADIUS_PX = 3
"""Neighbourhood of OpenCV's two classical methods, pixels, as in OpenCV's own tutorial. The inpainters of the same names in
``inpaint.single_image`` take 5: they are part of the method, and changing them must not move the baselines."""
BASELINE_FRAMES = 40
"""Of longer drives about so many evenly spaced frames are filled by the baselines: shift-map takes seconds a frame."""


def telea(image: Picture, mask: Mask) -> Picture:
    """Fast marching (Telea 2004)."""
    return _classic(image, mask, cv2.INPAINT_TELEA)


def navier_stokes(image: Picture, mask: Mask) -> Picture:
    """Navier-Stokes (Bertalmio 2001)."""
    return _classic(image, mask, cv2.INPAINT_NS)


def _classic(image: Picture, mask: Mask, method: int) -> Picture:
    hole = _hole(image, mask)
    if not hole.any() or hole.all():
        return image.copy()
    filled = cv2.inpaint(image, hole.astype(np.uint8), RADIUS_PX, method)
    return np.where(hole[..., None], filled, image).astype(np.uint8)


def shift_map(image: Picture, mask: Mask) -> Picture:
    """Statistics of patch offsets (He and Sun 2012), see :func:`unveil_core.inpaint.single_image.opencv.shift_map`."""
    return opencv.shift_map(image, _hole(image, mask), settled=False)


BASELINES: dict[str, Callable[[Picture, Mask], Picture]] = {"telea": telea, "shift_map": shift_map}
"""The ones that every evaluation runs."""


def _hole(image: Picture, mask: Mask) -> Mask:
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"an image must be (H, W, 3) uint8, not {image.shape} {image.dtype}")
    if mask.shape != image.shape[:2]:
        raise ValueError(f"a mask of {mask.shape} does not fit an image of {image.shape[:2]}")
    return with_border(mask.astype(bool))


def with_border(mask: Mask) -> Mask:
    """A mask (H, W) with the border that the baselines fill, too: as wide as that of the masks that ours fills."""
    return grow(mask, border_px(mask.shape[1]))


def with_neighbours(frames: Sequence[int], most: int | None = None) -> set[int]:
    """About so many frames, of those given, that the baselines fill: evenly spaced pairs of neighbours, so that flicker can be
    measured; none where ``most`` is 0, ``BASELINE_FRAMES`` by default."""
    most = BASELINE_FRAMES if most is None else most
    if not most:
        return set()
    every = max(1, math.ceil(len(frames) / most))
    return {frame for k, frame in enumerate(frames) if k % (2 * every) < 2}
