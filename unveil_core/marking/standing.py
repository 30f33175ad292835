"""An object on which no point lies, or too few: its picture, set up where its foot meets the ground, stands in for its points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64, Mask
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.drives.drive import Drive, tracks
from unveil_core.geometry.camera import Camera
from unveil_core.ground.height_field import HeightField
from unveil_core.marking.asked.prompts import Prompts
from unveil_core.marking.outline import Outliner
from unveil_core.marking.seeds import seeds_of
from unveil_core.marking.space.scene_points import ScenePoints
from unveil_core.semantics.visibility import PointsInView, points_in_view

__all__ = ["carried_standing", "stood_up"]

MOST_POINTS = 600
"""Points that stand in for an object."""
NEAREST = 0.25
"""Of the depths at which the columns of an object's outline meet the ground, this share is nearer than where its picture stands: a
car is seen by its near end, and columns without a wheel meet the ground farther away."""
LOOSE = 0.12
"""By how much an outline may be elsewhere than a flat picture of it says, a share of its size."""
LEAST_PX = 30
"""An outline of fewer pixels is lost."""
SIZES = (0.4, 2.2)
"""How much larger or smaller than expected an outline may be, as a ratio of areas, to stand for the object in the next frame."""
MOST_LOST = 3
"""So many frames in a row may not show it."""


def stood_up(mask: Mask, camera: Camera, ground: HeightField, depth: float | None = None) -> Float64 | None:
    """(K, 3) points of an object's picture, set up facing the camera; None where its foot meets no ground.

    Args:
        mask: (H, W) the object's pixels.
        depth: at which it stands, metres, where points tell.
    """
    rows, columns = np.nonzero(mask)
    if len(rows) < LEAST_PX:
        return None
    if depth is None:
        lowest = np.full(mask.shape[1], -1)
        np.maximum.at(lowest, columns, rows)
        # Where the picture ends the foot is not seen.
        feet = np.flatnonzero((lowest >= 0) & (lowest < mask.shape[0] - 1))
        if not len(feet):
            return None
        rays = camera.rays_at(np.stack([feet + 0.5, lowest[feet] + 1.0], axis=1).astype(np.float64))
        met = ground.first_met(camera.centre, rays, near=NEAR_M, far=FAR_M)
        met = met[np.isfinite(met)]
        if len(met) < max(2, 0.1 * len(feet)):
            return None
        depth = float(np.quantile(met, NEAREST))
    some = np.linspace(0, len(rows) - 1, min(MOST_POINTS, len(rows))).astype(np.int64)
    pixels = np.stack([columns[some], rows[some]], axis=1).astype(np.float64) + 0.5
    return camera.centre + depth * camera.rays_at(pixels)


@dataclass(frozen=True, eq=False)
class _Shown:
    """Points (P, …) of a scene and of an object in it, which of them are the object's (P,), and what a frame sees of them."""

    points: ScenePoints
    own: Mask
    seen: PointsInView


def _with(points: ScenePoints, more: Float64, camera: Camera, view: PointsInView) -> _Shown:
    """The points that one frame sees together with those (K, 3) that stand in for an object."""
    count = len(view.index)
    positions = np.concatenate([points.positions[view.index], more])
    step = float(np.median(cKDTree(more).query(more, k=2)[0][:, 1]))
    spacing = np.concatenate([points.spacing[view.index], np.full(len(more), step)])
    over = np.full(len(more), np.inf) if points.ground is None else points.ground.over(more)
    own = np.arange(len(positions)) >= count
    toward = np.tile(camera.forward, (len(positions), 1))
    shown = ScenePoints(
        positions,
        spacing,
        toward,
        np.zeros_like(positions),
        np.concatenate([points.over[view.index], over]),
        points.ground,
        (),
    )
    return _Shown(shown, own, points_in_view(positions, spacing * np.where(own, 1.0, 0.5), camera, near=NEAR_M))


def carried_standing(
    drive: Drive,
    points: ScenePoints,
    prompts: Prompts,
    outline: Outliner,
    own: Mask,
) -> Sequence[Mask]:
    """(H, W) per frame the pixels of an object on which few points lie or none: from each frame that it was shown in to the next.

    Args:
        own: (P,) the few points.
    """
    frames = drive.frames
    found = [np.zeros((f.camera.height, f.camera.width), dtype=bool) for f in frames]
    for v, prompt in prompts.frames.items():
        found[v] = outline(v, None, prompt)
    if points.ground is None:
        return found
    for v in prompts.frames:
        track = next(t for t in tracks(drive) if v in t)
        place = track.index(v)
        for way in (track[place + 1 :], track[:place][::-1]):
            _along(drive, points, prompts, outline, own, v, way, found)
    return found


def _along(
    drive: Drive,
    points: ScenePoints,
    prompts: Prompts,
    outline: Outliner,
    own: Mask,
    first: int,
    way: Sequence[int],
    found: list[Mask],
) -> None:
    assert points.ground is not None
    seen = points.views[first]
    mine = own[seen.index]
    depth = float(np.median(seen.depth[mine])) if mine.sum() >= 3 else None
    stand = stood_up(found[first], drive.frames[first].camera, points.ground, depth)
    lost = 0
    for v in way:
        if stand is None or v in prompts.frames or lost >= MOST_LOST:
            return
        camera = drive.frames[v].camera
        shown = _with(points, stand, camera, points.views[v])
        seeds = seeds_of(camera, shown.points, shown.own, shown.seen, LOOSE)
        if seeds is None:
            lost += 1
            continue
        mask = outline(v, seeds, None)
        found[v] |= mask
        lost = 0
        if not SIZES[0] < mask.sum() / max(int(seeds.likely.sum()), 1) < SIZES[1]:
            continue
        again = stood_up(mask, camera, points.ground)
        stand = stand if again is None else again
