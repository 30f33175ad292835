"""Whether photographs agree with the motion between their poses: what both of two neighbours show lies before both cameras, on the
rays that the poses give. No points are needed for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive, Frame, tracks
from unveil_core.drives.photographs import photograph
from unveil_core.geometry.adjustment.features import Features, alike, find_features, on_one_motion
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.lens import undistorted

__all__ = ["STILL", "MatchedPair", "matched_pairs", "places", "share_explained"]

PAIRS = 3
"""Neighbours that are compared, evenly chosen; two pictures each."""
SIDE_PX = 512
"""Longer side of the pictures that features are looked for in."""
LEAST_PARALLAX = np.radians(0.4)
"""Between the rays of a match, without the cameras' turn, from which on its depth has a sign."""
FEWEST = 24
"""Matches with such a parallax that a pair must have to tell anything."""
STILL = 1e-9
"""Of coordinates, what is lost when matrices are turned round; what moves less stands."""
OFF = 0.03
"""Distance of rays that still meet, as a share of their depth: inertial poses are off by a degree or two."""


@dataclass(frozen=True, eq=False)
class MatchedPair:
    """What two neighbouring photographs show both.

    Attributes:
        first, second: numbers of the frames.
        rays: (M, 3) of the first, and of the second; in the axes of the cameras, 1 deep.
    """

    first: int
    second: int
    rays: tuple[Float64, Float64]


def matched_pairs(drive: Drive) -> list[MatchedPair]:
    """Some pairs of neighbouring photographs of the longest track, between which the camera moved; none where they show too little
    in common, or cannot be read."""
    track = max(tracks(drive), key=len, default=[])
    centres = {i: drive.frames[i].camera.centre for i in track}
    still = STILL * max((float(np.abs(c).max()) for c in centres.values()), default=1.0)
    moved = [
        (i, j) for i, j in zip(track[:-1], track[1:], strict=True) if np.linalg.norm(centres[i] - centres[j]) > still
    ]
    chosen = sorted({(2 * k + 1) * len(moved) // (2 * PAIRS) for k in range(PAIRS)}) if moved else []
    found = []
    for k in chosen:
        i, j = moved[k]
        with suppress(DriveError):
            a, b = _features(drive.frames[i]), _features(drive.frames[j])
            pairs = on_one_motion(a, b, alike(a, b))
            if len(pairs) >= FEWEST:
                rays = _rays(a.pixels[pairs[:, 0]], drive.frames[i]), _rays(b.pixels[pairs[:, 1]], drive.frames[j])
                found.append(MatchedPair(i, j, rays))
    return found


def share_explained(pairs: Sequence[MatchedPair], camera_of: Callable[[int], Camera]) -> float | None:
    """Share of the matches that lie before both cameras where their rays meet; None where no pair tells.

    Args:
        camera_of: the camera of a frame by its number.
    """
    shares = [s for p in pairs if (s := _explained(p, camera_of(p.first), camera_of(p.second))) is not None]
    return float(np.mean(shares)) if shares else None


def places(pair: MatchedPair, first: Camera, second: Camera) -> tuple[Float64, Float64]:
    """What a pair shows both: world positions (N, 3), and their depths (N,) from the first camera; of what lies before both cameras
    where its rays meet."""
    met = _met(pair, first, second)
    if met is None:
        return np.zeros((0, 3)), np.zeros(0)
    rays, depth, _, good = met
    local = rays[good] * depth[good, None]
    pose = first.camera_to_world
    return local @ pose[:3, :3].T + pose[:3, 3], depth[good]


def _explained(pair: MatchedPair, first: Camera, second: Camera) -> float | None:
    met = _met(pair, first, second)
    return None if met is None else float(met[3].mean())


def _met(
    pair: MatchedPair, first: Camera, second: Camera
) -> tuple[Float64, Float64, Float64, NDArray[np.bool_]] | None:
    """Of the matches whose parallax tells a depth: rays (N, 3) of the first camera, depths (N,) from it and from the second, and
    which lie before both where their rays meet; None where there are too few."""
    relative = second.world_to_camera @ first.camera_to_world
    shift = relative[:3, 3]
    if not np.linalg.norm(shift) > 0:
        return None
    one, two = pair.rays[0] @ relative[:3, :3].T, pair.rays[1]
    # Depths a of the first and b of the second with a * one + shift = b * two, by least squares.
    oo, tt, ot = (one * one).sum(axis=1), (two * two).sum(axis=1), (one * two).sum(axis=1)
    os, ts = one @ shift, two @ shift
    wide = oo * tt - ot**2
    parallax = np.sqrt(np.maximum(wide, 0) / (oo * tt))
    tells = parallax > np.sin(LEAST_PARALLAX)
    if int(tells.sum()) < FEWEST:
        return None
    rays, one, two, wide = pair.rays[0][tells], one[tells], two[tells], wide[tells]
    oo, tt, ot, os, ts = (v[tells] for v in (oo, tt, ot, os, ts))
    a, b = (ot * ts - tt * os) / wide, (oo * ts - ot * os) / wide
    apart = np.linalg.norm(a[:, None] * one + shift - b[:, None] * two, axis=1)
    meets = apart < OFF * np.maximum(np.abs(b) * np.sqrt(tt), np.abs(a) * np.sqrt(oo))
    return rays, a, b, (a > 0) & (b > 0) & meets


def _features(frame: Frame) -> Features:
    """Of a photograph, in its own pixels."""
    gray = cv2.cvtColor(photograph(frame), cv2.COLOR_RGB2GRAY)
    scale = min(1.0, SIDE_PX / max(gray.shape))
    if scale < 1.0:
        gray = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    found = find_features(gray.astype(np.uint8))
    times = np.array([frame.camera.width / gray.shape[1], frame.camera.height / gray.shape[0]])
    return Features(found.pixels * times, found.descriptors)


def _rays(pixels: Float64, frame: Frame) -> Float64:
    """(M, 3) of pixels (M, 2)."""
    camera, lens = frame.camera, frame.distortion
    flat = (pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    flat = flat if lens is None else undistorted(lens.model, lens.coefficients, flat)
    return np.concatenate([flat, np.ones((len(flat), 1))], axis=1)
