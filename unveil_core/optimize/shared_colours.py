"""Colours that several photographs show of one point: what their exposures are found from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import Progress
from unveil_core.base.types import Float64
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.drives.drive import Drive, tracks
from unveil_core.geometry.cloud import estimate_normals, thin_points
from unveil_core.semantics.visibility import points_in_view

__all__ = ["BRIGHTEST", "DARKEST", "Samples", "camera_numbers", "sample_colours", "seen_by_several"]

HIDING_POINTS = 40_000
"""Number of points of a drive at most that are tested for occluding each other, however long it is: what all views show of them is
held, 40 bytes a sample. On 1 km there are 4,000 for 100 m, and a view of a long drive gives 250 samples."""
SAMPLES, SAMPLES_PER_VIEW = 60_000, 250
"""About how many samples are used for a drive, and for each view of a long one."""
DARKEST, BRIGHTEST = 3, 250
"""Samples at or beyond these levels of 255 may be clipped and are not used for the gain."""
BLUR_SHARE = 1 / 400
"""Poses and points are off by about this share of the image's width, at most two pixels: so much it is blurred."""


@dataclass(frozen=True, eq=False)
class Samples:
    """What the views show of the points: colours (M, 3) in [0, 1], point (M,) and view (M,) of each."""

    color: Float64
    point: NDArray[np.int64]
    view: NDArray[np.int64]

    def where(self, keep: NDArray[np.bool_]) -> Samples:
        return Samples(self.color[keep], self.point[keep], self.view[keep])


def sample_colours(drive: Drive, hidden: Sequence[NDArray[np.bool_]] | None, progress: Progress) -> Samples:
    """Colours of points that at least two views see well exposed."""
    positions = drive.points.positions
    cell = 0.02
    while len(positions) > HIDING_POINTS:
        positions = positions[thin_points(positions, cell)]
        cell *= 1.3
    cameras = [f.camera for f in drive.frames]
    normals, spacing = estimate_normals(positions, np.stack([c.centre for c in cameras]))
    spacing = np.minimum(spacing, 4 * np.median(spacing))
    found = []
    for v, frame in enumerate(drive.frames):
        seen = points_in_view(positions, spacing, frame.camera, near=NEAR_M, normals=normals)
        blur = min(2.0, BLUR_SHARE * frame.camera.width)
        color = cv2.GaussianBlur(read_image(frame.image_path), (0, 0), blur)[seen.rows, seen.columns]
        good = (color > DARKEST).all(axis=1) & (color < BRIGHTEST).all(axis=1)
        if hidden is not None:
            good &= ~hidden[v][seen.rows, seen.columns]
        found.append(Samples(color[good] / 255.0, seen.index[good], np.full(int(good.sum()), v)))
        progress(v + 1, len(cameras), "comparing exposures")
    every = Samples(*(np.concatenate([getattr(s, n) for s in found]) for n in ("color", "point", "view")))
    times = np.bincount(every.point, minlength=len(positions))
    joins = seen_by_several(every.point, camera_numbers(drive)[every.view], len(positions))
    joining, others = np.flatnonzero(joins), np.flatnonzero((times > 1) & ~joins)
    enough = max(SAMPLES, SAMPLES_PER_VIEW * len(cameras))
    # What joins the cameras of a rig is the least of it, and must not be thinned with the rest.
    joining = _thinned(joining, times, max(enough // 2, enough - int(times[others].sum())))
    shared = np.concatenate([joining, _thinned(others, times, enough - int(times[joining].sum()))])
    number = np.full(len(positions), -1)
    number[shared] = np.arange(len(shared))
    return Samples(every.color, number[every.point], every.view).where(number[every.point] >= 0)


def _thinned(points: NDArray[np.int64], times: NDArray[np.int64], samples: int) -> NDArray[np.int64]:
    """Some of the points, with about so many samples."""
    return points[:: max(1, round(int(times[points].sum()) / max(1, samples)))]


def camera_numbers(drive: Drive) -> NDArray[np.int64]:
    """(V,) which camera took each frame."""
    numbers = np.zeros(len(drive.frames), np.int64)
    for number, track in enumerate(tracks(drive)):
        numbers[track] = number
    return numbers


def seen_by_several(point: NDArray[np.int64], camera: NDArray[np.int64], points: int) -> NDArray[np.bool_]:
    """(P,) points of which samples (M,) of several cameras are there."""
    low, high = np.full(points, np.iinfo(np.int64).max), np.full(points, -1)
    np.minimum.at(low, point, camera)
    np.maximum.at(high, point, camera)
    return low < high
