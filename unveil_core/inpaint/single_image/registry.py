"""Single-image inpainters behind one protocol: image and mask in, image out."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from unveil_core.base.errors import SettingsError
from unveil_core.base.types import Levels, Mask
from unveil_core.geometry.images import grow
from unveil_core.inpaint.single_image.names import INPAINTERS, is_file
from unveil_core.inpaint.single_image.onnx_models import OnnxSingleImage, load_single_image
from unveil_core.inpaint.single_image.opencv import classic, fsr, shift_map
from unveil_core.inpaint.single_image.patchmatch import patch_fill

__all__ = [
    "BUILT_IN",
    "SingleImageInpainter",
    "exemplar",
    "fill_around",
    "inpainter",
    "navier_stokes",
    "telea",
]


ROW_LEVELS, ROW_SHARE = 20.0, 1 / 32
"""What a patch from another height of the picture costs: as much as a difference of so many levels of 255 for each such share of
the picture's width. Cameras drive level: what is at a height is mostly like what is beside it, and the road does not rise above
the horizon."""


class SingleImageInpainter(Protocol):
    """Fill ``mask`` (H, W) of ``image`` (H, W, 3) RGB, levels of 255; pixels outside the mask come back unchanged."""

    def __call__(self, image: Levels, mask: Mask) -> Levels: ...


def telea(image: Levels, mask: Mask) -> Levels:
    """Fast marching (Telea 2004), OpenCV."""
    return classic(image, mask, 5, cv2.INPAINT_TELEA)


def navier_stokes(image: Levels, mask: Mask) -> Levels:
    """Fluid dynamics (Bertalmio et al. 2001), OpenCV."""
    return classic(image, mask, 5, cv2.INPAINT_NS)


def exemplar(image: Levels, mask: Mask, *, width: int | None = None) -> Levels:
    """Patches of the image's own surroundings (:mod:`unveil_core.inpaint.single_image.patchmatch`); Telea where there are none.

    Args:
        width: of the whole picture, pixels, where ``image`` is a part of it.
    """
    per_row = ROW_LEVELS / (ROW_SHARE * (width or image.shape[1]))
    filled = patch_fill(image, mask, row_cost=per_row**2)
    return telea(image, mask) if filled is None else filled


BUILT_IN: dict[str, SingleImageInpainter] = {
    "exemplar": exemplar,
    "telea": telea,
    "navier-stokes": navier_stokes,
    "shift-map": shift_map,
    "fsr": fsr,
}
"""By their names, the ones in ``names.INPAINTERS``."""


def inpainter(name: str) -> SingleImageInpainter:
    """The built-in inpainter called ``name``, or the network in the ONNX file of that path.

    Raises:
        SettingsError: there is none of that name, or the file is missing, damaged or of something else.
    """
    if is_file(name):
        return load_single_image(Path(name))
    if name not in BUILT_IN:
        raise SettingsError(f"Not an inpainter: {name}", mend=f"use one of {', '.join(INPAINTERS)}, or FILE.onnx")
    return BUILT_IN[name]


def fill_around(inpaint: SingleImageInpainter, image: Levels, mask: Mask) -> Levels:
    """Fill each hole of an image from its own surroundings: a wall is not to be filled with the houses across the street.

    Networks are given the image as it is, and find the surroundings that they were made for.
    """
    if isinstance(inpaint, OnnxSingleImage):
        return inpaint(image, mask)
    if inpaint is exemplar:
        inpaint = partial(exemplar, width=image.shape[1])
    result = image.copy()
    count, _, boxes, _ = cv2.connectedComponentsWithStats(grow(mask, 3).astype(np.uint8), connectivity=8)
    for k in range(1, count):
        x, y, w, h = (int(v) for v in boxes[k, :4])
        margin = max(20, (w + h) // 3)
        aside = max(margin, w)  # most of what is like the hole is beside it
        part = np.s_[max(0, y - margin) : y + h + margin, max(0, x - aside) : x + w + aside]
        result[part] = inpaint(np.ascontiguousarray(result[part]), np.ascontiguousarray(mask[part]))
    return result
