"""Cameras of frames that were not solved, standing or blurred or between others: points of neighbours are followed into them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float32, Float64
from unveil_core.geometry.transforms import quat_to_rotation, rotation_to_quat
from unveil_core.solve.mapping.model import Lens, Model

__all__ = ["placed_rest"]

WORK_PX = 1280
"""Longer side of the pictures in which points are followed."""
BACK_PX = 1.0
"""A point counts that is found again, followed back, so close to where it came from."""
WINDOW, LEVELS = (21, 21), 4
FEWEST = 20
"""Points that a camera is placed by."""
OFF_PX = 2.0
"""Distance from where a camera projects a point, beyond which it does not support that camera; pixels of ``WORK_PX``."""


def placed_rest(
    model: Model,
    tracks: Sequence[Sequence[str]],
    lens_of: Callable[[str], int],
    picture: Callable[[str], NDArray[np.uint8]],
    times: dict[str, float],
    progress: Progress = no_progress,
) -> tuple[Model, dict[str, float], tuple[str, ...]]:
    """Place all frames of some tracks.

    Args:
        tracks: names of each camera's frames in order; lens_of: number of a frame's lens in ``model.lenses``.
        picture: grey (H, W) of a frame at its full size.
        times: seconds by name, for frames that can only be placed between their neighbours; frames without count by order.
    Returns:
        the model with all frames; error of each one added, pixels, NaN where it lies between neighbours; names of these.
    """
    known = set(model.names)
    missing = [n for track in tracks for n in track if n not in known]
    names, lenses, poses, errors, between = [], [], [], {}, []
    for track in tracks:
        own = [n for n in track if n in known]
        if not own:
            continue
        for name, pose, error in _placed(model, track, lens_of(own[0]), picture, times):
            names.append(name)
            lenses.append(lens_of(own[0]))
            poses.append(pose)
            errors[name] = error
            if np.isnan(error):
                between.append(name)
            progress(len(names), len(missing), "placing the other frames")
    return model.with_pictures(names, lenses, poses), errors, tuple(between)


class _Marks:
    """Points of the model and where a frame shows them, pixels of the working size."""

    def __init__(self, grey: NDArray[np.uint8], points: Float64, pixels: Float32, pose: Float64) -> None:
        self.grey, self.points, self.pixels, self.pose = grey, points, pixels, pose


def _placed(
    model: Model,
    track: Sequence[str],
    lens_number: int,
    picture: Callable[[str], NDArray[np.uint8]],
    times: dict[str, float],
) -> list[tuple[str, Float64, float]]:
    """Name, pose and error of each frame of a track that has no camera."""
    lens = model.lenses[lens_number]
    scale = min(1.0, WORK_PX / max(lens.width, lens.height))
    number = {n: i for i, n in enumerate(model.names)}
    found: list[tuple[str, Float64, float]] = []
    k = 0
    while k < len(track):
        if track[k] in number:
            k += 1
            continue
        end = k
        while end < len(track) and track[end] not in number:
            end += 1
        before = track[k - 1] if k > 0 else None
        after = track[end] if end < len(track) else None
        run = list(track[k:end])
        greys = {n: _small(picture(n), scale) for n in run}
        ahead = _chain(model, number, before, run, greys, picture, scale)
        back = _chain(model, number, after, run[::-1], greys, picture, scale)
        for name in run:
            pose, error = _pose(lens, scale, [m for m in (ahead.get(name), back.get(name)) if m is not None])
            if pose is None:
                pose, error = _interpolated(model, number, before, after, name, run, times), float("nan")
            found.append((name, pose, error / scale))
        k = end
    return found


def _small(picture: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    if scale == 1.0:
        return picture
    size = (round(picture.shape[1] * scale), round(picture.shape[0] * scale))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def _chain(
    model: Model,
    number: dict[str, int],
    start: str | None,
    run: Sequence[str],
    greys: dict[str, NDArray[np.uint8]],
    picture: Callable[[str], NDArray[np.uint8]],
    scale: float,
) -> dict[str, _Marks]:
    """What a placed frame shows, followed from frame to frame."""
    if start is None:
        return {}
    own = model.seen_by == number[start]
    marks = _Marks(
        _small(picture(start), scale),
        model.points[model.seen[own]],
        (model.pixels[own] * scale - 0.5).astype(np.float32),
        model.poses[number[start]],
    )
    found = {}
    for name in run:
        marks = _followed(marks, greys[name])
        if len(marks.points) < FEWEST:
            break
        found[name] = marks
    return found


def _followed(marks: _Marks, grey: NDArray[np.uint8]) -> _Marks:
    if not len(marks.pixels):
        return marks
    at = marks.pixels[:, None]
    there, found, _ = cv2.calcOpticalFlowPyrLK(marks.grey, grey, at, None, winSize=WINDOW, maxLevel=LEVELS)
    back, again, _ = cv2.calcOpticalFlowPyrLK(grey, marks.grey, there, None, winSize=WINDOW, maxLevel=LEVELS)
    good = (found[:, 0] > 0) & (again[:, 0] > 0) & (np.linalg.norm((back - at)[:, 0], axis=1) < BACK_PX)
    return _Marks(grey, marks.points[good], there[good, 0], marks.pose)


def _pose(lens: Lens, scale: float, marks: list[_Marks]) -> tuple[Float64 | None, float]:
    """The camera that most of the points support, and the median distance of these, pixels of the working size."""
    if not marks:
        return None, float("nan")
    points = np.concatenate([m.points for m in marks])
    pixels = np.concatenate([m.pixels for m in marks]).astype(np.float64)
    straight = lens.straight((pixels + 0.5) / scale)
    unit = 1.0 / (lens.focal_px * scale)
    guess, _ = cv2.Rodrigues(marks[0].pose[:3, :3])
    turn, shift = guess.copy(), marks[0].pose[:3, 3:].copy()
    done, turn, shift, inside = cv2.solvePnPRansac(
        points,
        straight,
        np.eye(3),
        None,
        turn,
        shift,
        useExtrinsicGuess=True,
        iterationsCount=200,
        reprojectionError=OFF_PX * unit,
        confidence=0.999,
    )
    if not done or inside is None or len(inside) < FEWEST:
        return None, float("nan")
    own = inside[:, 0]
    turn, shift = cv2.solvePnPRefineLM(points[own], straight[own], np.eye(3), None, turn, shift)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(turn)[0], shift[:, 0]
    local = points[own] @ pose[:3, :3].T + pose[:3, 3]
    off = np.linalg.norm(local[:, :2] / local[:, 2:] - straight[own], axis=1) / unit
    return pose, float(np.median(off))


def _interpolated(
    model: Model,
    number: dict[str, int],
    before: str | None,
    after: str | None,
    name: str,
    run: Sequence[str],
    times: dict[str, float],
) -> Float64:
    """A pose between those of the placed neighbours, by time where it is known; beyond the ends that of the only one."""
    ends = [model.poses[number[n]] for n in (before, after) if n is not None]
    if len(ends) == 1:
        return ends[0].copy()
    share = (run.index(name) + 1) / (len(run) + 1)
    if before in times and after in times and name in times and times[after] > times[before]:
        share = (times[name] - times[before]) / (times[after] - times[before])
    first, last = (rotation_to_quat(p[:3, :3]) for p in ends)
    quat = (1 - share) * first + share * last * (1.0 if first @ last >= 0 else -1.0)
    pose = np.eye(4)
    pose[:3, :3] = quat_to_rotation(quat / np.linalg.norm(quat))
    centres = [-p[:3, :3].T @ p[:3, 3] for p in ends]
    pose[:3, 3] = -pose[:3, :3] @ ((1 - share) * centres[0] + share * centres[1])
    return pose
