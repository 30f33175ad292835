"""Objects that a frame's labels overlook: a network loses a car in one frame or two that it finds in the others.

Points vote for their label by the frames that see them (``semantics.votes``). A frame that calls a car road in between would make
part of the car road, and the car's colours the street's. Here such frames are found before the votes are counted: they have no say
where they overlook something.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.ndimage import distance_transform_edt

from unveil_core.base.frame_cache import FrameCache, Frames
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Mask
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.drives.drive import Drive, tracks
from unveil_core.geometry.cloud import estimate_normals, thinned_to
from unveil_core.geometry.images import border_px, scale_from_384
from unveil_core.semantics.labels import SceneLabels, labels_of_frames
from unveil_core.semantics.visibility import PointsInView, PointsNear
from unveil_core.semantics.votes import view_weights

__all__ = ["overlooked_pixels"]

MOST_POINTS = 200_000
"""Points that are asked, however long the drive is."""
SAY = 0.5
"""Share of the other frames' votes from which on a point is an object's: most of them say so."""
LONGEST = 3
"""Frames of a camera in a row up to which an object is overlooked: what is gone for longer has moved."""
ALIKE = 0.1
"""Greatest difference between this photograph and those that show the object, levels from 0 to 1: below it all show the same.
Highlights seen from close by reach 0.085; another object in front differs more."""
BORDER_PX = 4
"""Pixels at 384 in width beside an object's own label in which a point that is called otherwise is an error of its border."""
LEAST_POINTS = 6
"""Points beyond that border from which on an object is overlooked."""
WIDEST_PX = 6
"""Half the width of a point, pixels at 384 in width: lines of a LiDAR are a few pixels apart."""


def overlooked_pixels(
    drive: Drive,
    scene: SceneLabels,
    images: Sequence[NDArray[np.uint8]],
    *,
    cache: FrameCache | None = None,
    progress: Progress = no_progress,
) -> Sequence[Mask]:
    """(H, W) per frame, pixels where its labels overlook an object that could be removed, found when asked for.

    Args:
        drive: an imported drive; scene: its labels.
        images: (H, W, 3) per frame.
        cache: room for the frames.
    """
    cameras = [f.camera for f in drive.frames]
    points = drive.points if drive.points.moving is None else drive.points.select(~drive.points.moving)
    positions = points.positions[thinned_to(points.positions, MOST_POINTS)]
    if not len(positions):
        return Frames(len(cameras), lambda v: np.zeros((cameras[v].height, cameras[v].width), dtype=bool))
    cache = cache or FrameCache()
    normals, spacing = estimate_normals(positions, np.stack([c.centre for c in cameras]))
    placed = PointsNear(positions, spacing, normals)
    labels = labels_of_frames(drive.frames, scene, cache)

    def seen_points(v: int) -> PointsInView:
        progress(v + 1, len(cameras), "looking for overlooked objects")
        return placed.seen_by(cameras[v], near=NEAR_M)

    views: Sequence[PointsInView] = cache.frames(len(cameras), seen_points)
    votes = cache.frames(len(cameras), lambda v: _votes(labels[v], views[v], scene))
    total, objects = np.zeros((2, len(positions)))
    color = np.zeros((len(positions), 3))
    for v, seen in enumerate(views):
        weight, own = votes[v]
        total[seen.index] += weight
        objects[seen.index] += weight * own
        color[seen.index] += (weight * own)[:, None] * images[v][seen.rows, seen.columns]
    color /= np.maximum(objects, 1e-12)[:, None] * 255
    brief = _brief(drive, views, votes, len(positions))

    def pixels(v: int) -> Mask:
        seen, (weight, own) = views[v], votes[v]
        # Where this frame has no vote for an object, all such votes are others'.
        others = objects[seen.index]
        lost = ~own & (weight > 0) & brief[v] & (others > 0) & (others >= SAY * (total[seen.index] - weight))
        index, at = seen.index[lost], (seen.rows[lost], seen.columns[lost])
        apart = np.abs(images[v][at] / 255 - color[index]).mean(axis=1)
        half = spacing[index] * cameras[v].fx / seen.depth[lost]
        return _regions(np.isin(labels[v], scene.removable_labels), at, half, apart)

    return cache.frames(len(cameras), pixels)


def _brief(
    drive: Drive,
    views: Sequence[PointsInView],
    votes: Sequence[tuple[NDArray[np.float64], NDArray[np.bool_]]],
    count: int,
) -> Sequence[NDArray[np.bool_]]:
    """(M,) per view, which of the points that it sees no more than :data:`LONGEST` of its camera's frames in a row, it among them,
    call something else than an object.

    Args:
        votes: weights and votes (M,) of each view; count: of all points.
    """
    found: list[NDArray[np.uint8]] = [np.zeros(0, np.uint8)] * len(views)
    for track in tracks(drive):
        before: dict[int, NDArray[np.uint8]] = {}
        for backwards in (False, True):
            run = np.zeros(count, np.int16)
            for v in track[::-1] if backwards else track:
                index = views[v].index
                weight, own = votes[v]
                run[index[own]] = 0
                run[index[~own & (weight > 0)]] += 1
                if backwards:
                    found[v] = np.packbits(before.pop(v) + run[index] - 1 <= LONGEST)
                else:
                    before[v] = np.minimum(run[index], LONGEST + 1).astype(np.uint8)
    return Frames(len(views), lambda v: np.unpackbits(found[v], count=len(views[v].index)).astype(bool))


def _votes(
    label: NDArray[np.int64], seen: PointsInView, scene: SceneLabels
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(M,) what a view's votes count, 0 where it has no label, and whether they are for an object."""
    here = label[seen.rows, seen.columns]
    return np.where(here >= 0, view_weights(label, seen), 0.0), np.isin(here, scene.removable_labels)


def _regions(
    own: Mask, at: tuple[NDArray[np.int64], NDArray[np.int64]], half: NDArray[np.float64], apart: NDArray[np.float64]
) -> Mask:
    """(H, W) the pixels around lost points, where enough of them lie together and show the object.

    Args:
        own: (H, W) pixels that the frame's labels give to objects.
        at: rows and columns (M,) of the lost points; half: (M,) half their width, pixels; apart: (M,) how far their colour is from
            that of the object, levels from 0 to 1.
    """
    drawn = np.zeros(own.shape, np.uint8)
    if not len(half):
        return drawn > 0
    scale = scale_from_384(own.shape[1])  # as borders are, see border_px
    for row, column, h in zip(*at, np.clip(half, 1.0, WIDEST_PX * scale), strict=True):
        cv2.circle(drawn, (int(column), int(row)), round(float(h)), 1, -1)
    side = 2 * border_px(own.shape[1]) + 1
    drawn = cv2.morphologyEx(drawn, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    count, component = cv2.connectedComponents(drawn, connectivity=8)
    group = component[at]
    beyond = distance_transform_edt(~own)[at] > BORDER_PX * scale if own.any() else np.ones(len(group), dtype=bool)
    lost = np.bincount(group[beyond], minlength=count) >= LEAST_POINTS
    lost &= np.asarray(ndimage.median(apart, group, np.arange(count))) < ALIKE
    lost[0] = False
    # Panes and what is black send no point back: an object's outline is taken as convex.
    outlines = [cv2.convexHull(np.argwhere(component == k)[:, ::-1].astype(np.int32)) for k in np.flatnonzero(lost)]
    found = np.zeros(own.shape, np.uint8)
    for outline in outlines:
        cv2.fillConvexPoly(found, outline, 1)
    return (found > 0) & ~own
