"""Points of a drive, a few of them, and how many of these its cameras see."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.cloud import every_nth

__all__ = ["points_in_view", "seen_share", "some_points"]

MOST_POINTS = 20_000
SWEEPS = 3
"""Of a drive that has no other points, so many sweeps are read: a tenth of a second to a second each."""
TRIED_POINTS, TRIED_CAMERAS = 3000, 60


def some_points(drive: Drive) -> Float64:
    """(P, 3) points of a drive, evenly from all of them, of a drive with sweeps from a few; those that cannot be read are left out
    here."""
    if len(drive.points.positions):
        return every_nth(drive.points.positions, MOST_POINTS)
    found = []
    count = len(drive.sweeps)
    for k in sorted({(2 * i + 1) * count // (2 * SWEEPS) for i in range(SWEEPS)} if count else ()):
        with suppress(DriveError):
            positions = drive.sweeps[k].read().positions
            found.append(every_nth(positions[np.isfinite(positions).all(axis=1)], MOST_POINTS // SWEEPS))
    return np.concatenate(found) if found else np.zeros((0, 3))


def seen_share(positions: Float64, cameras: Sequence[Camera]) -> float:
    """Share of the points (P, 3) that lie in the picture of a camera, by a sample of both; 0 where there are none."""
    points = every_nth(positions, TRIED_POINTS)
    seen = np.zeros(len(points), dtype=bool)
    for camera in cameras[:: max(1, -(-len(cameras) // TRIED_CAMERAS))] if len(points) else ():
        pixels, depth = camera.project(points)
        seen |= camera.in_picture(pixels, depth)
    return float(seen.mean()) if len(points) else 0.0


def points_in_view(positions: Float64, camera: Camera) -> tuple[Float64, Float64]:
    """Pixels (M, 2) and depths (M,) of the points (P, 3) that lie in a camera's picture."""
    pixels, depth = camera.project(positions)
    inside = camera.in_picture(pixels, depth)
    return pixels[inside], depth[inside]
