"""The ground as it goes on behind and beneath what is removed.

Surfels cover observed surfaces only: behind a car on a bank the scene shows the hill far beyond. The points of the drive, LiDAR
above all, give the height of the ground all around to centimetres, better than surfels that were displaced by photometric
optimization, and between them it goes on smoothly. It is fitted as a height field over the horizontal plane, so banks, meadows
and verges are in it as well as the street.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64
from unveil_core.geometry.cloud import every_nth, neighbours_of
from unveil_core.ground.height_field import HeightField

__all__ = ["fit_terrain", "ground_points"]

CELL_M, MOST_CELLS = 0.25, 8_000_000
"""Side of a cell, metres; drives over more ground than this many cells cover, a rectangle of half a square kilometre, get larger
ones: some ten planes of that size, of 4 or 8 bytes a cell, are held while the ground is fitted."""
SMOOTHED_M = (3.2, 1.6, 0.8, 0.4, 0.2)
"""Widths of the averages, metres: each counts where it has points enough, the next narrower one instead where that has."""
ENOUGH_CELLS = 1.5
HUMP_M, OPENED_M = 0.15, 1.5
"""What stands out of the ground by more than this and is narrower than that is no ground but a bush's foot or a tyre."""
REACH_M = 4.0
"""A hole in the ground is bridged if no circle of this radius, twice a car's width, lies in it; nothing is added around it."""
LABELLED_M, MOST_POINTS = 0.4, 2_000_000


def ground_points(points: Float64, means: Float64, on_ground: NDArray[np.bool_]) -> Float64:
    """(Q, 3) of the points (P, 3) that lie on the ground: those whose three nearest surfels all do.

    Args:
        means: (N, 3) of the scene's surfels, those that go included; on_ground: (N,) whether they bear a label of the ground.
    """
    points = every_nth(points, MOST_POINTS)
    if len(means) < 3 or not len(points):
        return np.zeros((0, 3))
    gap, nearest = neighbours_of(points, cKDTree(means), 3)
    return points[on_ground[nearest].all(axis=1) & (gap[:, 0] < LABELLED_M)]


def fit_terrain(
    points: Float64, axes: Float64, *, guess: Callable[[Float64], Float64] | None = None
) -> HeightField | None:
    """The ground through points on it.

    Args:
        points: (P, 3) world points on the ground.
        axes: (3, 3) rows east, north, up.
        guess: gives world points (N, 3) the height along up that the ground is thought to have there, as far as it is known
            otherwise (a street's cross profile, kerbs included); the points say how the ground departs from it.
    Returns:
        the ground, or None without points.
    """
    if not len(points):
        return None
    local = points @ axes.T
    low, high = local[:, :2].min(axis=0), local[:, :2].max(axis=0)
    cell = max(CELL_M, float(np.sqrt(np.prod(high - low) / MOST_CELLS)))
    corner = low - REACH_M - 2 * cell
    shape = np.ceil((high + REACH_M - corner) / cell).astype(int) + 3

    def guessed(horizontal: Float64) -> Float64:
        level = np.concatenate([horizontal, np.zeros((len(horizontal), 1))], axis=1)
        return np.zeros(len(horizontal)) if guess is None else guess(level @ axes)

    departure = _cell_medians(local[:, :2], local[:, 2] - guessed(local[:, :2]), corner, cell, shape)
    departure[_humps(departure, round(OPENED_M / cell) | 1, HUMP_M)] = np.nan
    east, north = np.meshgrid(*(np.arange(n) * cell for n in shape), indexing="ij")
    base = guessed(np.stack([east.ravel(), north.ravel()], axis=1) + corner).reshape(departure.shape)
    height = base + _spread(departure, [width / cell for width in SMOOTHED_M])
    height[~_surrounded(np.isfinite(departure), REACH_M / cell)] = np.nan
    return HeightField(axes, corner, cell, height)


def _cell_medians(
    horizontal: Float64, values: Float64, corner: Float64, cell: float, shape: NDArray[np.int64]
) -> Float64:
    """(A, B) median of the values (P,) in each cell, NaN where there is none."""
    index = np.round((horizontal - corner) / cell).astype(np.int64)
    key = index[:, 0] * shape[1] + index[:, 1]
    order = np.lexsort((values, key))
    cells, first, count = np.unique(key[order], return_index=True, return_counts=True)
    grid = np.full(int(np.prod(shape)), np.nan)
    grid[cells] = values[order][first + count // 2]
    return grid.reshape(shape)


def _humps(departure: Float64, opened: int, most: float) -> NDArray[np.bool_]:
    """(A, B) cells that stand out by more than ``most`` of an opening of ``opened`` cells; unknown ones (NaN) have no say."""
    window = np.ones((opened, opened), np.uint8)
    known = np.isfinite(departure)
    lowest = cv2.erode(np.where(known, departure, np.inf).astype(np.float32), window)
    floor = cv2.dilate(np.where(np.isfinite(lowest), lowest, -np.inf).astype(np.float32), window)
    humps: NDArray[np.bool_] = known & (np.where(known, departure, 0) > floor + most)
    return humps


def _spread(departure: Float64, widths: list[float]) -> Float64:
    """(A, B) of the known departures everywhere, by averages from wide to narrow (in cells)."""
    known = np.isfinite(departure)
    values, weights = np.where(known, departure, 0).astype(np.float32), known.astype(np.float32)
    out = np.full(departure.shape, float(np.median(departure[known])) if known.any() else 0.0)
    for width in widths:
        weight = cv2.GaussianBlur(weights, (0, 0), width, borderType=cv2.BORDER_CONSTANT)
        mean = cv2.GaussianBlur(values, (0, 0), width, borderType=cv2.BORDER_CONSTANT) / np.maximum(weight, 1e-6)
        trust = np.clip(weight * (2 * np.pi * width**2) / ENOUGH_CELLS, 0, 1)
        out += trust * (mean - out)
    return out


def _surrounded(known: NDArray[np.bool_], radius: float) -> NDArray[np.bool_]:
    """(A, B) the known cells closed by a disc of ``radius`` cells; the grid's border must be farther from them than that."""
    away = cv2.distanceTransform((~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    inside = cv2.distanceTransform((away <= radius).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # Half a cell's diagonal: between centres the disc would otherwise cut off the known cells of the rim.
    surrounded: NDArray[np.bool_] = known | (inside > radius - 0.7)
    return surrounded
