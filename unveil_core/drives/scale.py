"""The lengths that depths lie between, and how large a drive's world unit is where nobody says: cameras on streets are about as
high as people and cars."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from unveil_core.drives.drive import Drive

__all__ = ["CAMERA_HEIGHT_M", "FAR_M", "NEAR_M", "camera_height", "units_per_metre"]

NEAR_M, FAR_M = 0.2, 100.0
"""Nearest depth that is rendered or counts as seen, and where the range that distortion is measured in ends; the sky is taken to
be as far away, metres."""
CAMERA_HEIGHT_M = 1.6
"""Assumed height of a camera above the street, metres, where the drive's scale is unknown."""


def camera_height(drive: Drive) -> float:
    """Median height of the cameras over what lies well below their horizon, in world units.

    Points seen more than 12 degrees below the horizontal from their nearest camera are nearly all ground; the median of
    their heights below that camera does not need a scale to be found.
    """
    centres = np.stack([f.camera.centre for f in drive.frames])
    nearest = cKDTree(centres).query(drive.points.positions)[1]
    offset = drive.points.positions - centres[nearest]
    down = -(offset @ drive.up)
    horizontal = np.linalg.norm(offset + down[:, None] * drive.up, axis=1)
    below = (down > 0) & (down > np.tan(np.radians(12)) * horizontal)
    if below.sum() < 20:
        below = down > 0
    if not below.any():
        return CAMERA_HEIGHT_M
    return float(np.median(down[below]))


def units_per_metre(drive: Drive) -> float:
    """World units per metre: 1 for metric drives, else from :func:`camera_height`."""
    return 1.0 if drive.metric else camera_height(drive) / CAMERA_HEIGHT_M
