"""Points: one of each cell of a grid, and how the surface that they lie on is turned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.kernels.hashing import slot_of
from unveil_core.base.parallel import each

__all__ = ["estimate_normals", "every_nth", "neighbours_of", "quats_from_normals", "thin_points", "thinned_to"]

AT_ONCE = 1 << 14
"""Points whose neighbours a thread looks for at a time: some hundredths of a second."""


def neighbours_of(
    points: NDArray[np.float64], tree: cKDTree, count: int
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """As ``tree.query``, with several threads, but not with scipy's: one of those that finds no memory ends without a word to its
    caller, who gets arrays that hold anything.

    Args:
        points: (P, 3); count: how many neighbours, two or more.
    Returns:
        their distances (P, count), the nearest first, and their indices (P, count) in the tree.
    """
    distance, index = np.empty((len(points), count)), np.empty((len(points), count), np.intp)

    def search(first: int) -> None:
        part = slice(first, first + AT_ONCE)
        distance[part], index[part] = tree.query(points[part], k=count)

    for _ in each(search, range(0, len(points), AT_ONCE)):
        pass
    return distance, index


def thin_points(positions: NDArray[np.float64], cell: NDArray[np.float64] | float) -> NDArray[np.int64]:
    """Indices of one point per cell of a grid, the first in the given order.

    Args:
        positions: (P, 3).
        cell: grid size in metres, one for all or (P,) per point (rounded to powers of two of the smallest).
    """
    size = np.broadcast_to(np.asarray(cell, dtype=np.float64), (len(positions),))
    level = np.round(np.log2(np.maximum(size / max(size.min(initial=np.inf), 1e-12), 1.0)))
    size = size.min(initial=np.inf) * 2.0**level
    key = np.floor(positions / size[:, None]).astype(np.int64)
    key = np.column_stack([key, level.astype(np.int64)])
    table = np.full(1 << int(2 * len(key)).bit_length(), -1, dtype=np.int64)
    return np.flatnonzero(_firsts(key, table))


@njit(cache=True)
def _firsts(keys, table):  # type: ignore[no-untyped-def]
    """(P,) which of the keys (P, 4) are the first of their kind; ``table``: twice as many free slots, -1."""
    first = np.zeros(len(keys), dtype=np.bool_)
    for i in range(len(keys)):
        x, y, z, level = keys[i, 0], keys[i, 1], keys[i, 2], keys[i, 3]
        slot = slot_of(slot_of(x, 1 << 62) ^ (y << 21) ^ (z << 42) ^ level, table.size)
        while True:
            other = table[slot]
            if other < 0:
                table[slot], first[i] = i, True
                break
            if keys[other, 0] == x and keys[other, 1] == y and keys[other, 2] == z and keys[other, 3] == level:
                break
            slot = (slot + 1) & (table.size - 1)
    return first


def every_nth(points: NDArray[np.float64], most: int) -> NDArray[np.float64]:
    """(Q, 3) at most so many of the points (P, 3), evenly from their order: of a LiDAR's sweeps, evenly from all."""
    return points[:: max(1, -(-len(points) // most))]


def thinned_to(positions: NDArray[np.float64], most: int) -> NDArray[np.int64]:
    """Indices of at most so many points, spread over what all of them (P, 3) cover: one per cell of the finest grid that leaves so
    few."""
    some, cell = np.arange(len(positions)), 0.0
    while len(some) > most:
        cell = max(0.05, cell * 1.5)
        some = thin_points(positions, cell)
    return some


def estimate_normals(
    positions: NDArray[np.float64], viewpoints: NDArray[np.float64], *, neighbours: int = 12
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normals by principal components of each point's neighbourhood, turned towards the nearest viewpoint.

    Args:
        positions: (P, 3).
        viewpoints: (V, 3) camera centres.
        neighbours: size of the neighbourhood.
    Returns:
        unit normals (P, 3) and the spacing (P,): root mean square distance to the three nearest neighbours.
    """
    count = len(positions)
    k = min(neighbours, count - 1)
    if k < 3:
        toward = viewpoints.mean(axis=0) - positions
        return toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-12), np.full(count, 0.1)
    distance, index = neighbours_of(positions, cKDTree(positions), k + 1)
    spacing = np.sqrt(np.mean(distance[:, 1:4] ** 2, axis=1))
    local = positions[index] - positions[index].mean(axis=1, keepdims=True)
    covariance = np.einsum("pki,pkj->pij", local, local)
    normal = np.linalg.eigh(covariance)[1][:, :, 0]
    nearest = cKDTree(viewpoints).query(positions)[1]
    flip = np.sum(normal * (viewpoints[nearest] - positions), axis=1) < 0
    normal[flip] *= -1
    return normal, spacing


def quats_from_normals(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternions (P, 4) wxyz that turn the z axis to ``normal`` (P, 3) by the shortest way."""
    w = 1 + normal[:, 2]
    quat = np.stack([w, -normal[:, 1], normal[:, 0], np.zeros(len(normal))], axis=1)
    quat[w < 1e-6] = (0.0, 1.0, 0.0, 0.0)
    return quat / np.linalg.norm(quat, axis=1, keepdims=True)
