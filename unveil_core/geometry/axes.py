"""Axes of a world of which only the up direction is known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["UP", "up_frame", "upright"]

UP = np.array([0.0, 0.0, 1.0])
"""(3,) up, inside."""
UP.flags.writeable = False


def up_frame(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) rotation whose rows are two horizontal axes and ``up``."""
    up = up / np.linalg.norm(up)
    helper = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    east = np.cross(helper, up)
    east /= np.linalg.norm(east)
    return np.stack([east, np.cross(up, east), up])


def upright(up: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) rotation that brings z to ``up`` (3,), and x to the level direction nearest to x; where x itself is up, to y."""
    east, north, up = up_frame(up)
    return np.stack([north, -east, up], axis=1) + 0.0  # no negative zeros
