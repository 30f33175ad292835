"""Image metrics on a region: PSNR, SSIM and the overlap of masks.

The sums behind them are public too, so that many frames can be pooled exactly: the PSNR of a drive is the PSNR of the
mean squared error over all its pixels, not the mean of per-frame decibels.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from unveil_core.base.types import Float64, Mask, Picture

__all__ = [
    "gradient",
    "as_unit_float",
    "mask_iou",
    "psnr",
    "psnr_of_mse",
    "rounded",
    "squared_error",
    "ssim",
    "ssim_map",
]

Image = NDArray[np.uint8] | NDArray[np.floating]

SSIM_WINDOW, SSIM_SIGMA = 11, 1.5
SSIM_SOFT = 0.01**2, 0.03**2
"""Added to products of means and to covariances, so that nothing is divided by nothing: the paper's (K1 L)^2, (K2 L)^2, L = 1."""


def as_unit_float(image: Image) -> NDArray[np.float64]:
    """An image (H, W, 3), uint8 or float in [0, 1], as float64 in [0, 1]."""
    array = np.asarray(image)
    if array.ndim != 3 or array.shape[2] != 3:
        raise ValueError(f"an image must be (H, W, 3), not {array.shape}")
    if array.dtype == np.uint8:
        return array.astype(np.float64) / 255.0
    if not np.issubdtype(array.dtype, np.floating):
        raise ValueError(f"an image must be uint8 or float in [0, 1], not {array.dtype}")
    return array.astype(np.float64)


def squared_error(a: Image, b: Image) -> NDArray[np.float64]:
    """Mean over the channels of the squared difference, per pixel: (H, W) float64."""
    x, y = as_unit_float(a), as_unit_float(b)
    if x.shape != y.shape:
        raise ValueError(f"images differ in size: {x.shape} and {y.shape}")
    error: NDArray[np.float64] = np.square(x - y).mean(axis=2)
    return error


def psnr_of_mse(mse: float) -> float:
    """Decibels for values in [0, 1]; infinite for equal images, NaN where there was nothing to compare."""
    if np.isnan(mse):
        return float("nan")
    return float("inf") if mse <= 0.0 else float(-10.0 * np.log10(mse))


def psnr(a: Image, b: Image, mask: Mask | None = None) -> float:
    """Peak signal-to-noise ratio in dB.

    Args:
        a, b: (H, W, 3) uint8, or float in [0, 1].
        mask: (H, W) bool, the pixels that count; all of them by default.
    Returns:
        decibels; infinite where the images agree, NaN where the mask is empty.
    """
    return psnr_of_mse(_masked_mean(squared_error(a, b), mask))


def ssim_map(a: Image, b: Image) -> NDArray[np.float64]:
    """Structural similarity per pixel, (H, W) float64, mean over the channels.

    Wang et al., *Image quality assessment: from error visibility to structural similarity* (2004): Gaussian window of
    11 pixels, sigma 1.5, K1 = 0.01, K2 = 0.03, population covariance.
    """
    x, y = as_unit_float(a), as_unit_float(b)
    if x.shape != y.shape:
        raise ValueError(f"images differ in size: {x.shape} and {y.shape}")
    if min(x.shape[:2]) < SSIM_WINDOW:
        raise ValueError(f"SSIM needs images of at least {SSIM_WINDOW} pixels a side, not {x.shape[1]}x{x.shape[0]}")
    similarity: NDArray[np.float64] = np.mean([_ssim_of_channel(x[..., k], y[..., k]) for k in range(3)], axis=0)
    return similarity


def _ssim_of_channel(x: Float64, y: Float64) -> Float64:
    """(H, W) of two channels (H, W), equation 13 of the paper."""

    def local_mean(plane: Float64) -> Float64:
        return gaussian_filter(plane, SSIM_SIGMA, radius=SSIM_WINDOW // 2)

    mean_x, mean_y = local_mean(x), local_mean(y)
    variances = local_mean(x * x) - mean_x**2 + local_mean(y * y) - mean_y**2
    covariance = local_mean(x * y) - mean_x * mean_y
    first, second = SSIM_SOFT
    luminance = (2 * mean_x * mean_y + first) / (mean_x**2 + mean_y**2 + first)
    return np.asarray(luminance * (2 * covariance + second) / (variances + second))


def ssim(a: Image, b: Image, mask: Mask | None = None) -> float:
    """Mean of :func:`ssim_map` over a mask (H, W); the windows of border pixels reach outside the mask.

    Returns:
        at most 1; NaN where the mask is empty.
    """
    return _masked_mean(ssim_map(a, b), mask)


def mask_iou(a: Mask, b: Mask) -> float:
    """Intersection over union of two masks (H, W); NaN where both are empty."""
    union = int(np.count_nonzero(a | b))
    return float(np.count_nonzero(a & b)) / union if union else float("nan")


def _masked_mean(values: NDArray[np.float64], mask: Mask | None) -> float:
    if mask is None:
        return float(values.mean())
    if mask.shape != values.shape:
        raise ValueError(f"a mask of {mask.shape} does not fit images of {values.shape}")
    return float(values[mask].mean()) if mask.any() else float("nan")


def rounded(value: Any) -> Any:
    """Figures for JSON: floats, also inside lists and dicts, to 4 digits, and None for those that are infinite or undefined."""
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    if isinstance(value, list):
        return [rounded(v) for v in value]
    if isinstance(value, float):
        return round(value, 4) if math.isfinite(value) else None
    return value


def gradient(picture: Picture) -> Float64:
    """(H, W) length of the luminance's gradient, levels of 255 a pixel: its mean tells how sharp and grained a region is."""
    down, right = np.gradient(picture.astype(np.float64) @ [0.299, 0.587, 0.114])
    length: Float64 = np.hypot(down, right)
    return length
