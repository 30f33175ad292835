"""Projection in compiled code: charts and clouds have millions of points, of which a view shows few."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT

__all__ = ["pixel_of", "project_shown"]


@njit(**EXACT)
def pixel_of(x, y, z, turn, shift, intrinsics, nearest):
    """Pixel and depth of a place; depth 0 where it is not before the camera or not in its picture.

    Args:
        x, y, z: world coordinates; turn (3, 3), shift (3,): from there to the camera's.
        intrinsics: see ``Camera.intrinsics``; nearest: depth that must be exceeded, 0 or more.
    """
    width, height, fx, fy, cx, cy = intrinsics
    depth = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + shift[2]
    if not depth > nearest:
        return 0.0, 0.0, 0.0
    u = (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + shift[0]) / depth * fx + cx
    v = (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + shift[1]) / depth * fy + cy
    if not (0 <= u < width and 0 <= v < height):
        return 0.0, 0.0, 0.0
    return u, v, depth


@njit(**EXACT)
def project_shown(first, stop, points, turn, shift, intrinsics, nearest, furthest, found):
    """Pixel and depth of points (P, 3) into ``found`` (P, 3); depth 0 where the picture does not show them."""
    for i in range(first, stop):
        u, v, depth = pixel_of(points[i, 0], points[i, 1], points[i, 2], turn, shift, intrinsics, nearest)
        found[i, 2] = 0.0
        if 0 < depth < furthest:
            found[i, 0], found[i, 1], found[i, 2] = u, v, depth
