"""Points on the ground to start from, where nothing measured it: as far as labels or photographs tell where it is seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from unveil_core.base.frame_cache import FrameCache, Frames, subset
from unveil_core.base.mechanisms import on
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64, Levels, Mask
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.drives.drive import Drive, tracks
from unveil_core.drives.scale_and_up import camera_height
from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import mask_bits, mask_of_bits
from unveil_core.geometry.reach import centres_of
from unveil_core.ground.by_photographs import StreetViews, heights_over_ground, lane_ahead, shows_ground, street_axes
from unveil_core.ground.path import StreetPath, fit_path
from unveil_core.ground.plain_fit import cross_profile, plain_heights
from unveil_core.ground.street import Ground
from unveil_core.ground.track import longest_track
from unveil_core.semantics.classes import GROUND_CLASSES
from unveil_core.semantics.labels import SceneLabels

__all__ = ["MEASURED", "GroundStart", "measured_lane", "start_ground"]

MEASURED = 0.3
"""Share of the lane ahead that is measured from which on its ground is known: a LiDAR measures nearly all, few points of structure
from motion lie on asphalt."""
ASIDE_M, BEYOND_M = 10.0, 40.0
"""How far aside of the path, and beyond the last camera, ground is looked for, metres."""
ALONG, SMOOTHED_M = (1.5, 6.0), 2.0
"""Heights of the camera ahead of it between which a frame's plane tells the ground, and over how many metres these are smoothed."""
BELOW_M = 0.35
"""Where photographs tell no height, points are of the ground if they depart by no more from what most tell of it, metres: a kerb,
and a slope between points and camera."""
ACROSS_M = 0.2
"""Cells of the ground across the street, metres: a kerb is a step."""
SHARE = 0.5
"""Of the frames that look at a place from nearby, which must show ground there; and of the surfels, those that start there."""
NEAR = 15.0
"""Heights of the camera up to which a frame tells whether a place is ground."""


@dataclass(frozen=True, eq=False)
class GroundStart:
    """The ground before there is a scene.

    Attributes:
        told_by: ``"photographs"`` that agree on its height, or ``"points"`` that lie on it.
        height: of the cameras over it, the median, metres.
        street: its height; points: (G, 3) where it is seen, spacing: between them, metres.
        shown: (H, W) per frame, pixels that show it.
    """

    told_by: str
    height: float
    street: Ground
    points: Float64
    spacing: float
    shown: Sequence[Mask]


def start_ground(
    drive: Drive,
    scene: SceneLabels,
    images: Sequence[Levels],
    labels: Sequence[NDArray[np.int64]],
    measured: float | None,
    *,
    budget: int,
    hidden: Sequence[Mask] | None = None,
    cache: FrameCache | None = None,
    progress: Progress = no_progress,
) -> GroundStart | None:
    """The ground of a drive that no LiDAR measured; None where one did, or where nothing tells.

    Args:
        images: (H, W, 3); labels: (H, W), negative = unknown; of all frames.
        measured: share of the lane that is, see :func:`measured_lane`.
        budget: surfels to start with.
        hidden: (H, W) per frame, pixels that show what does not stand; None = no such pixels.
    """
    cameras = [f.camera for f in drive.frames]
    cache = cache or FrameCache()
    track = longest_track(drive)
    of_track = [cameras[i] for i in track]
    if measured is None or measured > MEASURED or not on("ground_by_photographs"):
        return None

    def barred(i: int) -> Mask:
        mask: Mask = np.isin(labels[i], scene.removable_labels)
        return mask if hidden is None else mask | hidden[i]

    views = StreetViews.of(of_track, subset(images, track), cache)
    of_points = camera_height(drive, UP)
    told = heights_over_ground(
        views, Frames(len(track), lambda k: barred(track[k])), usual=of_points, progress=progress
    )
    told_by = "photographs" if told is not None else "points"
    if told is None and of_points is not None:
        # Plain asphalt looks alike at any height.
        told = np.full(len(track), of_points), _points_below(drive.points.positions, cameras, of_points)
    if told is None:
        return None
    street = _ground(fit_path(of_track), of_track, views.axes, *told)
    over = np.maximum(street.over(street.path.to_street(centres_of(cameras))), NEAR_M)
    wanted = scene.labels.indices(GROUND_CLASSES)
    shown: Sequence[Mask]
    if wanted:
        shown = Frames(len(cameras), lambda i: np.isin(labels[i], wanted) & ~barred(i))
    else:
        bits: dict[int, NDArray[np.uint8]] = {}
        for one in tracks(drive):
            own = StreetViews.of([cameras[i] for i in one], subset(images, one), cache)
            for k, i in enumerate(one):
                mask = shows_ground(own, k, float(over[i]), (cameras[i].height, cameras[i].width))
                bits[i] = mask_bits(mask & ~barred(i))
                progress(len(bits), len(cameras), "looking for the ground")
        shown = Frames(len(cameras), lambda i: mask_of_bits(bits[i], (cameras[i].height, cameras[i].width)))
    without = Frames(len(cameras), barred)
    points, spacing = _seen_places(street, cameras, over, shown, without, round(SHARE * budget))
    if not len(points):
        return None
    return GroundStart(told_by, float(np.median(over)), street, points, spacing, shown)


