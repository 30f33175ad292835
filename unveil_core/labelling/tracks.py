"""The boxes of objects over all frames: one that is out of line with those before and after it is put right, and a track that
stops while the picture still shows its object goes on.

Annotators place boxes at key frames and let a program fill in the others; at the picture's border and at the ends of a drive it
has nothing to go by.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np

from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.types import Float64, Picture
from unveil_core.drives.boxes import TrackedBox, between, has_moved
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.drives.drive import Drive, instants, tracks
from unveil_core.geometry.camera import Camera
from unveil_core.labelling.object_points import ObjectPoints, from_own_axes
from unveil_core.semantics.classes import REMOVABLE

__all__ = ["continued", "put_in_line"]

NEIGHBOURS, FEWEST = 6, 4
"""Boxes nearest in time that tell where one should be, and how many of them at least."""
OUT_M, SPREAD = 0.15, 4.0
"""A box is out of line if its centre is farther from where its neighbours tell than this, metres, and than so many times how far
they themselves are, root mean square: people place boxes of what stands still to some centimetres."""
STRAIGHT_S = 0.65
"""Seconds for which what moves goes straight on at one speed: what brakes by 3 m/s² is 0.6 m behind then."""
SPEED_S = 0.4
"""Seconds over which the speed at a track's end is measured, at least: boxes wander by centimetres."""
MOVING_S, STATIC_S = 1.0, 3.0
"""How long a track goes on after its last box, or before its first, seconds: an object that brakes is soon elsewhere."""
ASKED_POINTS, FEWEST_SEEN = 400, 20
"""Points of an object that are looked at, and of which so many must lie in both pictures."""
ALIKE, MOST_ALIKE = 0.1, 0.6
"""Difference between colours, levels from 0 to 1, up to which a point looks the same in two pictures, and the share of the points
that must: glass and paint that mirror the street do not."""

Timed = tuple[float, TrackedBox]


def put_in_line(drive: Drive) -> Drive:
    """The drive with those boxes of its frames and sweeps put right that are out of line with their neighbours in time.

    Args:
        drive: localized.
    """
    times = instants(drive.frames)
    frames = list(drive.frames)
    for track in tracks(drive):
        for i, boxes in zip(track, _in_line([(float(times[i]), frames[i].boxes) for i in track]), strict=True):
            frames[i] = replace(frames[i], boxes=boxes)
    sweeps = list(drive.sweeps)
    if all(s.timestamp is not None for s in sweeps):
        righted = _in_line([(s.timestamp or 0.0, s.boxes) for s in sweeps])
        sweeps = [replace(s, boxes=boxes) for s, boxes in zip(sweeps, righted, strict=True)]
    return replace(drive, frames=tuple(frames), sweeps=tuple(sweeps))


def _by_object(moments: Sequence[tuple[float, Sequence[TrackedBox]]]) -> dict[int, dict[int, Timed]]:
    """Of each removable object the moments that have a box of it, by their index."""
    found: dict[int, dict[int, Timed]] = {}
    for k, (time, boxes) in enumerate(moments):
        for box in boxes:
            if box.class_name in REMOVABLE:
                found.setdefault(box.id, {})[k] = (time, box)
    return found


def _in_line(moments: Sequence[tuple[float, tuple[TrackedBox, ...]]]) -> list[tuple[TrackedBox, ...]]:
    """The boxes of each moment, put right."""
    righted: dict[tuple[int, int], TrackedBox] = {}
    for number, known in _by_object(moments).items():
        if len(known) <= FEWEST:
            continue
        timed = list(known.values())
        for (k, (_, box)), right in zip(known.items(), _right(timed), strict=True):
            if right is not box:
                righted[k, number] = right
    return [tuple(righted.get((k, b.id), b) for b in boxes) for k, (_, boxes) in enumerate(moments)]


