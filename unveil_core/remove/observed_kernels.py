"""Which points a frame shows, in one pass: a long drive asks hundreds of frames for each of the points that nobody saw."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT
from unveil_core.geometry.projection import pixel_of

__all__ = ["DEPTHS", "mark_shown", "mark_sky"]

DEPTHS = np.arange(1 << 16, dtype=np.uint16).view(np.float16).astype(np.float32)
"""(65536,) what each bit pattern of a half float stands for: compiled code has no such type."""
NEAREST = 1e-6
"""As in ``Camera.in_picture``."""


@njit(**EXACT)
def mark_shown(first, end, points, seen, turn, shift, intrinsics, depth_bits, depths):
    """Mark the points (P, 3) that the frame shows: with no surface and no removed object in front.

    ``depth_bits`` (H, W) uint16: half floats, see ``SeenView``.
    """
    for i in range(first, end):
        if not seen[i]:
            u, v, z = pixel_of(points[i, 0], points[i, 1], points[i, 2], turn, shift, intrinsics, NEAREST)
            if z > 0 and depths[depth_bits[int(v), int(u)]] > z:
                seen[i] = 1


@njit(**EXACT)
def mark_sky(first, end, directions, seen, turn, intrinsics, depth_bits, depths):
    """Mark the directions (P, 3) in which the frame shows sky, and no removed object."""
    here = np.zeros(3)
    for i in range(first, end):
        if not seen[i]:
            u, v, z = pixel_of(directions[i, 0], directions[i, 1], directions[i, 2], turn, here, intrinsics, NEAREST)
            if z > 0 and depths[depth_bits[int(v), int(u)]] == np.inf:
                seen[i] = 1
