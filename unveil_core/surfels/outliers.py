"""Outliers: the spacing of a point cloud, and the points that it does not explain.

A statistical test of the distances to the neighbours (Rusu et al. 2008, *Towards 3D point cloud based object maps for
household environments*), against two references instead of one of the whole cloud: a LiDAR's spacing grows with the
distance, so a point is compared with its neighbours, and with all points at its distance from the cameras.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.geometry.cloud import neighbours_of

__all__ = ["lonely_points"]

NEIGHBOURS, NEAREST = 24, 4
BESIDE_NEIGHBOURS, AT_ITS_RANGE = 2.5, 2.5
"""How many times the spacing of its neighbours, or of the points at its distance, makes a point lonely."""
RANGES = 32
CHUNK = 200_000
"""Points that are looked at together: their neighbours take 200 MB."""
LEAST_POINTS = 200
"""Fewer are no cloud that has a spacing."""


def _chunks(count: int) -> Iterator[slice]:
    return (slice(first, min(first + CHUNK, count)) for first in range(0, count, CHUNK))


def lonely_points(
    positions: NDArray[np.float64], viewpoints: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Spacing of points, and which stand much farther from the others than those do from one another.

    Args:
        positions: (P, 3), metres; viewpoints: (V, 3) camera centres.
    Returns:
        the spacing (P,): root mean square distance to the three nearest neighbours; lonely (P,).
    """
    count = len(positions)
    k = min(NEIGHBOURS, count - 1)
    if k < 3:
        return np.full(count, 0.1), np.zeros(count, bool)
    tree = cKDTree(positions)
    spacing, mean_distance, beside = np.empty(count), np.empty(count), np.empty(count)
    for part in _chunks(count):
        distance = neighbours_of(positions[part], tree, min(NEAREST, k) + 1)[0][:, 1:]
        spacing[part] = np.sqrt(np.mean(distance[:, :3] ** 2, axis=1))
        mean_distance[part] = distance.mean(axis=1)
    if count < LEAST_POINTS:
        return spacing, np.zeros(count, bool)
    for part in _chunks(count):
        index = neighbours_of(positions[part], tree, k + 1)[1][:, 1:]
        # The lower quartile: where strays are many, most neighbours of a stray are strays too.
        beside[part] = np.partition(mean_distance[index], k // 4, axis=1)[:, k // 4]
    usual = np.empty(count)
    away = cKDTree(viewpoints).query(positions)[0]
    for alike in np.array_split(np.argsort(away, kind="stable"), RANGES):
        usual[alike] = np.median(mean_distance[alike])
    return spacing, (mean_distance > BESIDE_NEIGHBOURS * beside) | (mean_distance > AT_ITS_RANGE * usual)
