# SPDX-License-Identifier: GPL-3.0-or-later
"""Upright boxes in scene coordinates: corners, lines, and which one lies under the pointer. No bpy here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["EDGES", "SceneBox", "box_around", "pick"]

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
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return (SIGNS * np.asarray(self.size)) @ turn + np.asarray(self.centre)


def box_around(corners: np.ndarray, yaw: float) -> SceneBox:
    """The upright box of a given yaw around some points (N, 3)."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    local = corners @ turn.T
    low, high = local.min(axis=0), local.max(axis=0)
    x, y, z = (float(v) for v in ((low + high) / 2) @ turn)
    length, width, height = (float(v) for v in high - low)
    return SceneBox((x, y, z), (length, width, height), yaw)


def pick(pointer: tuple[float, float], outlines: Sequence[np.ndarray | None], depths: Sequence[float]) -> int | None:
    """Which box lies under the pointer, the nearest of those that do.

    Args:
        pointer: (x, y) pixels.
        outlines: (8, 2) corners of each box in pixels, None for what is not before the viewer.
        depths: of the boxes' centres.
    """
    under = [i for i, o in enumerate(outlines) if o is not None and _inside(np.asarray(pointer, np.float64), o)]
    return min(under, key=lambda i: depths[i], default=None)


def _inside(point: np.ndarray, corners: np.ndarray) -> bool:
    """Whether a point (2,) lies in the convex hull of some corners (N, 2): then no line parts them."""
    offset = corners - point
    angles = np.sort(np.arctan2(offset[:, 1], offset[:, 0]))
    gaps = np.diff(np.concatenate([angles, angles[:1] + 2 * math.pi]))
    return bool(gaps.max() < math.pi)