def _right(track: Sequence[Timed]) -> list[TrackedBox]:
    """The boxes of a track (more than ``FEWEST``, in order of time), those out of line replaced by what their neighbours tell."""
    times = np.array([t for t, _ in track])
    centres = np.array([b.centre for _, b in track])
    length, width, height = (float(v) for v in np.median([b.size for _, b in track], axis=0))
    moved = has_moved([b for _, b in track])
    found = []
    for k, (time, box) in enumerate(track):
        away = np.abs(times - time)
        away[k] = np.inf
        others = np.argsort(away, kind="stable")[:NEIGHBOURS]
        others = others[away[others] <= (STRAIGHT_S if moved else np.finfo(float).max)]
        if len(others) < FEWEST:
            found.append(box)
            continue
        fit = np.polyfit(times[others] - time, centres[others], int(moved))
        errors = centres[others] - np.stack([np.polyval(fit[:, a], times[others] - time) for a in range(3)], axis=1)
        spread = float(np.sqrt((errors**2).sum(axis=1).mean()))
        if np.linalg.norm(centres[k] - fit[-1]) > max(OUT_M, SPREAD * spread):
            x, y, z = (float(v) for v in fit[-1])
            box = replace(box, centre=(x, y, z), size=(length, width, height))
        found.append(box)
    return found


def continued(drive: Drive, objects: Mapping[int, ObjectPoints]) -> Drive:
    """The drive, its frames with boxes also of objects whose track has none at a frame that shows them all the same; itself where
    there are none.

    What stands still is looked for where it stood, what moves where its way leads, and it is there if its points have the colours
    that they have in the nearest frame with a box. An object without points does not go on.

    Args:
        drive: localized, with undistorted frames.
        objects: points of each.
    Raises:
        DriveError: a picture that cannot be read.
    """
    times = instants(drive.frames)
    more: dict[int, list[TrackedBox]] = {}
    cameras = [f.camera for f in drive.frames]

    def smoothed(i: int) -> Picture:  # points are measured to a pixel or two
        return cv2.blur(read_image(drive.frames[i].image_path), (3, 3)).astype(np.uint8, copy=False)

    pictures = FrameCache().frames(len(cameras), smoothed)
    for track in tracks(drive):
        for number, known in _by_object([(float(times[i]), drive.frames[i].boxes) for i in track]).items():
            if number not in objects:
                continue
            timed = list(known.values())
            at = np.array([t for t, _ in timed])
            lasts = MOVING_S if has_moved([b for _, b in timed]) else STATIC_S
            for k, i in enumerate(track):
                away = np.abs(at - times[i])
                if k in known or away.min() > lasts:
                    continue
                nearest = int(away.argmin())
                box, reference = _at(timed, float(times[i])), track[list(known)[nearest]]
                local = objects[number].near(drive.frames[reference].timestamp, ASKED_POINTS)
                if _alike(cameras, pictures, {i: box, reference: timed[nearest][1]}, local):
                    more.setdefault(i, []).append(box)
    if not more:
        return drive
    frames = [replace(f, boxes=(*f.boxes, *more.get(i, ()))) for i, f in enumerate(drive.frames)]
    return replace(drive, frames=tuple(frames))


def _at(track: Sequence[Timed], time: float) -> TrackedBox:
    """Where an object is at a time between, before or after the boxes of its track, which are in order of time."""
    times = np.array([t for t, _ in track])
    k = int(np.searchsorted(times, time))
    if 0 < k < len(track):
        first, last = k - 1, k
    elif not has_moved([b for _, b in track]):
        return track[min(k, len(track) - 1)][1]
    elif k == 0:
        first, last = 0, min(int(np.searchsorted(times, times[0] + SPEED_S)), len(track) - 1)
    else:
        first, last = max(int(np.searchsorted(times, times[-1] - SPEED_S, side="right")) - 1, 0), len(track) - 1
    (start, a), (end, b) = track[first], track[last]
    return between(a, b, (time - start) / (end - start)) if end > start else b


def _alike(
    cameras: Sequence[Camera], pictures: Sequence[Picture], boxes: Mapping[int, TrackedBox], local: Float64
) -> bool:
    """Whether the points (P, 3) of an object have the same colours in two frames.

    Args:
        boxes: of the object, by the frames.
    """
    pixels, depths = zip(*(cameras[i].project(from_own_axes(box, local)) for i, box in boxes.items()), strict=True)
    both = np.logical_and.reduce(
        [cameras[i].in_picture(p, d, nearest=NEAR_M) for i, p, d in zip(boxes, pixels, depths, strict=True)]
    )
    if both.sum() < FEWEST_SEEN:
        return False
    colors = []
    for i, places in zip(boxes, pixels, strict=True):
        column, row = places[both].astype(np.int64).T
        colors.append(pictures[i][row, column].astype(np.float64) / 255)
    return bool((np.abs(colors[0] - colors[1]).mean(axis=1) < ALIKE).mean() > MOST_ALIKE)
