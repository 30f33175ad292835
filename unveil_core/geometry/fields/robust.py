"""Differences between two pictures of the same, some of which show two different things."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32

__all__ = ["MAD_TO_DEVIATION", "held_near_median"]

MAD_TO_DEVIATION = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""
OUTLIER = 2.5
"""Standard deviations beyond which a difference counts as no more."""


def held_near_median(differences: NDArray[np.floating], told: NDArray[np.floating], least: float) -> Float32:
    """(..., C) differences, none farther from the median than it may be by chance.

    Args:
        told: (N, C) those by which median and deviation are told; least: the least standard deviation.
    """
    middle = np.median(told, axis=0)
    spread = MAD_TO_DEVIATION * np.median(np.abs(told - middle), axis=0) + least
    held: Float32 = np.clip(differences, middle - OUTLIER * spread, middle + OUTLIER * spread).astype(np.float32)
    return held
