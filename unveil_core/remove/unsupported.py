"""Loose ends of removed objects: surfels close to them that no frame shows beside them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Mask
from unveil_core.drives.depth_range import FAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.grid import PointGrid

__all__ = ["unsupported"]

LEAST_FRAMES = 2
"""Least number of frames that must show the object where a loose end would be."""


def unsupported(
    means: NDArray[np.float64], gone: Mask, cameras: Sequence[Camera], masks: Sequence[Mask], *, reach: float
) -> Mask:
    """(N,) surfels not yet removed that lie close to a removed one and are masked wherever that one is.

    No frame that shows the object supports such a surfel: it is a piece of the object with another label, or was placed where
    the object occludes everything.

    Args:
        means: (N, 3); gone: (N,) surfels that are removed.
        cameras, masks: of the labelled frames; (H, W) True where a frame shows what is removed.
        reach: largest distance from a removed surfel, metres.
    """
    found = np.zeros(len(means), dtype=bool)
    if not gone.any() or gone.all():
        return found
    others = np.flatnonzero(~gone)
    gap, nearest = cKDTree(means[gone]).query(means[others], distance_upper_bound=reach)
    close = np.isfinite(gap)
    others, beside = others[close], means[gone][nearest[close]]
    hidden, shown = np.zeros(len(others), dtype=int), np.zeros(len(others), dtype=bool)
    grid = PointGrid(means[others])
    for camera, mask in zip(cameras, masks, strict=True):
        index = grid.near(camera.centre, FAR_M)
        in_view, masked = camera.fall_in(means[others[index]], mask)
        _, object_masked = camera.fall_in(beside[index], mask)
        hidden[index] += object_masked & masked
        shown[index] |= object_masked & in_view & ~masked
    found[others[(hidden >= LEAST_FRAMES) & ~shown]] = True
    return found
