"""What a removed object may shade: the shadow of its visual hull.

Of a lorry that is never passed only the rear is seen, and its shadow is much longer than that of its surfels. What no picture saw
past it may all belong to it (Laurentini, *The visual hull concept for silhouette-based image understanding*, 1994).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.camera import Camera

__all__ = ["in_shadow_of_hull"]

LOWEST_M, HIGHEST_M, STEP_M = 0.5, 3.5, 0.5
"""Heights over the ground at which a ray to the sun is asked whether it passes the hull, metres: above the noise of masks along the
ground, up to a lorry's roof."""
LEAST_HEIGHTS = 2
"""Heights at which it must: a hull as thin as a step is a mask's border."""


def in_shadow_of_hull(
    points: Float64, towards: Float64, up: Float64, cameras: Sequence[Camera], hidden: Sequence[Mask]
) -> NDArray[np.bool_]:
    """(P,) whether what removed objects hide may keep the sun from points (P, 3) on the ground.

    Args:
        towards: (3,) unit vector to the sun; up: (3,) of the drive.
        cameras, hidden: the views, and which of their pixels (H, W) show what is removed.
    """
    heights = np.arange(LOWEST_M, HIGHEST_M + STEP_M / 2, STEP_M)
    along = towards / max(float(towards @ up), 0.05)
    places = (points[:, None] + heights[:, None] * along).reshape(-1, 3)
    inside, seen = np.ones(len(places), dtype=bool), np.zeros(len(places), dtype=bool)
    for camera, mask in zip(cameras, hidden, strict=True):
        left = np.flatnonzero(inside)
        if not len(left):
            break
        shown, pixel, _ = camera.shown(places[left])
        x, y = pixel.astype(np.int64).T
        seen[left[shown]] = True
        inside[left[shown[~mask[y, x]]]] = False
    return np.asarray((inside & seen).reshape(len(points), -1).sum(axis=1) >= LEAST_HEIGHTS)
