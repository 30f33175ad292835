"""Ground that floats: what an object's underside or bumper was taken for, by labels that are a little off."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.grid import PointGrid
from unveil_core.ground.street import Ground

__all__ = ["floating_ground"]

FLOATS_M, HIGHEST_M = 0.4, 4.0
"""Heights over the ground between which what is labelled ground is none, metres: the fitted ground is off by less on a street, and
higher up it is no object's."""
COVERED = 0.5
"""Share of the frames that look at it in which an object must lie there."""
FARTHEST_M = 40.0
"""Distance from which on a frame shows nothing of it, metres."""


def floating_ground(
    means: Float64, on_ground: Mask, street: Ground, cameras: Sequence[Camera], objects: Iterable[NDArray[np.bool_]]
) -> Mask:
    """(N,) which surfels labelled ground float over the street where objects are seen.

    Args:
        means: (N, 3) world; on_ground: (N,) those labelled ground.
        street: its ground.
        cameras: of the frames; objects: (H, W) pixels of removed objects per frame, asked for once each.
    """
    floats = np.zeros(len(means), dtype=bool)
    some = np.flatnonzero(on_ground)
    place = street.path.to_street(means[some])
    over = street.over(place)
    some = some[street.inside(place[:, 0], place[:, 1]) & (over > FLOATS_M) & (over < HIGHEST_M)]
    looked, covered = np.zeros(len(some)), np.zeros(len(some))
    grid = PointGrid(means[some])
    for camera, mask in zip(cameras, objects, strict=True):
        index = grid.near(camera.centre, FARTHEST_M)
        in_view, masked = camera.fall_in(means[some[index]], mask)
        near = np.linalg.norm(means[some[index]] - camera.centre, axis=1) < FARTHEST_M
        looked[index] += in_view & near
        covered[index] += masked & near
    floats[some] = (looked > 0) & (covered >= COVERED * looked)
    return floats
