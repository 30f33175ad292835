"""Which points a frame shows, in one pass: a long drive asks hundreds of frames for each of the points that nobody saw."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

from unveil_core.base.parallel import EXACT

__all__ = ["DEPTHS", "mark_shown", "mark_sky"]

DEPTHS = np.arange(1 << 16, dtype=np.uint16).view(np.float16).astype(np.float32)
"""(65536,) what each bit pattern of a half float stands for: compiled code has no such type."""
NEAREST = 1e-6
"""As in ``Camera.in_picture``."""


@njit(**EXACT)
def pixel_of(x, y, z, fx, fy, cx, cy, width, height):
    """Row and column of a point in the camera's frame; -1 outside the picture."""
    if z <= NEAREST:
        return -1, -1
    u, v = x / z * fx + cx, y / z * fy + cy
    if u < 0 or v < 0 or u >= width or v >= height:
        return -1, -1
    return int(v), int(u)


@njit(**EXACT)
def mark_shown(first, end, points, seen, turn, shift, fx, fy, cx, cy, depth_bits, hidden, depths):
    """Mark the points (P, 3) that the frame shows: with no surface and no removed object in front.

    ``depth_bits`` (H, W) uint16: half floats, depth up to which something is visible.
    """
    height, width = hidden.shape
    for i in range(first, end):
        if seen[i]:
            continue
        a, b, c = points[i, 0], points[i, 1], points[i, 2]
        x = turn[0, 0] * a + turn[0, 1] * b + turn[0, 2] * c + shift[0]
        y = turn[1, 0] * a + turn[1, 1] * b + turn[1, 2] * c + shift[1]
        z = turn[2, 0] * a + turn[2, 1] * b + turn[2, 2] * c + shift[2]
        row, column = pixel_of(x, y, z, fx, fy, cx, cy, width, height)
        if row >= 0 and not hidden[row, column] and depths[depth_bits[row, column]] > z:
            seen[i] = 1


@njit(**EXACT)
def mark_sky(first, end, directions, seen, turn, fx, fy, cx, cy, sky, hidden):
    """Mark the directions (P, 3) in which the frame shows sky, and no removed object."""
    height, width = hidden.shape
    for i in range(first, end):
        if seen[i]:
            continue
        a, b, c = directions[i, 0], directions[i, 1], directions[i, 2]
        x = turn[0, 0] * a + turn[0, 1] * b + turn[0, 2] * c
        y = turn[1, 0] * a + turn[1, 1] * b + turn[1, 2] * c
        z = turn[2, 0] * a + turn[2, 1] * b + turn[2, 2] * c
        row, column = pixel_of(x, y, z, fx, fy, cx, cy, width, height)
        if row >= 0 and sky[row, column] and not hidden[row, column]:
            seen[i] = 1
