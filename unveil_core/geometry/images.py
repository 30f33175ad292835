"""Helpers on images that know nothing of streets: borders, smoothing, brightness."""

from __future__ import annotations

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Levels, Mask

__all__ = [
    "area_px",
    "blurred",
    "blurred_over",
    "border_px",
    "disc",
    "grab_cut",
    "grow",
    "luminance",
    "mask_bits",
    "mask_of_bits",
    "masked_blur",
    "resampled",
    "sample_at",
    "scale_from_384",
    "smoothed",
    "within",
]

BORDER_WIDTH = 800
"""Images narrower than this have borders of so many pixels as were found at 384, wider ones in proportion."""
ROWS_IN_SIGMA = 25
"""Means of rows in a standard deviation of a blur: so many differ from all rows by a thousandth of what the blur shows."""
SMOOTHING_PX = 1.0
"""Standard deviation of the smoothing before colours are compared, pixels at 384 px: grain and JPEG blocks do not count."""


def border_px(width: int, least: int = 2) -> int:
    """How far the border of a thing reaches beyond its label, pixels, in an image that is ``width`` pixels wide.

    There pixels mix the thing's colour with what is beside it: by antialiasing, and by labels that are a little off, the more
    pixels the larger the image.

    Args:
        least: pixels at 384 px, where all such borders were tried: 2 for what goes with a removed object, 1 for what is left out
            where it must not mix, more where one border has to contain another.
    """
    return max(least, round(least * width / BORDER_WIDTH))


def scale_from_384(width: int) -> float:
    """How many times wider than 384 pixels, where lengths in pixels were tried, a picture is; narrower ones count as that wide."""
    return max(1.0, width / 384)


def area_px(shape: tuple[int, ...], least: int) -> int:
    """How many pixels of an image (H, W…) cover what ``least`` pixels cover of one of 384x256; not fewer in smaller ones."""
    return max(least, round(least * shape[0] * shape[1] / (384 * 256)))


def smoothed(picture: Levels) -> Float32:
    """A picture (H, W, 3) as colours of two pictures are compared, levels of 255: without grain."""
    sigma = SMOOTHING_PX * border_px(picture.shape[1], 2) / 2
    return cv2.GaussianBlur(picture.astype(np.float32), (0, 0), sigma).astype(np.float32)


def disc(radius: float) -> NDArray[np.uint8]:
    """A round structuring element (2 r + 1, 2 r + 1), its radius rounded down to whole pixels."""
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * int(radius) + 1,) * 2).astype(np.uint8)


