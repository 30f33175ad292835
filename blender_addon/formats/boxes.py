# SPDX-License-Identifier: GPL-3.0-or-later
"""Upright boxes in scene coordinates: corners, lines, and which one lies under the pointer. No bpy here."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

__all__ = ["EDGES", "SceneBox", "box_around", "corners_of", "pick", "within"]

SIGNS = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=np.float64) / 2
EDGES = tuple((a, b) for a in range(8) for b in range(a + 1, 8) if bin(a ^ b).count("1") == 1)
"""Pairs of corners that the twelve edges join."""


@dataclass(frozen=True)
class SceneBox:
    """An upright box: centre and size (length, width, height) in metres, yaw of the length, counterclockwise from x, radians."""

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    yaw: float

    @property
    def corners(self) -> np.ndarray:
        """(8, 3)."""
        return corners_of(np.array([self.centre]), np.array([self.size]), np.array([self.yaw]))[0]


def box_around(corners: np.ndarray, yaw: float) -> SceneBox:
    """The upright box of a given yaw around some points (N, 3)."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    local = corners @ turn.T
    low, high = local.min(axis=0), local.max(axis=0)
    x, y, z = (float(v) for v in ((low + high) / 2) @ turn)
    length, width, height = (float(v) for v in high - low)
    return SceneBox((x, y, z), (length, width, height), yaw)


def corners_of(centres: np.ndarray, sizes: np.ndarray, yaws: np.ndarray) -> np.ndarray:
    """(N, 8, 3) corners of boxes given by (N, 3), (N, 3) and (N,)."""
    local = SIGNS[None] * sizes[:, None]
    cos, sin = np.cos(yaws)[:, None], np.sin(yaws)[:, None]
    x, y, z = local[..., 0], local[..., 1], local[..., 2]
    return np.stack([x * cos - y * sin, x * sin + y * cos, z], axis=2) + centres[:, None]


def pick(
    pointer: tuple[float, float], corners: np.ndarray, perspective: np.ndarray, size: tuple[int, int]
) -> int | None:
    """Which box lies under the pointer, the one of the nearest middle where several do; None where none does.

    Args:
        pointer: (x, y) pixels from the lower left.
        corners: (N, 8, 3) of the boxes.
        perspective: (4, 4) to clip coordinates; size: (width, height) of the view, pixels.
    """
    outline, depth, before = _outlines(corners, perspective, size)
    point = np.asarray(pointer, np.float64)
    around = before & (outline.min(axis=1) <= point).all(axis=1) & (outline.max(axis=1) >= point).all(axis=1)
    under = [int(i) for i in np.flatnonzero(around) if _inside(point, outline[i])]
    return min(under, key=lambda i: depth[i].mean(), default=None)


def within(
    rectangle: tuple[float, float, float, float], corners: np.ndarray, perspective: np.ndarray, size: tuple[int, int]
) -> np.ndarray:
    """(N,) bool: whether the middle of a box, as the view shows it, lies in a rectangle.

    Args:
        rectangle: left, bottom, right, top, pixels from the lower left; the others as :func:`pick`.
    """
    outline, _, before = _outlines(corners, perspective, size)
    middle = outline.mean(axis=1)
    low, high = np.asarray(rectangle[:2]), np.asarray(rectangle[2:])
    return np.asarray(before & (middle >= low).all(axis=1) & (middle <= high).all(axis=1))


def _outlines(
    corners: np.ndarray, perspective: np.ndarray, size: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (N, 8, 2) of corners in the view, pixels; their depths (N, 8); whether a box lies before the viewer (N,)."""
    clip = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=2) @ perspective.T
    depth = clip[..., 3]
    before = (depth > 1e-6).all(axis=1)  # a box that reaches behind the viewer has no outline
    return (clip[..., :2] / np.where(before[:, None], depth, 1.0)[..., None] + 1) / 2 * np.asarray(size), depth, before


def _inside(point: np.ndarray, corners: np.ndarray) -> bool:
    """Whether a point (2,) lies in the convex hull of some corners (N, 2): then no line parts them."""
    offset = corners - point
    angles = np.sort(np.arctan2(offset[:, 1], offset[:, 0]))
    gaps = np.diff(np.concatenate([angles, angles[:1] + 2 * math.pi]))
    return bool(gaps.max() < math.pi)
