"""Helpers on images that know nothing of streets: borders, smoothing, brightness."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask

__all__ = ["grow", "luminance", "masked_blur"]


def grow(mask: NDArray[np.bool_], radius_px: int) -> NDArray[np.bool_]:
    """A mask (H, W) grown by a disc."""
    if radius_px <= 0:
        return mask
    size = 2 * radius_px + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return cv2.dilate(mask.astype(np.uint8), kernel).astype(bool)


def luminance(color: Float32) -> Float32:
    """(…) of sRGB (…, 3), Rec. 601 weights."""
    return color @ np.array([0.299, 0.587, 0.114], dtype=np.float32)


def masked_blur(picture: Float32, mask: Mask, sigma: float | tuple[float, float], *, prior: float = 0.0) -> Float32:
    """Gaussian blur of (A, B) or (A, B, C) that only looks at ``mask``; ``prior`` pulls towards 0 where little is in reach.

    Args:
        sigma: texels, one for both directions, or along the street and across it.
    """
    along, across = sigma if isinstance(sigma, tuple) else (sigma, sigma)
    m = mask.astype(np.float32)
    weight = cv2.GaussianBlur(m, (0, 0), across, sigmaY=along)
    value = cv2.GaussianBlur(picture * (m if picture.ndim == 2 else m[..., None]), (0, 0), across, sigmaY=along)
    weight = np.maximum(weight + prior, 1e-6)
    return value / (weight if picture.ndim == 2 else weight[..., None])
