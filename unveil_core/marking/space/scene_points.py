"""The scene as points, before it is reconstructed or after: where clicks hit it, and which frames see what."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64, Mask
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.drives.drive import Drive, tracks
from unveil_core.geometry.cloud import estimate_normals, thinned_to
from unveil_core.ground.from_points import find_ground
from unveil_core.ground.height_field import HeightField
from unveil_core.semantics.visibility import PointsInView, PointsNear

__all__ = ["ABOVE_GROUND_M", "ScenePoints", "scene_points"]

MOST_POINTS = 400_000
"""Points that are looked at from every frame, however long the drive is; more are thinned."""
ABOVE_GROUND_M = 0.08
"""Points no higher over the ground than this, metres, are the ground's. With 0.15 wheels lose their lowest points, outlines of
the sample scenes 1 % (``benchmarks/input/clicks.py``)."""
OWN_WIDTH_M, OWN_LENGTH_M = 1.2, 3.0
"""Points no farther aside of the cameras' way than half a vehicle's width, metres, are of the vehicle itself, which LiDARs measure,
too; so are those that lie this far before its last place and behind its first, about as high as the cameras: of its roof."""
BELOW_CAMERA_M = (1.3, 0.3)
"""No lower than the cameras than this, metres: on the way, and at its ends."""


@dataclass(frozen=True, eq=False)
class ScenePoints:
    """Points of a scene and the frames that see them.

    Attributes:
        positions: (P, 3) local, metres; spacing: (P,) to the next ones, metres.
        normals: (P, 3) unit; colors: (P, 3) from 0 to 1.
        over: (P,) height over the ground, metres; NaN where none is known.
        ground: its height; None where too few points lie on any.
        views: of each frame, the points that it sees.
        measured: whether they lie on whatever there is: those that photographs show are missing on plain paint and panes, and some
            float between things.
    """

    positions: Float64
    spacing: Float64
    normals: Float64
    colors: Float64
    over: Float64
    ground: HeightField | None
    views: Sequence[PointsInView]
    measured: bool = True

    @property
    def standing(self) -> Mask:
        """(P,) points that are no ground."""
        found: Mask = ~(self.over <= ABOVE_GROUND_M)
        return found


def scene_points(
    drive: Drive,
    surface: tuple[Float64, Float64] | None = None,
    *,
    measured: bool = True,
    cache: FrameCache | None = None,
    progress: Progress = no_progress,
) -> ScenePoints:
    """The points of a drive, or of the scene that was reconstructed of it.

    Args:
        drive: imported; its points are used where there is no scene.
        surface: positions (S, 3) and normals (S, 3) of the reconstructed scene.
        measured: see :class:`ScenePoints`.
        cache: room for the frames; progress: called per frame.
    """
    cameras = [f.camera for f in drive.frames]
    points = drive.points if drive.points.moving is None else drive.points.select(~drive.points.moving)
    positions = points.positions if surface is None else surface[0]
    some = thinned_to(positions, MOST_POINTS)
    if surface is None:
        some = some[~_of_own_vehicle(drive, positions[some])]
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

    colors = np.zeros((len(positions), 3))
    if surface is None and points.colors is not None:
        colors = points.colors[some] / 255.0
    views = (cache or FrameCache()).frames(len(cameras), seen)
    return ScenePoints(positions, spacing, normals, colors, over, ground, views, measured)


def _of_own_vehicle(drive: Drive, positions: Float64) -> Mask:
    """(P,) points of the vehicle that carries the cameras: as lone points just before them they would hide all else."""
    found = np.zeros(len(positions), dtype=bool)
    for track in tracks(drive):
        way = np.stack([drive.frames[v].camera.centre for v in track])
        ahead = way[-1] - way[0]
        length = float(np.linalg.norm(ahead[:2]))
        if length < OWN_WIDTH_M:
            continue
        ahead = ahead / length
        ends = [np.stack([way[0] - OWN_LENGTH_M * ahead, way[0]]), np.stack([way[-1], way[-1] + OWN_LENGTH_M * ahead])]
        for line, below in zip((way, *ends), (BELOW_CAMERA_M[0], *[BELOW_CAMERA_M[1]] * 2), strict=True):
            dense = np.concatenate([np.linspace(a, b, 12) for a, b in zip(line[:-1], line[1:], strict=True)])
            away, nearest = cKDTree(dense[:, :2]).query(positions[:, :2], distance_upper_bound=OWN_WIDTH_M)
            beside = np.isfinite(away)
            found[beside] |= positions[beside, 2] > dense[nearest[beside], 2] - below
    return found
