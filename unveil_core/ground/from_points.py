"""The height of the ground from the drive's points alone, before there is a scene: enough to say where things stand."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64
from unveil_core.drives.depth_range import ASKED_M
from unveil_core.drives.drive import Drive
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.geometry.cloud import thin_points
from unveil_core.geometry.grid import PointGrid
from unveil_core.ground.height_field import HeightField

__all__ = ["find_ground"]

CELL_M, LOW_PERCENT, MOST_CELLS = 0.5, 20, 8_000_000
"""Of each cell of the plan the low points count: what floats over the ground is no ground. Drives over more ground than so many
cells cover get a height field of larger ones."""
NEIGHBOURS = 7
"""A cell is as high as so many places around it in the median."""
REACH_M = 3.0
"""Farther from any ground point than this nothing is known of the ground."""
THIN_M = 0.15
"""Of the points in a cell of so many metres one is asked about: a LiDAR's sweeps over one place add up."""
FEWEST = 20


def _one_per_cell(local: Float64, cell: float) -> Float64:
    """(C, 3) of each cell of the plan its low point: mean place, low percentile of the height."""
    grid = PointGrid(local, cell)
    first, count = grid.first, np.diff(np.append(grid.first, len(local)))
    local = local[grid.order]
    by_height = np.lexsort((local[:, 2], np.repeat(np.arange(len(count)), count)))
    low: Float64 = local[by_height[first + (LOW_PERCENT * (count - 1)) // 100]]
    return low


def _field(axes: Float64, low: Float64) -> HeightField:
    """The height field through places (G, 3) in the coordinates of ``axes``."""
    size = low[:, :2].max(axis=0) - low[:, :2].min(axis=0) + 2 * REACH_M
    cell = max(CELL_M, float(np.sqrt(np.prod(size) / MOST_CELLS)))
    corner = low[:, :2].min(axis=0) - REACH_M - 2 * cell
    shape = np.ceil((size + 4 * cell) / cell).astype(int) + 1
    there = np.zeros(shape, dtype=np.uint8)
    there[tuple(np.round((low[:, :2] - corner) / cell).astype(int).T)] = 1
    # A cell beyond the reach, so that the height goes on to it between the cells' centres.
    away = cv2.distanceTransform(1 - there, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    row, column = np.nonzero(away <= REACH_M / cell + 1)
    centres = corner + cell * np.stack([row, column], axis=1)
    index = cKDTree(low[:, :2]).query(centres, k=min(NEIGHBOURS, len(low)))[1]
    height = np.full(shape, np.nan)
    height[row, column] = np.median(low[index.reshape(len(centres), -1), 2], axis=1)
    return HeightField(axes, corner, cell, height)


def find_ground(
    drive: Drive, labels: Sequence[NDArray[np.int8]], ground: Sequence[int], removable: Sequence[int]
) -> HeightField | None:
    """The ground of a drive; None where too few points lie on any.

    Args:
        labels: (H, W) per frame, negative = unknown; ground, removable: the labels that mean these.
    """
    axes = up_frame(UP)
    points = drive.points.positions
    centres = np.stack([f.camera.centre for f in drive.frames])
    nearest = cKDTree(centres).query(points)[1]
    drop = (centres[nearest] - points) @ axes[2]
    points = points[(drop > 0.4) & (drop < 6)]
    if len(points) < FEWEST:
        return None
    points = points[thin_points(points, THIN_M)]
    if ground:
        # Ground is what more views show as ground than as anything else that stays.
        ahead = np.zeros(len(points), np.int64)
        grid = PointGrid(points)
        for frame, label in zip(drive.frames, labels, strict=True):
            near = grid.near(frame.camera.centre, ASKED_M)
            pixel, depth = frame.camera.project(points[near])
            inside = np.flatnonzero(frame.camera.in_picture(pixel, depth, nearest=0.2))
            shown = label[pixel[inside, 1].astype(int), pixel[inside, 0].astype(int)]
            index = near[inside]
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
    return _field(axes, low) if len(low) >= FEWEST else None
