"""The way of the drive as the page follows it: places and directions of view, smooth and evenly spaced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive
from unveil_core.geometry.camera import Camera
from unveil_core.ground.path import first_of_places, travelled
from unveil_core.ground.track import longest_track

__all__ = ["Way", "looking", "stretch_of", "way_along"]

STEP_M = 0.25
"""Between the samples of a way, metres."""
SMOOTHED_M = 3.0
"""Standard deviation of the smoothing, metres: a car's weaving and nodding go, the bends of a street stay."""


@dataclass(frozen=True, eq=False)
class Way:
    """S samples of a way, one every :data:`STEP_M`; one only where the car stands.

    Attributes:
        eyes: (S, 3) places, local metres.
        views: (S, 3) unit directions of view.
    """

    eyes: Float64
    views: Float64

    @property
    def length(self) -> float:
        """Metres."""
        return (len(self.eyes) - 1) * STEP_M

    def at(self, s: Float64) -> tuple[Float64, Float64]:
        """Places and unit directions (M, 3) after ways (M,) of metres."""
        node = np.arange(len(self.eyes)) * STEP_M
        eyes, views = (np.stack([np.interp(s, node, v[:, k]) for k in range(3)], 1) for v in (self.eyes, self.views))
        return eyes, views / np.linalg.norm(views, axis=1, keepdims=True)


def way_along(drive: Drive) -> Way:
    """The way of the camera that the street's path follows, and how it looked; the drive has at least one frame."""
    cameras = [drive.frames[i].camera for i in longest_track(drive)]
    first = first_of_places(np.stack([c.centre for c in cameras]))
    eyes = np.stack([cameras[i].centre for i in first])
    views = np.stack([cameras[i].forward for i in first])
    so_far = travelled(eyes)
    if so_far[-1] < STEP_M:
        return Way(eyes[:1], views[:1])
    s = np.arange(0.0, so_far[-1], STEP_M)
    smooth = [
        gaussian_filter1d(np.stack([np.interp(s, so_far, v[:, k]) for k in range(3)], 1), SMOOTHED_M / STEP_M, axis=0)
        for v in (eyes, views)
    ]
    return Way(smooth[0], smooth[1] / np.maximum(np.linalg.norm(smooth[1], axis=1, keepdims=True), 1e-9))


def stretch_of(way: Way, places: Float64, length_m: float) -> tuple[Way, float]:
    """The part of a way beside which most of some places lie, the middle of equals; all of a way that is no longer.

    Args:
        places: (K, 3), K may be 0.
        length_m: of the part at most.
    Returns:
        the part, and the metres of way before it.
    """
    count = round(length_m / STEP_M) + 1
    starts = np.arange(max(1, len(way.eyes) - count + 1))
    beside = np.sort(cKDTree(way.eyes[:, :2]).query(places[:, :2])[1]) if len(places) else np.zeros(0, np.int64)
    beside_part = np.searchsorted(beside, starts + count) - np.searchsorted(beside, starts)
    best = np.flatnonzero(beside_part == beside_part.max())
    start = int(best[len(best) // 2])
    return Way(way.eyes[start : start + count], way.views[start : start + count]), start * STEP_M


def looking(eye: Float64, target: Float64, up: Float64, size: tuple[int, int], focal: float) -> Camera:
    """A level camera at ``eye`` (3,) that looks at ``target`` (3,); size: width and height; focal: pixels."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    matrix[:3, 3] = -matrix[:3, :3] @ eye
    return Camera(size[0], size[1], focal, focal, size[0] / 2, size[1] / 2, matrix)
