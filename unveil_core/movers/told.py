"""The points on what a person says moves: in a LiDAR's cloud it leaves a trail through the empty street."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unveil_core.base.types import Mask
from unveil_core.drives.drive import Drive
from unveil_core.geometry.grid import PointGrid
from unveil_core.ground.from_points import find_ground
from unveil_core.movers.contacts import find_contacts
from unveil_core.movers.points import points_behind_contacts
from unveil_core.movers.seen_through import MASKED

__all__ = ["points_told"]


def points_told(drive: Drive, masks: Sequence[Mask]) -> Mask:
    """(P,) the drive's points on what its frames show in masks (H, W): in their pixels, no farther behind where the foot meets the
    ground than an object reaches."""
    points = drive.points.positions
    found = np.zeros(len(points), dtype=bool)
    ground = find_ground(drive, (), (), ())
    if ground is None:
        return found
    grid = PointGrid(points)
    for frame, mask in zip(drive.frames, masks, strict=True):
        if mask.any():
            contacts = find_contacts(mask, ~mask, frame.camera, ground)
            found[points_behind_contacts(points, grid, mask, contacts, frame.camera, MASKED, ground)] = True
    return found
