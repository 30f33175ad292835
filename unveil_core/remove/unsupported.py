"""Loose ends of what goes: surfels close to it that no frame shows beside it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Mask
from unveil_core.geometry.camera import Camera

__all__ = ["unsupported"]

LEAST_FRAMES = 2
"""So many frames must show the object where a loose end would be."""


def unsupported(
    means: NDArray[np.float64], gone: Mask, cameras: Sequence[Camera], masks: Sequence[Mask], *, reach: float
) -> Mask:
    """(N,) surfels that stay, though they lie close to one that goes and wherever that is masked they are masked, too.

    Such a surfel is backed by no frame that tells of the object: it is a piece of it that bears another label, or was put
    where the object hides everything.

    Args:
        means: (N, 3); gone: (N,).
        cameras, masks: of the frames that say what they show; (H, W) True where that goes.
        reach: how far from what goes is looked, metres.
    """
    found = np.zeros(len(means), dtype=bool)
    if not gone.any() or gone.all():
        return found
    left = np.flatnonzero(~gone)
    gap, nearest = cKDTree(means[gone]).query(means[left], distance_upper_bound=reach)
    close = np.isfinite(gap)
    left, beside = left[close], means[gone][nearest[close]]
    hidden, shown = np.zeros(len(left), dtype=int), np.zeros(len(left), dtype=bool)
    for camera, mask in zip(cameras, masks, strict=True):
        own_in, own_masked = camera.fall_in(means[left], mask)
        _, object_masked = camera.fall_in(beside, mask)
        hidden += object_masked & own_masked
        shown |= object_masked & own_in & ~own_masked
    found[left[(hidden >= LEAST_FRAMES) & ~shown]] = True
    return found
