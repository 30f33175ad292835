"""Points of a whole drive from the depths of its frames: each place once, where several frames show it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64, Mask, Picture
from unveil_core.drives.drive import PointCloud
from unveil_core.geometry.camera import Camera
from unveil_core.points.flow import Ground, Looked, depth_by_flow

__all__ = ["WORK_PX", "compared_frames", "dense_points"]

WORK_PX = 1280
"""Longer side of the pictures that are compared, pixels."""
BASELINE = 0.3
"""Distance between two frames that are compared at least, in heights of the camera above the ground: half a metre on a car."""
NEAR, CELL = 10.0, 0.04
"""Places are told apart to so many heights of the camera (6 cm) up to so many of distance, twice as coarsely at twice that."""
FARTHEST = 60.0
"""Heights of the camera; a street is 100 m long."""
SEEN_TWICE = 4
"""Frames, from which on a place counts only where two of them show it."""
MOST_POINTS = 1_500_000
"""More make the start of a scene no better: places are told apart more coarsely."""
NEIGHBOURS, LONELY = 8, 6.0
"""A point is left out whose neighbours are farther, at the mean, than so many cells of its distance."""
STRIDE = 2
"""Pixels between two that become points, of ``WORK_PX``."""


def dense_points(
    cameras: Sequence[Camera],
    tracks: Sequence[Sequence[int]],
    picture: Callable[[int], tuple[Picture, Mask | None]],
    up: Float64,
    height: float | None,
    progress: Progress = no_progress,
) -> PointCloud:
    """Points of the ground and of facades.

    Args:
        cameras: pinholes, of the pictures that ``picture`` gives.
        tracks: numbers of each camera's frames in order of time.
        picture: (H, W, 3) RGB of a frame without distortion, and its pixels (H, W) that are no part of the street, or None.
        up: (3,) unit in the world; height: of the cameras above the ground, in units of their positions; None = unknown.
    """
    chosen = [pair for track in tracks for pair in compared_frames(cameras, track, height)]
    size = height if height is not None else _typical_step(cameras, tracks) * 2
    engine = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    ground = None if height is None else Ground(up, height)
    held: dict[int, tuple[Looked, Picture, Mask | None]] = {}
    cell, parts = CELL * size, _Cells()
    for done, (i, others) in enumerate(chosen, start=1):
        for k in (i, *others):
            if k not in held:
                colour, hidden = picture(k)
                held[k] = (Looked(cameras[k], cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)), colour, hidden)
        looked, colour, hidden = held[i]
        depth, _ = depth_by_flow(looked, [held[k][0] for k in others], ground, hidden, engine)
        depth[depth > FARTHEST * size] = np.nan
        rows, columns = np.nonzero(np.isfinite(depth[::STRIDE, ::STRIDE]))
        rows, columns = rows * STRIDE, columns * STRIDE
        far = depth[rows, columns].astype(np.float64)
        pixels = np.stack([columns + 0.5, rows + 0.5], axis=1)
        places = looked.camera.centre + looked.camera.rays_at(pixels) * far[:, None]
        parts.add(places, far / (NEAR * size), colour[rows, columns], cell)
        oldest = min((k for _, o in chosen[done : done + 1] for k in o), default=i)
        for k in [k for k in held if k < min(oldest, i) - 2]:
            del held[k]
        progress(done, len(chosen), "finding points")
    return parts.points(2 if len(chosen) >= SEEN_TWICE else 1)


def _typical_step(cameras: Sequence[Camera], tracks: Sequence[Sequence[int]]) -> float:
    """Median distance between two frames that differ."""
    steps = [
        float(np.linalg.norm(cameras[a].centre - cameras[b].centre))
        for t in tracks
        for a, b in zip(t, t[1:], strict=False)
    ]
    moving = [s for s in steps if s > 1e-9]
    return float(np.median(moving)) if moving else 1.0


def compared_frames(
    cameras: Sequence[Camera], track: Sequence[int], height: float | None
) -> list[tuple[int, list[int]]]:
    """Frames of a camera that get depths, and those that each is compared with: one before, one behind, or two to one side."""
    if len(track) < 3:
        return []
    centres = np.stack([cameras[i].centre for i in track])
    least = BASELINE * height if height is not None else 0.5 * _typical_step(cameras, [track])
    steps, last = [0], 0
    for k in range(1, len(track)):
        if np.linalg.norm(centres[k] - centres[last]) >= least:
            steps.append(k)
            last = k
    found = []
    for place, k in enumerate(steps):
        near = [steps[p] for p in (place - 1, place + 1) if 0 <= p < len(steps)]
        if len(near) < 2:
            near += [steps[p] for p in (place - 2, place + 2) if 0 <= p < len(steps)][:1]
        if len(near) == 2:
            found.append((track[k], [track[n] for n in near]))
    return found


class _Cells:
    """Places by their cell, frame by frame."""

    def __init__(self) -> None:
        self.keys: list[NDArray[np.int64]] = []
        self.sums: list[NDArray[np.float32]] = []
        self.origin: Float64 | None = None
        self.cell = 1.0

    def add(self, places: Float64, far: Float64, colours: NDArray[np.uint8], cell: float) -> None:
        """Points of one frame; each cell that they lie in counts once.

        Args:
            far: (N,) distance over that up to which cells are finest; cell: size of these.
        """
        if not len(places):
            return
        if self.origin is None:
            self.origin, self.cell = places.mean(axis=0), cell
        level = np.ceil(np.log2(np.maximum(far, 1.0))).astype(np.int64)
        index = np.floor((places - self.origin) / (cell * 2.0 ** level[:, None])).astype(np.int64)
        key = (
            (level << 60) ^ ((index[:, 0] & 0xFFFFF) << 40) ^ ((index[:, 1] & 0xFFFFF) << 20) ^ (index[:, 2] & 0xFFFFF)
        )
        keys, where, counts = np.unique(key, return_inverse=True, return_counts=True)
        values = np.concatenate([places - self.origin, colours], axis=1)
        sums = np.stack([np.bincount(where, values[:, k]) for k in range(6)], axis=1) / counts[:, None]
        self.keys.append(keys)
        self.sums.append(sums.astype(np.float32))

    def points(self, least: int) -> PointCloud:
        """The cells that so many frames show."""
        if not self.keys or self.origin is None:
            return PointCloud(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
        keys, where, counts = np.unique(np.concatenate(self.keys), return_inverse=True, return_counts=True)
        values = np.concatenate(self.sums)
        means = np.stack([np.bincount(where, values[:, k]) for k in range(6)], axis=1) / counts[:, None]
        good = counts >= least
        if good.sum() > MOST_POINTS:
            keep = np.flatnonzero(good)
            good = np.zeros_like(good)
            good[keep[:: -(-len(keep) // MOST_POINTS)]] = True
        means = means[good]
        places = means[:, :3].astype(np.float64)
        lonely = _lonely(places, np.asarray(self.cell * 2.0 ** (keys[good] >> 60), np.float64))
        return PointCloud(places[~lonely] + self.origin, np.clip(np.round(means[~lonely, 3:]), 0, 255).astype(np.uint8))


def _lonely(places: Float64, cells: Float64) -> NDArray[np.bool_]:
    """(P,) bool, points farther from their neighbours than cells of their distance are: what is left of wrong matches.

    Args:
        cells: (P,) size of the cell of each.
    """
    if len(places) < 50:
        return np.zeros(len(places), bool)
    far, _ = cKDTree(places).query(places, k=NEIGHBOURS + 1)
    return np.asarray(far[:, 1:].mean(axis=1) > LONELY * cells)
