"""The points of an object in space: those that hang together with what was clicked."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64, Mask
from unveil_core.drives.drive import Drive
from unveil_core.geometry.clusters import connected_points
from unveil_core.marking.prompts import Prompts
from unveil_core.marking.scene_points import ScenePoints
from unveil_core.semantics.visibility import PointsInView

__all__ = ["clicked_points", "cluster_around", "first_points"]

CLICK_SHARE = 0.02
"""Of the picture's width: points no farther from a click than this may be what was clicked."""
FRONT_M, FRONT_SHARE = 0.6, 0.03
"""Of the points near a click those count that lie no farther behind the nearest than so many metres and this share of its depth: an
object's surface is that steep; what is seen past it, or through its panes, lies farther."""
MOST_NEAR = 8
"""Points that a click hits at most, the nearest in the picture."""
FEWEST_NEAR = 3
"""A lone point before all others near a click may be noise."""
GAPS = (5.0, 4.0, 3.2, 2.6, 2.1, 1.7)
"""Points no farther apart than so many times what is usual between those clicked hang together; the widest that holds is taken."""
SHORTEST_M, LONGEST_M = 0.08, 1.2
"""Between which such a gap lies, metres."""
STABLE = 0.9
"""A cluster holds if with the next smaller gap this share of its points still hangs together: what is joined by a few points is two
things."""
LARGEST_M = 20.0
"""No object is longer, metres: a house front is none, and hangs together with the next."""
REACH_M = 40.0
"""Farther from all clicks than this nothing is looked at, metres."""
BALL_M = 2.5
"""Where nothing holds, what lies no farther than this along the surface from a click is taken, metres."""


def clicked_points(
    points: ScenePoints, seen: PointsInView, places: Float64, width: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The points that clicks in a frame hit.

    Args:
        seen: what the frame sees; places: (N, 2) clicks, pixels; width: of the picture, pixels.
    Returns:
        indices of points (K,), and the click (K,) that each belongs to.
    """
    standing = np.flatnonzero(points.standing[seen.index])
    if not len(standing) or not len(places):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    tree = cKDTree(np.stack([seen.columns[standing], seen.rows[standing]], axis=1) + 0.5)
    found, owner = [], []
    for k, place in enumerate(places):
        away, index = tree.query(place, k=min(MOST_NEAR, len(standing)), distance_upper_bound=max(3.0, CLICK_SHARE * width))
        near = standing[np.atleast_1d(index)[np.isfinite(np.atleast_1d(away))]]
        if not len(near):
            continue
        depth = seen.depth[near]
        front = np.sort(depth)[min(FEWEST_NEAR, len(depth)) - 1]
        near = near[depth <= front * (1 + FRONT_SHARE) + FRONT_M]
        found.append(seen.index[near])
        owner.append(np.full(len(near), k))
    if not found:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    return np.concatenate(found), np.concatenate(owner)


def cluster_around(
    points: ScenePoints, inside: NDArray[np.int64], of: NDArray[np.int64], outside: NDArray[np.int64]
) -> Mask:
    """(P,) the points that hang together with those that were clicked, and not with those that were clicked as others.

    Args:
        inside: (K,) indices of clicked points, one at least; of: (K,) the click that each belongs to.
        outside: indices of points clicked as others.
    """
    middle = points.positions[inside].mean(axis=0)
    near = np.flatnonzero(points.standing & (np.linalg.norm(points.positions - middle, axis=1) < REACH_M))
    places = points.positions[near]
    usual = float(np.median(points.spacing[inside]))
    within = np.isin(inside, near)
    own, other = np.searchsorted(near, inside[within]), np.isin(near, outside)
    found = np.zeros(len(points.positions), dtype=bool)
    found[near[_stable(places, own, of[within], other, usual)]] = True
    return found


def _stable(
    places: Float64, own: NDArray[np.int64], of: NDArray[np.int64], other: Mask, usual: float
) -> Mask:
    """(N,) the widest cluster of places (N, 3) around some of them that holds with a smaller gap, too."""
    gaps = [float(np.clip(times * usual, SHORTEST_M, LONGEST_M)) for times in GAPS]
    clusters = [_hanging(places, own, of, gap) for gap in gaps]
    for wide, narrow in zip(clusters, clusters[1:], strict=False):
        if (wide & other).any() or np.ptp(places[wide], axis=0).max() > LARGEST_M:
            continue
        if narrow.sum() >= STABLE * wide.sum():
            return wide
    return _nearest_along(places, own, other, gaps[2])


def _hanging(places: Float64, own: NDArray[np.int64], of: NDArray[np.int64], gap: float) -> Mask:
    """(N,) places in the clusters that each hold most of what some click hit."""
    cluster = connected_points(places, gap)
    chosen = [np.bincount(cluster[own[of == k]]).argmax() for k in np.unique(of)]
    return np.isin(cluster, chosen)


def _nearest_along(places: Float64, own: NDArray[np.int64], other: Mask, gap: float) -> Mask:
    """(N,) places nearer along the surface to those clicked than to the others, and near enough."""
    pairs = cKDTree(places).query_pairs(gap, output_type="ndarray")
    length = np.linalg.norm(places[pairs[:, 0]] - places[pairs[:, 1]], axis=1)
    graph = coo_matrix((length, (pairs[:, 0], pairs[:, 1])), shape=(len(places),) * 2).tocsr()
    way = dijkstra(graph, directed=False, indices=np.unique(own), limit=BALL_M, min_only=True)
    found: Mask = np.isfinite(way)
    if other.any():
        found &= way < dijkstra(graph, directed=False, indices=np.flatnonzero(other), limit=2 * BALL_M, min_only=True)
    found[own] = True
    return found


def first_points(drive: Drive, points: ScenePoints, prompts: Prompts) -> Mask:
    """(P,) the points of an object by its clicks and strokes alone; none where these hit no point."""
    inside, of, outside = [], [], [np.zeros(0, np.int64)]
    count = 0
    for v, prompt in prompts.frames.items():
        camera, seen = drive.frames[v].camera, points.views[v]
        hit, click = clicked_points(points, seen, prompt.inside, camera.width)
        inside.append(hit)
        of.append(click + count)
        count += len(prompt.inside)
        outside.append(clicked_points(points, seen, prompt.outside, camera.width)[0])
        for drawn in (prompt.stroke, prompt.matte):
            if drawn is not None:
                hit = _under(points, seen, drawn)
                inside.append(hit)
                of.append(np.full(len(hit), count))
                count += 1
    own = np.concatenate(inside) if inside else np.zeros(0, np.int64)
    if not len(own):
        return np.zeros(len(points.positions), dtype=bool)
    return cluster_around(points, own, np.concatenate(of), np.setdiff1d(np.concatenate(outside), own))


def _under(points: ScenePoints, seen: PointsInView, drawn: Mask) -> NDArray[np.int64]:
    """Standing points under a stroke, without what is seen past the object."""
    hit = np.flatnonzero(drawn[seen.rows, seen.columns] & points.standing[seen.index])
    if not len(hit):
        return np.zeros(0, np.int64)
    middle = float(np.median(seen.depth[hit]))
    return seen.index[hit[np.abs(seen.depth[hit] - middle) <= 0.5 * LARGEST_M * 0.25 + FRONT_SHARE * middle]]
