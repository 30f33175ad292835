"""The scene as points, before it is reconstructed or after: where clicks hit it, and which frames see what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64, Mask
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.drives.drive import Drive
from unveil_core.geometry.cloud import estimate_normals, thinned_to
from unveil_core.ground.from_points import find_ground
from unveil_core.ground.height_field import HeightField
from unveil_core.semantics.visibility import PointsInView, PointsNear

__all__ = ["ABOVE_GROUND_M", "ScenePoints", "scene_points"]

MOST_POINTS = 400_000
"""Points that are looked at from every frame, however long the drive is; more are thinned."""
ABOVE_GROUND_M = 0.08
"""Points no higher over the ground than this, metres, are the ground's: half of a wheel's flat side, and what LiDARs are off by."""


@dataclass(frozen=True, eq=False)
class ScenePoints:
    """Points of a scene and the frames that see them.

    Attributes:
        positions: (P, 3) local, metres; spacing: (P,) to the next ones, metres.
        normals: (P, 3) unit; colors: (P, 3) from 0 to 1.
        over: (P,) height over the ground, metres; NaN where none is known.
        ground: its height; None where too few points lie on any.
        views: of each frame, the points that it sees.
    """

    positions: Float64
    spacing: Float64
    normals: Float64
    colors: Float64
    over: Float64
    ground: HeightField | None
    views: Sequence[PointsInView]

    @property
    def standing(self) -> Mask:
        """(P,) points that are no ground."""
        found: Mask = ~(self.over <= ABOVE_GROUND_M)
        return found


def scene_points(
    drive: Drive,
    surface: tuple[Float64, Float64] | None = None,
    *,
    cache: FrameCache | None = None,
    progress: Progress = no_progress,
) -> ScenePoints:
    """The points of a drive, or of the scene that was reconstructed of it.

    Args:
        drive: imported; its points are used where there is no scene.
        surface: positions (S, 3) and normals (S, 3) of the reconstructed scene.
        cache: room for the frames; progress: called per frame.
    """
    cameras = [f.camera for f in drive.frames]
    points = drive.points if drive.points.moving is None else drive.points.select(~drive.points.moving)
    positions = points.positions if surface is None else surface[0]
    some = thinned_to(positions, MOST_POINTS)
    positions = positions[some]
    normals, spacing = estimate_normals(positions, np.stack([c.centre for c in cameras]))
    if surface is not None:
        normals = surface[1][some]
    ground = find_ground(drive, (), (), ())
    over = np.full(len(positions), np.nan) if ground is None else ground.over(positions)
    placed = PointsNear(positions, spacing, normals)

    def seen(v: int) -> PointsInView:
        progress(v + 1, len(cameras), "seeing points")
        return placed.seen_by(cameras[v], near=NEAR_M)

    colors = np.zeros((len(positions), 3)) if points.colors is None else points.colors[some] / 255.0
    return ScenePoints(
        positions, spacing, normals, colors, over, ground, (cache or FrameCache()).frames(len(cameras), seen)
    )
