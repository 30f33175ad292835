"""The encoding of pictures on disk, sRGB (IEC 61966-2-1), and other light in it.

A colour is reflectance times illumination in linear light only: of codes, a shadow takes another share in the dark end, where the
curve is straight, than in the middle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64

__all__ = [
    "HALF_LEVEL",
    "UNCLIPPED",
    "light_certainty",
    "linear_light",
    "linear_of_srgb",
    "log_slope",
    "relight",
    "srgb_of_linear",
]

HALF_LEVEL = 0.5 / 255
"""Least code, of 1, that light is told from: below, 8 bits round it to black."""
CODE_NOISE = 1 / 255
"""Standard deviation of a code that was photographed and compressed: a level."""
GRAIN = 0.05
"""Standard deviation of the logarithm of light on one material: the grain of asphalt."""
UNCLIPPED, CLIPPED = 240 / 255, 250 / 255
"""Codes up to which a pixel tells all of its light, and from which on nothing, for the sensor may have had its fill."""


def linear_of_srgb(color: NDArray[np.floating]) -> Float64:
    """Linear light of sRGB, both 0 to 1, of any shape; beyond these the curve goes on."""
    color = np.asarray(color, dtype=np.float64)
    return np.where(color <= 0.04045, color / 12.92, ((np.maximum(color, 0) + 0.055) / 1.055) ** 2.4)


def srgb_of_linear(light: NDArray[np.floating]) -> Float64:
    """The inverse of :func:`linear_of_srgb`."""
    light = np.asarray(light, dtype=np.float64)
    return np.where(light <= 0.04045 / 12.92, light * 12.92, 1.055 * np.maximum(light, 0) ** (1 / 2.4) - 0.055)


def linear_light(color: NDArray[np.floating]) -> Float32:
    """:func:`linear_of_srgb` in single precision."""
    return linear_of_srgb(color).astype(np.float32)


def relight(color: NDArray[np.floating], factor: NDArray[np.floating] | float) -> Float32:
    """sRGB colours (…, 3) whose light is multiplied by a factor that broadcasts to them; not clipped."""
    return srgb_of_linear(linear_of_srgb(color) * factor).astype(np.float32)


def log_slope(color: NDArray[np.floating]) -> Float32:
    """(…) by how much the logarithm of light changes with the code, of codes (…) in [0, 1]; no factor of light changes the
    logarithm's noise, so a factor multiplies a code's noise by the slope before it over the slope after it."""
    code = np.maximum(np.asarray(color, dtype=np.float32), np.float32(HALF_LEVEL))
    return np.where(code <= 0.04045, 1 / code, 2.4 / (code + 0.055)).astype(np.float32)


def light_certainty(color: NDArray[np.floating]) -> Float32:
    """(…) weight of codes (…) in an estimate of light, 0 to 1: the inverse of the logarithm's variance, that of grain alone being
    1; 0 where the code may be clipped."""
    noise = np.square(CODE_NOISE / GRAIN * log_slope(color))
    open_above = np.clip((CLIPPED - np.asarray(color, dtype=np.float32)) / (CLIPPED - UNCLIPPED), 0, 1)
    return (open_above / (1 + noise)).astype(np.float32)
