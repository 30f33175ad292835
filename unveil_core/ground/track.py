"""Which of a drive's cameras the street's path follows."""

from __future__ import annotations

import numpy as np

from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive, tracks
from unveil_core.ground.path import way_of

__all__ = ["longest_track"]

ALIKE_WAYS, ASIDE_OF_RIG_M = 0.05, 4.0
"""Tracks whose ways differ by a smaller share, or by fewer metres, are of one rig: in a bend its outer camera goes farther, by a
metre and a half in a quarter turn for each metre that it lies aside."""
AHEAD = 0.1
"""Of a rig's cameras those look ahead whose cosine of the angle between view and way is less than this below the greatest: of these
the first is the path's. A camera amid the car keeps to the middle of its way, one at its side or rear swings."""


def longest_track(drive: Drive) -> list[int]:
    """Frame indices, in order of travel, of the camera that went the longest way; of a rig, of its first that looks ahead.

    Of a car that stands the camera that the dataset calls its front camera, else the first.
    """
    found = tracks(drive)
    centres = [np.stack([drive.frames[i].camera.centre for i in track]) for track in found]
    ways = np.array([way_of(c) for c in centres])
    if not ways.any():
        named = [track for track in found if drive.frames[track[0]].camera_name in drive.front_cameras]
        return (named or found)[0]
    least = min((1 - ALIKE_WAYS) * ways.max(), ways.max() - min(ASIDE_OF_RIG_M, 0.2 * ways.max()))
    ahead = np.full(len(found), -np.inf)
    for k in np.flatnonzero(ways >= least):
        views = np.stack([drive.frames[i].camera.forward for i in found[k]])
        ahead[k] = _looks_ahead(centres[k], views)
    return found[int(np.argmax(ahead > ahead.max() - AHEAD))]


def _looks_ahead(centres: Float64, views: Float64) -> float:
    """Mean cosine between the views (F, 3) of a moving camera and its way through ``centres`` (F, 3), by metres of way."""
    legs = np.diff(centres, axis=0)
    # A frame looks along the way to it as along the way from it; where the car stands there are no metres.
    along = ((views[:-1] + views[1:]) / 2 * legs).sum()
    return float(along / max(float(np.linalg.norm(legs, axis=1).sum()), 1e-9))
