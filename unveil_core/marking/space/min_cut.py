"""The points of an object by a minimum cut: where it hangs together with what it touches by few points, or in a hollow.

After Golovinskiy and Funkhouser, *Min-cut based segmentation of point clouds* (ICCV workshops, 2009): near points are connected,
the clicked ones are the object's, what is far from all clicks costs something to keep, and the cheapest cut between is taken.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.clusters import connected_points

__all__ = ["cut_from"]

NEIGHBOURS = 12
"""Each point is connected with so many next ones."""
FULL = 1000
"""Capacity between two points in one place; SciPy's flow is in whole numbers."""
NO_LIMIT = 1 << 28
HOLLOW = 0.15
"""What remains of a connection across a hollow edge, as between a car and the hedge that it touches."""
COLOUR = 0.12
"""Difference of colours, from 0 to 1, at which a connection has lost 0.6 of its strength."""
HOLD, PULL = 0.12, 0.12
"""What a point at a click costs to leave out, and one far from all clicks to keep, shares of a full connection."""


def cut_from(
    places: Float64,
    normals: Float64,
    colors: Float64,
    own: NDArray[np.int64],
    other: NDArray[np.int64],
    *,
    gap: float,
    near: Float64,
    far: Float64,
) -> Mask:
    """(N,) places that belong to the clicked ones.

    Args:
        places, normals: (N, 3); colors: (N, 3) from 0 to 1.
        own, other: indices of what was clicked as the object, and as not.
        gap: longest connection, metres.
        near: (N,) how near a place is to the clicks, 1 to 0; far: (N,) how far a place is from what clicks can mean, 0 to 1.
    """
    count = len(places)
    k = min(NEIGHBOURS + 1, count)
    away, to = cKDTree(places).query(places, k=k, distance_upper_bound=gap)
    start = np.repeat(np.arange(count), k)
    end, away = to.ravel(), away.ravel()
    use = np.isfinite(away) & (start < end)
    start, end, away = start[use], end[use], away[use]
    usual = float(np.median(away)) if len(away) else 1.0
    weight = np.exp(-((away / (2 * usual)) ** 2))
    step = (places[end] - places[start]) / np.maximum(away, 1e-9)[:, None]
    turn = ((normals[end] - normals[start]) * step).sum(axis=1)
    weight *= np.where(turn < -0.2, HOLLOW, 1.0)
    weight *= np.exp(-0.5 * (np.abs(colors[end] - colors[start]).mean(axis=1) / COLOUR) ** 2)
    capacity = np.maximum(np.round(FULL * weight), 1).astype(np.int32)
    source, sink = count, count + 1
    kept = np.unique(own)
    lost = np.setdiff1d(other, kept)
    held = np.round(FULL * HOLD * near).astype(np.int32)
    held[kept], held[lost] = NO_LIMIT, 0
    pull = np.round(FULL * PULL * far).astype(np.int32)
    pull[lost], pull[kept] = NO_LIMIT, 0
    close, away_from = np.flatnonzero(held), np.flatnonzero(pull)
    rows = np.concatenate([start, end, np.full(len(close), source), away_from])
    columns = np.concatenate([end, start, close, np.full(len(away_from), sink)])
    values = np.concatenate([capacity, capacity, held[close], pull[away_from]])
    graph: csr_matrix = coo_matrix((values, (rows, columns)), shape=(count + 2,) * 2).tocsr()
    flow = maximum_flow(graph, source, sink).flow
    left = graph - flow
    left.data[left.data < 0] = 0
    left.eliminate_zeros()
    reached = breadth_first_order(left, source, return_predecessors=False)
    found = np.zeros(count + 2, dtype=bool)
    found[reached] = True
    # A lone point near the clicks, as one of the ground, belongs to nothing.
    inside = np.flatnonzero(found[:count])
    cluster = connected_points(places[inside], gap)
    hit = np.unique(cluster[np.isin(inside, kept)])
    found[inside] = np.isin(cluster, hit)
    return found[:count]
