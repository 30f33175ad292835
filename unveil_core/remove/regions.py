"""The regions of a frame: nothing removed, observed, seen elsewhere, unobserved.

Which pixels are unobserved is decided in ``remove.observed``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["NOTHING", "OBSERVED", "SEEN_ELSEWHERE", "UNOBSERVED", "region_map"]

NOTHING, OBSERVED, SEEN_ELSEWHERE, UNOBSERVED = 0, 1, 2, 3


def region_map(
    removed: NDArray[np.bool_], object_pixels: NDArray[np.bool_], unobserved: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """(H, W) uint8: 0 nothing removed; 1 observed by this view itself (the mask's border around the object);
    2 seen from other views; 3 unobserved."""
    regions = np.where(removed, np.where(object_pixels, SEEN_ELSEWHERE, OBSERVED), NOTHING)
    return np.where(unobserved, UNOBSERVED, regions).astype(np.uint8)
