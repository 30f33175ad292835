"""Motion between frames: by optical flow in small pictures, and by corners that are followed."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float32, Float64
from unveil_core.solve.looks.thumbs import Grey, Thumbs

__all__ = ["Motion", "followed", "likeness", "motion_of", "moved"]

CORNERS, CORNER_QUALITY, CORNER_APART_PX = 800, 0.005, 6
"""Corners that are followed in a small picture: at most, how weak against the best, and how close."""
BACK_PX = 0.7
"""A corner counts that is found again, followed back, so close to where it came from."""
CUT_LIKENESS = 0.35
"""Correlation of a frame with its neighbour, brought to it by the flow, below which the two may show different places. Those of
one shot are at 0.7 and more, also where cars pass near the camera."""
CUT_CORNERS = 25
"""Corners that two frames of one shot share at least."""

STANDS_PX, SLOW_PX = 0.06, 0.2
"""Median motion between two frames, pixels of a small picture, below which the camera stands, noise of the flow reaches 0.04; and
below which it may, where traffic passes."""
RUN_SHARES = (1.0, 0.9, 0.75, 0.5)
LEAST_RUN, NOWHERE_PX = 3, 0.4
"""Such steps in a run, and the motion of the stiller quarter of the picture over all of them, below which it does."""
SAME_GREY, LEAST_STEPS = 3.0, 8
"""Deviation of a pixel's grey over so many moving steps, at least, below which it shows one thing: asphalt has 5 and more."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Between the frames of one camera.

    Attributes:
        step: (N - 1,) median motion from each frame to the next, pixels of a picture of ``FLOW_PX``.
        stands: (N - 1,) bool, the camera does not move from each frame to the next.
        alike: (N - 1,) correlation of the two once the motion is undone.
        cuts: frames before which the place changes.
        still: (h, w) share of the moving steps in which a pixel of a small picture stays while the picture moves around it; 1 where
            its grey never changes at all.
    """

    step: Float64
    stands: NDArray[np.bool_]
    alike: Float64
    cuts: tuple[int, ...]
    still: Float32


def moved(first: Grey, second: Grey, flow: cv2.DISOpticalFlow | None = None) -> Float32:
    """(h, w, 2) motion of each pixel, from a first picture to a second one."""
    engine = flow or cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    return np.asarray(engine.calc(first, second, None), np.float32)


def likeness(first: Grey, second: Grey, motion: Float32) -> float:
    """Correlation of a picture with another one that its motion is undone in, -1 to 1."""
    height, width = first.shape
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    back = cv2.remap(second, columns + motion[..., 0], rows + motion[..., 1], cv2.INTER_LINEAR, borderValue=0)
    a, b = first.astype(np.float64).ravel(), back.astype(np.float64).ravel()
    a, b = a - a.mean(), b - b.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0 else 1.0


def followed(first: Grey, second: Grey, mask: NDArray[np.bool_] | None = None) -> tuple[Float32, Float32]:
    """(M, 2) corners of a first picture and where a second one shows them, as far as they are found again.

    Args:
        mask: (h, w) where corners are taken; None = everywhere.
    """
    allowed = None if mask is None else mask.astype(np.uint8)
    corners = cv2.goodFeaturesToTrack(first, CORNERS, CORNER_QUALITY, CORNER_APART_PX, mask=allowed)
    if corners is None or not len(corners):
        return np.zeros((0, 2), np.float32), np.zeros((0, 2), np.float32)
    there, found, _ = cv2.calcOpticalFlowPyrLK(first, second, corners, None, winSize=(15, 15), maxLevel=4)
    back, again, _ = cv2.calcOpticalFlowPyrLK(second, first, there, None, winSize=(15, 15), maxLevel=4)
    close = np.linalg.norm((back - corners)[:, 0], axis=1) < BACK_PX
    good = close & (found[:, 0] > 0) & (again[:, 0] > 0)
    return corners[good, 0], there[good, 0]


def motion_of(thumbs: Thumbs, progress: Progress = no_progress) -> Motion:
    """Measure the motion between neighbouring frames."""
    engine = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    count = len(thumbs.frames)
    steps, alike, cuts = np.zeros(count - 1), np.ones(count - 1), []
    before = thumbs.small(0)
    still, moving = np.zeros(before.shape, np.float32), 0
    total, square = np.zeros((2, *before.shape))
    for k in range(count - 1):
        after = thumbs.small(k + 1)
        motion = moved(before, after, engine)
        size = np.linalg.norm(motion, axis=2)
        steps[k] = float(np.median(size))
        alike[k] = likeness(before, after, motion)
        if alike[k] < CUT_LIKENESS and _shared(thumbs.pictures[k], thumbs.pictures[k + 1]) < CUT_CORNERS:
            cuts.append(k + 1)
        beside = float(np.percentile(size[size.shape[0] // 2 :], 75))
        if beside > 1.0:
            still += size < 0.12 * beside
            moving += 1
            total += after
            square += after.astype(np.float64) ** 2
        before = after
        progress(k + 1, count - 1, "measuring motion")
    still /= max(1, moving)
    if moving >= LEAST_STEPS:
        spread = np.sqrt(np.maximum(square / moving - (total / moving) ** 2, 0))
        still[cv2.medianBlur(spread.astype(np.float32), 3) < SAME_GREY] = 1
    return Motion(steps, _standing(thumbs, steps, engine), alike, tuple(cuts), still)


def _standing(thumbs: Thumbs, steps: Float64, engine: cv2.DISOpticalFlow) -> NDArray[np.bool_]:
    """(N - 1,) bool, steps in which the camera stands: a run of small ones that lead nowhere. What drives by moves a part of the
    picture alone, and a slow camera comes far in time."""
    stands = steps < STANDS_PX
    ends = np.flatnonzero(np.diff(np.concatenate([[False], steps < SLOW_PX, [False]]).astype(np.int8)))
    for first, last in zip(ends[::2], ends[1::2], strict=True):
        for share in RUN_SHARES:  # at its end it may begin to move
            end = int(first + share * (last - first))
            if end - first < LEAST_RUN:
                break
            gone = np.linalg.norm(moved(thumbs.small(int(first)), thumbs.small(end), engine), axis=2)
            if np.percentile(gone, 25) < NOWHERE_PX:
                stands[first:end] = True
                break
    return stands


def _shared(first: Grey, second: Grey) -> int:
    """Features that two pictures share and one motion of a camera explains; photographs far apart are told from cuts by them."""
    finder = cv2.SIFT.create(1000)
    (here, of_here), (there, of_there) = (finder.detectAndCompute(p, None) for p in (first, second))
    if of_here is None or of_there is None or len(of_here) < 8 or len(of_there) < 8:
        return 0
    pairs = [m for m, n in _two_each(of_here, of_there) if m.distance < 0.8 * n.distance]
    if len(pairs) < 8:
        return len(pairs)
    a = np.array([here[m.queryIdx].pt for m in pairs], np.float64)
    b = np.array([there[m.trainIdx].pt for m in pairs], np.float64)
    _, inside = cv2.findFundamentalMat(a, b, cv2.FM_RANSAC, 1.5, 0.99)
    return 0 if inside is None else int(inside.sum())


def _two_each(first: NDArray[np.float32], second: NDArray[np.float32]) -> list[tuple[cv2.DMatch, cv2.DMatch]]:
    found = cv2.BFMatcher(cv2.NORM_L2).knnMatch(first, second, k=2)
    return [(pair[0], pair[1]) for pair in found if len(pair) == 2]
