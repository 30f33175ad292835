"""The encoding of pictures on disk, sRGB (IEC 61966-2-1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64

__all__ = ["linear_of_srgb", "srgb_of_linear"]


def linear_of_srgb(color: NDArray[np.floating]) -> Float64:
    """Linear light of sRGB, both 0 to 1, of any shape; beyond these the curve goes on."""
    color = np.asarray(color, dtype=np.float64)
    return np.where(color <= 0.04045, color / 12.92, ((np.maximum(color, 0) + 0.055) / 1.055) ** 2.4)


def srgb_of_linear(light: NDArray[np.floating]) -> Float64:
    """The inverse of :func:`linear_of_srgb`."""
    light = np.asarray(light, dtype=np.float64)
    return np.where(light <= 0.04045 / 12.92, light * 12.92, 1.055 * np.maximum(light, 0) ** (1 / 2.4) - 0.055)
