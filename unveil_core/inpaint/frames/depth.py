"""Depth completion: continues the depth around a hole into it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["complete_depth"]

RADIUS_PX = 5
"""How far the continuation looks around a pixel."""
NOTHING_KNOWN_M = 50.0
"""Depth where a whole frame has none, metres: the end of what a street shows."""


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
        return np.where(np.isfinite(ceiling), ceiling, NOTHING_KNOWN_M)
    completed = depth.astype(np.float64)
    if wanted.any():
        scale, floor = float(inverse[usable].max()), float(inverse[usable].min())
        unknown, part = _around(wanted, ~usable)
        filled = cv2.inpaint(inverse[part] / scale, unknown[part].astype(np.uint8), RADIUS_PX, cv2.INPAINT_NS) * scale
        asked = wanted[part]
        completed[part][asked] = 1.0 / np.maximum(filled[asked].astype(np.float64), floor)
    return np.minimum(completed, ceiling)


def _around(wanted: NDArray[np.bool_], unknown: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], tuple[slice, slice]]:
    """What is unknown (H, W) in one piece with what is wanted, and the part of the image that its continuation looks at.

    Pieces farther apart than the continuation looks do not change one another; the sky is not continued for a hole in the road.
    """
    side = 2 * RADIUS_PX + 1
    joined = cv2.dilate(unknown.astype(np.uint8), np.ones((side, side), np.uint8))
    _, piece = cv2.connectedComponents(joined, connectivity=8)
    joining = unknown & np.isin(piece, np.unique(piece[wanted]))
    rows, columns = np.flatnonzero(joining.any(axis=1)), np.flatnonzero(joining.any(axis=0))
    margin = 2 * RADIUS_PX
    return joining, tuple(slice(max(0, i[0] - margin), i[-1] + margin + 1) for i in (rows, columns))  # type: ignore[return-value]
