"""Which of the drive's points lie on movers: a LiDAR draws a thing that drives along as a trail through the empty street."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.semantics.contacts import Contacts
from unveil_core.semantics.ground_points import GroundPoints
from unveil_core.semantics.seen_through import Body

__all__ = ["points_behind_contacts"]

OVER_GROUND_M = 0.12
"""What lies lower is the ground itself."""
SIDE_M = 2.0
"""Contacts that reach so far in depth show a thing's long side; behind them lies no more than its width."""
LONG_SHARE = 2.0
"""Seen from its end a thing may reach so many times its width farther."""


def points_behind_contacts(
    points: NDArray[np.float64],
    mask: NDArray[np.bool_],
    contacts: Contacts,
    camera: Camera,
    body: Body,
    ground: GroundPoints,
) -> NDArray[np.bool_]:
    """(P,) points within a mover as one frame shows it: in its pixels, and no farther behind its contacts than it may reach.

    Args:
        points: (P, 3) world; mask: (H, W) of the mover; contacts: its own, may be uncertain.
    """
    inside = np.zeros(len(points), dtype=bool)
    if not len(contacts):
        return inside
    pixel, depth = camera.project(points)
    ok = (depth > 1e-6) & (pixel >= 0).all(axis=1) & (pixel[:, 0] < camera.width) & (pixel[:, 1] < camera.height)
    index = np.flatnonzero(ok)
    index = index[mask[pixel[index, 1].astype(int), pixel[index, 0].astype(int)]]
    if not len(index):
        return inside
    nearest = np.abs(pixel[index, 0, None] - (contacts.columns[None] + 0.5)).argmin(axis=1)
    long_side = float(np.ptp(contacts.depth)) > SIDE_M * ground.unit
    reach = body.depth_m * ground.unit * (1.0 if long_side else LONG_SHARE)
    error = 2 * contacts.error[nearest]
    behind = depth[index] - contacts.depth[nearest]
    hit = (behind > -0.4 * ground.unit - error) & (behind < reach + error)
    index = index[hit]
    inside[index] = ground.above(points[index]) > OVER_GROUND_M * ground.unit
    return inside
