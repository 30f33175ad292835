"""Single-image inpainters behind one protocol: image and mask in, image out."""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.errors import SettingsError
from unveil_core.inpaint.patch_fill import patch_fill

__all__ = ["INPAINTERS", "SingleImageInpainter", "exemplar", "inpainter", "navier_stokes", "telea"]

Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]


class SingleImageInpainter(Protocol):
    """Fill ``mask`` (H, W) of ``image`` (H, W, 3) uint8 RGB; pixels outside the mask come back unchanged."""

    def __call__(self, image: Image, mask: Mask) -> Image: ...


def telea(image: Image, mask: Mask) -> Image:
    """Fast marching (Telea 2004), OpenCV."""
    filled = cv2.inpaint(image, mask.astype(np.uint8) * 255, 5, cv2.INPAINT_TELEA)
    return np.where(mask[..., None], filled, image).astype(np.uint8)


def navier_stokes(image: Image, mask: Mask) -> Image:
    """Fluid dynamics (Bertalmio et al. 2001), OpenCV."""
    filled = cv2.inpaint(image, mask.astype(np.uint8) * 255, 5, cv2.INPAINT_NS)
    return np.where(mask[..., None], filled, image).astype(np.uint8)


def exemplar(image: Image, mask: Mask) -> Image:
    """Patches of the image's own surroundings (:mod:`unveil_core.inpaint.patch_fill`); Telea where there are none."""
    filled = patch_fill(image, mask)
    return telea(image, mask) if filled is None else filled


INPAINTERS: dict[str, SingleImageInpainter] = {
    "exemplar": exemplar,
    "telea": telea,
    "navier-stokes": navier_stokes,
}


def inpainter(name: str) -> SingleImageInpainter:
    """The inpainter called ``name``.

    Raises:
        SettingsError: there is none of that name.
    """
    if name not in INPAINTERS:
        raise SettingsError(f"unknown inpainter {name!r}", mend=f"use one of {', '.join(INPAINTERS)}")
    return INPAINTERS[name]