def grow(mask: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """A mask (H, W) dilated by a disc; the mask itself where the radius is less than a pixel."""
    if radius < 1:
        return mask
    return cv2.dilate(mask.astype(np.uint8), disc(radius)).astype(bool)


def within(mask: NDArray[np.bool_], distance: float) -> NDArray[np.bool_]:
    """Pixels (H, W) no farther than so many pixels from a mask; for large distances, where :func:`grow` takes long."""
    if not mask.any():
        return mask
    away = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    near: NDArray[np.bool_] = away <= distance
    return near


def luminance(color: Float32) -> Float32:
    """(…) of sRGB (…, 3), Rec. 601 weights."""
    return color @ np.array([0.299, 0.587, 0.114], dtype=np.float32)


def masked_blur(picture: Float32, mask: Mask, sigma: float | tuple[float, float], *, prior: float = 0.0) -> Float32:
    """Gaussian blur of (A, B) or (A, B, C) that only looks at ``mask``; ``prior`` pulls towards 0 where little is in reach.

    Args:
        sigma: texels, one for both directions, or along the street and across it.
    """
    m = mask.astype(np.float32)
    return blurred_over(picture * (m if picture.ndim == 2 else m[..., None]), blurred(m, sigma), sigma, prior=prior)


def blurred(picture: Float32, sigma: float | tuple[float, float]) -> Float32:
    """Gaussian blur of (A, B) or (A, B, C), ``sigma`` as of :func:`masked_blur`.

    A long one along the street is made of means of rows, of which ``ROWS_IN_SIGMA`` lie in its standard deviation.
    """
    along, across = sigma if isinstance(sigma, tuple) else (sigma, sigma)
    high, wide = picture.shape[:2]
    few = math.ceil(high / max(1, along // ROWS_IN_SIGMA))
    if few == high:
        return cv2.GaussianBlur(picture, (0, 0), across, sigmaY=along)  # type: ignore[return-value]
    means = cv2.resize(picture, (wide, few), interpolation=cv2.INTER_AREA)
    means = cv2.GaussianBlur(means, (0, 0), across, sigmaY=along * few / high)
    return cv2.resize(means, (wide, high), interpolation=cv2.INTER_LINEAR)  # type: ignore[return-value]


def blurred_over(
    picture: Float32, weight: Float32, sigma: float | tuple[float, float], *, prior: float = 0.0
) -> Float32:
    """:func:`masked_blur` of a picture that is 0 outside of a mask, of which the :func:`blurred` ``weight`` (A, B) is known: a wide
    blur takes long."""
    value = blurred(picture, sigma)
    weight = np.maximum(weight + prior, 1e-6)
    return value / (weight if picture.ndim == 2 else weight[..., None])


def sample_at(image: NDArray[Any], positions: Float64, mode: int = cv2.INTER_LINEAR) -> NDArray[Any]:
    """(N, C) values of an image (H, W[, C]) at positions (N, 2) in pixels, the centre of the first at 0.5; its border goes on.

    Args:
        mode: of OpenCV's interpolation. Integers stay integers.
    """
    # OpenCV's remap wants both sides of its grid below 32768.
    count, width, rows = len(positions), 1024, 16_384
    padded = np.zeros((-(-count // width) * width, 2), dtype=np.float32)
    padded[:count] = positions - 0.5
    grid = padded.reshape(-1, width, 2)
    parts = [
        cv2.remap(image, part[..., 0], part[..., 1], mode, borderMode=cv2.BORDER_REPLICATE)
        for part in (grid[start : start + rows] for start in range(0, len(grid), rows))
    ]
    channels = 1 if image.ndim == 2 else image.shape[2]
    return (
        np.concatenate([p.reshape(-1, channels) for p in parts])[:count]
        if parts
        else np.zeros((0, channels), image.dtype)
    )


def resampled(
    plane: NDArray[Any], positions: Float32, mode: int = cv2.INTER_LINEAR, *, border: int = cv2.BORDER_REPLICATE
) -> Float32:
    """A plane (h, w[, C]) at a grid of positions (H, W, 2) in pixels, the centre of the first at 0.5.

    Args:
        mode: of OpenCV's interpolation; border: of its borders.
    """
    found: Float32 = cv2.remap(
        np.asarray(plane, dtype=np.float32), positions[..., 0] - 0.5, positions[..., 1] - 0.5, mode, borderMode=border
    ).astype(np.float32, copy=False)
    return found


def mask_bits(mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """The pixels of a mask (H, W) as bits, an eighth of its size."""
    return np.packbits(mask)


def mask_of_bits(bits: NDArray[np.uint8], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Inverse of :func:`mask_bits`, of the mask's shape (H, W)."""
    return np.unpackbits(bits, count=int(np.prod(shape))).reshape(shape).astype(bool)


def grab_cut(image: NDArray[np.uint8], state: NDArray[np.uint8], rounds: int) -> None:
    """Decide in ``state`` (H, W), of OpenCV's four states, what of an image (H, W, 3) is the object (Rother et al., *GrabCut*,
    SIGGRAPH 2004); the same each time, though the colours' first clusters are drawn."""
    cv2.setRNGSeed(0)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(np.ascontiguousarray(image), state, None, *models, rounds, cv2.GC_INIT_WITH_MASK)
