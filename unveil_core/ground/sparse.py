"""The height of the ground from the drive's points alone, before there is a scene: enough to say where things stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive
from unveil_core.geometry.axes import up_frame
from unveil_core.geometry.camera import Camera

__all__ = ["GroundPoints", "find_ground"]

CELL_M, LOW_PERCENT = 0.5, 20
"""Of each cell of the plan the low points count: what floats over the ground is no ground."""
NEIGHBOURS = 7
REACH_M = 3.0
"""Farther from any ground point than this nothing is known of the ground."""
ROUNDS = 8
FEWEST = 20


@dataclass(frozen=True, eq=False)
class GroundPoints:
    """Some places on the ground.

    Attributes:
        axes: (3, 3) rows: two horizontal axes and up.
        plan: (G, 2) horizontal coordinates of the places, in their tree; height: (G,) along up.
    """

    axes: Float64
    plan: cKDTree
    height: Float64

    def height_at(self, horizontal: Float64) -> Float64:
        """(N,) height at horizontal coordinates (N, 2), the median of the nearest places."""
        _, index = self.plan.query(horizontal, k=min(NEIGHBOURS, len(self.height)))
        height: Float64 = np.median(self.height[index.reshape(len(horizontal), -1)], axis=1)
        return height

    def above(self, points: Float64) -> Float64:
        """(N,) height of points (N, 3) over the ground below them."""
        local = points @ self.axes.T
        above: Float64 = local[:, 2] - self.height_at(local[:, :2])
        return above

    def intersect(self, camera: Camera, pixels: Float64) -> Float64:
        """Depth (N,) along the optical axis at which the rays through pixels (N, 2) meet the ground, inf where they do not."""
        x, y = (pixels[:, 0] - camera.cx) / camera.fx, (pixels[:, 1] - camera.cy) / camera.fy
        rays = np.stack([x, y, np.ones_like(x)], axis=1) @ camera.world_to_camera[:3, :3] @ self.axes.T
        centre = self.axes @ camera.centre
        down = rays[:, 2] < -1e-3
        fall = np.where(down, -rays[:, 2], 1.0)
        depth = (centre[2] - self.height_at(centre[None, :2])) / fall
        for _ in range(ROUNDS):
            depth = np.clip(depth, 0.0, 1e3)
            place = centre[:2] + depth[:, None] * rays[:, :2]
            depth = 0.5 * depth + 0.5 * (centre[2] - self.height_at(place)) / fall
        place = centre[:2] + depth[:, None] * rays[:, :2]
        miss = np.abs(centre[2] - depth * fall - self.height_at(place))
        near = self.plan.query(place)[0] < REACH_M
        return np.where(down & near & (depth > 0) & (miss < 0.1), depth, np.inf)


def _one_per_cell(local: Float64, cell: float) -> Float64:
    """(C, 3) of each cell of the plan its low point: mean place, low percentile of the height."""
    key = np.floor(local[:, :2] / cell).astype(np.int64)
    _, group = np.unique(key, axis=0, return_inverse=True)
    order = np.lexsort((local[:, 2], group.ravel()))
    group, local = group.ravel()[order], local[order]
    first = np.searchsorted(group, np.arange(group[-1] + 1))
    count = np.diff(np.append(first, len(group)))
    low = local[first + (LOW_PERCENT * (count - 1)) // 100]
    return low


def find_ground(
    drive: Drive, labels: Sequence[NDArray[np.int8]], ground: Sequence[int], removable: Sequence[int]
) -> GroundPoints | None:
    """The ground of a drive; None where too few points lie on any.

    Args:
        labels: (H, W) per frame, negative = unknown; ground, removable: the labels that mean these.
    """
    axes = up_frame(drive.up)
    points = drive.points.positions
    centres = np.stack([f.camera.centre for f in drive.frames])
    nearest = cKDTree(centres).query(points)[1]
    drop = (centres[nearest] - points) @ axes[2]
    points = points[(drop > 0.4) & (drop < 6.0)]
    if len(points) < FEWEST:
        return None
    _, thin = np.unique(np.floor(points / 0.15).astype(np.int64), axis=0, return_index=True)
    points = points[np.sort(thin)]
    if ground:
        # Ground is what more views show as ground than as anything else that stays.
        ahead = np.zeros(len(points), np.int64)
        for frame, label in zip(drive.frames, labels, strict=True):
            pixel, depth = frame.camera.project(points)
            index = np.flatnonzero(frame.camera.in_picture(pixel, depth, nearest=0.2))
            shown = label[pixel[index, 1].astype(int), pixel[index, 0].astype(int)]
            ahead[index] += np.isin(shown, ground)
            ahead[index] -= (shown >= 0) & ~np.isin(shown, (*ground, *removable))
        points = points[ahead > 0]
    if len(points) < FEWEST:
        return None
    low = _one_per_cell(points @ axes.T, CELL_M)
    if len(low) < FEWEST:
        return None
    # Cells that hold no ground stand out of their surroundings.
    around = cKDTree(low[:, :2]).query(low[:, :2], k=min(15, len(low)))[1]
    flat = np.abs(low[:, 2] - np.median(low[around, 2], axis=1)) < 0.25
    low = low[flat]
    return GroundPoints(axes, cKDTree(low[:, :2]), low[:, 2]) if len(low) >= FEWEST else None