def measured_lane(drive: Drive, measured: Sequence[Mask]) -> float | None:
    """Share of the lane ahead of the longest track's cameras on which points lie close together, ``measured`` (H, W) per frame;
    None where no lane is seen."""
    track = longest_track(drive)
    cameras = [drive.frames[i].camera for i in track]
    lanes = [lane_ahead(camera, street_axes(cameras, k)) for k, camera in enumerate(cameras)]
    share = [float(measured[i][lane].mean()) for i, lane in zip(track, lanes, strict=True) if lane.any()]
    return float(np.mean(share)) if len(track) > 1 and share else None


def _points_below(points: Float64, cameras: Sequence[Camera], height: float) -> Float64:
    """(P, 3) points that lie about so far below the nearest camera."""
    centres = centres_of(cameras)
    drop = (centres[cKDTree(centres).query(points)[1]] - points) @ UP
    return points[np.abs(drop - height) < BELOW_M]


def _ground(
    path: StreetPath, cameras: Sequence[Camera], axes: Sequence[Float64], heights: Float64, seen: Float64
) -> Ground:
    """The ground under a track: what its places tell, beginning with each camera's plane where it looks at it.

    Args:
        heights: (F,) of the cameras over it; seen: (P, 3) places on it.
    """
    planes = []
    for i, (camera, (_, ahead, up), height) in enumerate(zip(cameras, axes, heights, strict=True)):
        first = -BEYOND_M / 4 if i == 0 else ALONG[0] * height
        last = BEYOND_M if i == len(cameras) - 1 else ALONG[1] * height
        planes += [camera.centre + a * ahead - height * up for a in np.arange(first, last, 1.0)]
    street = path.to_street(np.stack(planes))
    rows = np.arange(np.floor(street[:, 0].min()), np.ceil(street[:, 0].max()) + 1)
    order = np.argsort(street[:, 0], kind="stable")
    level = gaussian_filter1d(np.interp(rows, street[order, 0], street[order, 2]), SMOOTHED_M, mode="nearest")
    columns = ACROSS_M * np.arange(2 * round(ASIDE_M / ACROSS_M) + 1) - ASIDE_M
    side = np.full(len(rows), ASIDE_M)
    places = path.to_street(seen)
    height = plain_heights(np.concatenate([places, street]), np.zeros((0, 3)), rows, columns, level)  # type: ignore[arg-type]
    plain = Ground(path, float(rows[0]), -ASIDE_M, 1.0, ACROSS_M, height, side, -side)
    profile = cross_profile(np.column_stack([places[:, 1], plain.over(places)]), columns)  # type: ignore[arg-type]
    return replace(plain, height=height + profile)


def _seen_places(
    street: Ground,
    cameras: Sequence[Camera],
    over: Float64,
    shown: Sequence[Mask],
    barred: Sequence[Mask],
    most: int,
) -> tuple[Float64, float]:
    """Places (G, 3) on the ground that most frames near them show, no more than ``most``, and the spacing between them.

    Args:
        over: (F,) heights of the cameras over it.
    """
    length = street.s_cell * (len(street.height) - 1)
    for spacing in 0.1 * 1.25 ** np.arange(20):
        # Whole multiples, so that a last bit in the street's ends moves no other place.
        first, last = np.ceil(street.s_start / spacing), np.floor((street.s_start + length) / spacing)
        s = spacing * np.arange(first, last + 1)
        t = spacing * np.arange(-(ASIDE_M // spacing), ASIDE_M // spacing + 1)
        if len(s) * len(t) > 8 * most:
            continue
        grid = np.stack([part.ravel() for part in np.meshgrid(s, t, indexing="ij")], axis=1)
        places = street.path.to_world(np.column_stack([grid, street.height_at(grid[:, 0], grid[:, 1])]))
        for_it, all_of_them = np.zeros(len(places)), np.zeros(len(places))
        for camera, height, mask, without in zip(cameras, over, shown, barred, strict=True):
            pixel, depth = camera.project(places)
            near = np.flatnonzero(camera.in_picture(pixel, depth, nearest=NEAR_M) & (depth < NEAR * height))
            column, row = pixel[near, 0].astype(int), pixel[near, 1].astype(int)
            told = ~without[row, column]
            near, row, column = near[told], row[told], column[told]
            for_it[near] += mask[row, column]
            all_of_them[near] += 1
        seen = for_it > SHARE * all_of_them
        if seen.sum() <= most:
            return places[seen], float(spacing)
    return np.zeros((0, 3)), 1.0
