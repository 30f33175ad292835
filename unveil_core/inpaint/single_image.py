"""Single-image inpainters behind one protocol: image and mask in, image out."""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.errors import SettingsError

__all__ = ["INPAINTERS", "SingleImageInpainter", "inpainter", "navier_stokes", "shift_map", "telea"]

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


def shift_map(image: Image, mask: Mask) -> Image:
    """Shift-map inpainting (He and Sun 2012, as in OpenCV contrib's xphoto), on Lab colours.

    Where the library finds no shift for a pixel, Telea fills it; it needs enough known surroundings to look in.
    """
    if not mask.any() or mask.mean() > 0.7:
        return telea(image, mask)
    lab = cv2.cvtColor(image, cv2.COLOR_RGB2Lab)
    known = np.where(mask, 0, 255).astype(np.uint8)
    result = np.zeros_like(lab)
    # The library draws random numbers, each of its threads from a generator of its own: one thread, one seed, one result.
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    cv2.setRNGSeed(0)
    try:
        cv2.xphoto.inpaint(lab, known, result, cv2.xphoto.INPAINT_SHIFTMAP)
    except cv2.error:
        return telea(image, mask)
    finally:
        cv2.setNumThreads(threads)
    filled = np.where(mask[..., None], cv2.cvtColor(result, cv2.COLOR_Lab2RGB), image).astype(np.uint8)
    # Lab zero is no colour that a photograph has: there the library left its output as it came in.
    missed = mask & (result == 0).all(axis=2)
    return telea(filled, missed) if missed.any() else filled


INPAINTERS: dict[str, SingleImageInpainter] = {
    "telea": telea,
    "navier-stokes": navier_stokes,
    "shift-map": shift_map,
}


def inpainter(name: str) -> SingleImageInpainter:
    """The inpainter called ``name``.

    Raises:
        SettingsError: there is none of that name.
    """
    if name not in INPAINTERS:
        raise SettingsError(f"unknown inpainter {name!r}", mend=f"use one of {', '.join(INPAINTERS)}")
    return INPAINTERS[name]
