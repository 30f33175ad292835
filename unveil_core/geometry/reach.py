"""Which cameras come near some points at all: on a long drive few do, and only they are asked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64
from unveil_core.geometry.camera import Camera

__all__ = ["cameras_near", "centres_of"]


def centres_of(cameras: Sequence[Camera]) -> Float64:
    """(V, 3) optical centres."""
    return np.stack([c.centre for c in cameras]) if len(cameras) else np.zeros((0, 3))


def cameras_near(centres: Float64, points: Float64, reach: float) -> NDArray[np.int64]:
    """Indices, rising, of the cameras within ``reach`` of the box around points (N, 3), metres; none where there are no points.

    Args:
        centres: (V, 3) of the cameras.
    """
    if not len(points):
        return np.zeros(0, dtype=np.int64)
    low, high = points.min(axis=0), points.max(axis=0)
    gap = np.maximum(np.maximum(low - centres, centres - high), 0.0)
    return np.flatnonzero((gap * gap).sum(axis=1) <= reach * reach)
