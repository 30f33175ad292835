"""Compiled part of the street coordinates: the feet of points on a path."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.types import Float64

__all__ = ["feet_on_path", "foot_on_path"]

STEPS = 6
"""Steps of Newton's method at most, from a node within a metre of the foot: beside a bend of 10 m three leave 1e-4 m, four
nothing."""
CLOSE = 1e-9
"""Parts of a node at which a foot is found."""
LEAST_STRETCH = 0.2
"""Metres in the plan for each along the path, at the least: at the centre of a bend there are none."""


@njit(cache=True)
def foot_on_path(x: float, y: float, first: int, nodes: Float64, heading: Float64, step: float) -> tuple[float, float]:
    """Node and part of a node at the foot of one point, and its offset to the left; see :func:`feet_on_path`."""
    last = len(nodes) - 2
    u, aside = float(first), 0.0
    for _ in range(STEPS):
        i = min(max(int(math.floor(u)), 0), last)
        part = u - i
        turn = heading[i + 1] - heading[i]
        angle = heading[i] + min(max(part, 0.0), 1.0) * turn
        dx = x - nodes[i, 0] - part * (nodes[i + 1, 0] - nodes[i, 0])
        dy = y - nodes[i, 1] - part * (nodes[i + 1, 1] - nodes[i, 1])
        cos, sin = math.cos(angle), math.sin(angle)
        along, aside = dx * cos + dy * sin, dy * cos - dx * sin
        change = along / (step * max(1.0 - aside * turn / step, LEAST_STRETCH))
        u += change
        if abs(change) < CLOSE:
            break
    return u, aside


@njit(cache=True)
def feet_on_path(
    horizontal: Float64, first: NDArray[np.int64], nodes: Float64, heading: Float64, step: float
) -> tuple[Float64, Float64]:
    """Where the feet of points lie on a path, by Newton's method: beside a bend a metre along the path is less or more than one.

    Place and heading are interpolated between nodes; beyond its ends the path goes on straight.

    Args:
        horizontal: (N, 2) points; first: (N,) a node near each.
        nodes: (S, 2), one every ``step`` metres; heading: (S,) radians, without jumps of a whole turn.
    Returns:
        nodes and parts of nodes (N,); offset to the left (N,), metres.
    """
    count = len(first)
    places, offsets = np.empty(count), np.empty(count)
    for k in range(count):
        places[k], offsets[k] = foot_on_path(horizontal[k, 0], horizontal[k, 1], first[k], nodes, heading, step)
    return places, offsets
