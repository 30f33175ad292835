"""Depth continued into holes."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["complete_depth"]


def complete_depth(
    depth: NDArray[np.float32], known: NDArray[np.bool_], wanted: NDArray[np.bool_], ceiling: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Continue inverse depth into ``wanted`` pixels.

    Inverse depth is linear over a plane in the image, so a smooth continuation of it continues planes.

    Args:
        depth: (H, W); known: (H, W) where it can be trusted; wanted: (H, W) where it is asked for.
        ceiling: (H, W) depth of the ground, which nothing can lie behind; inf where there is none.
    """
    usable = known & ~wanted
    inverse = np.where(usable, 1.0 / np.maximum(depth, 1e-6), 0).astype(np.float32)
    if not usable.any():
        return np.where(np.isfinite(ceiling), ceiling, 50.0)
    scale = float(inverse[usable].max())
    filled = cv2.inpaint(inverse / scale, (~usable).astype(np.uint8), 5, cv2.INPAINT_NS) * scale
    floor = float(inverse[usable].min())
    completed = 1.0 / np.maximum(filled.astype(np.float64), floor)
    return np.minimum(np.where(wanted, completed, depth), ceiling)
