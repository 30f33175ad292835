"""The regions of a frame: nothing removed, observed, seen elsewhere, unobserved.

Which pixels are unobserved is decided in ``remove.observed``. The mask of *3D StreetUnveiler*, section 3.2, is here for comparison
only: the benchmark of the reconstruction measures how far it is from the truth.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["NOTHING", "OBSERVED", "SEEN_ELSEWHERE", "UNOBSERVED", "region_map", "unobserved_mask"]

NOTHING, OBSERVED, SEEN_ELSEWHERE, UNOBSERVED = 0, 1, 2, 3


def unobserved_mask(
    alpha_full: NDArray[np.float32],
    alpha_empty: NDArray[np.float32],
    removed: NDArray[np.bool_],
    *,
    drop: float = 0.01,
    opaque: float = 0.99,
    smallest_px: int = 12,
) -> NDArray[np.bool_]:
    """Pixels (H, W) that are unobserved by the paper's rule: alpha falls when the objects are taken out, because no view gave
    surfels for what lies behind.

    Args:
        alpha_full, alpha_empty: (H, W) with and without the objects.
        removed: (H, W) where this view shows a removed object, borders included.
        drop: alpha must fall by more than this (paper: 0.01), to below ``opaque``: sky and glass are no holes.
        smallest_px: smaller specks are no holes.
    """
    hole = (alpha_full - alpha_empty > drop) & (alpha_empty < opaque) & removed
    hole = cv2.morphologyEx(hole.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, component, stats, _ = cv2.connectedComponentsWithStats(hole, connectivity=8)
    large = np.zeros(count, dtype=bool)
    large[1:] = stats[1:, cv2.CC_STAT_AREA] >= smallest_px
    return large[component] & removed


def region_map(
    removed: NDArray[np.bool_], object_pixels: NDArray[np.bool_], unobserved: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """(H, W) uint8: 0 nothing removed; 1 observed by this view itself (the mask's border around the object);
    2 seen from other views; 3 unobserved."""
    regions = np.where(removed, np.where(object_pixels, SEEN_ELSEWHERE, OBSERVED), NOTHING)
    return np.where(unobserved, UNOBSERVED, regions).astype(np.uint8)
