"""The points of an object in space: those that hang together with what was clicked."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64, Mask
from unveil_core.drives.drive import Drive
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.geometry.clusters import connected_points
from unveil_core.marking.min_cut import cut_from
from unveil_core.marking.prompts import Prompts
from unveil_core.marking.scene_points import ScenePoints
from unveil_core.semantics.instances import fit_box
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
LEAST_REACH_M = 2.0
FARTHEST = 3.0
COMPACT = 1.5
VEHICLE_M = (6.5, 2.9, 4.3)
TALL = np.array([1.0, 1.0, 1.5])
GAP = 5.0
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
    clicks = np.unique(of)
    places = np.stack([np.median(points.positions[inside[of == k]], axis=0) for k in clicks])
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    spread = float(apart.max()) if len(clicks) > 1 else 0.0
    reach = max(LEAST_REACH_M, spread)
    away = cKDTree(places * TALL).query(points.positions * TALL)[0]
    near = np.flatnonzero(points.standing & (away < FARTHEST * reach))
    usual = float(np.median(points.spacing[inside]))
    shown = np.isin(inside, near)
    own, other = np.searchsorted(near, inside[shown]), np.isin(near, outside)
    chosen = _stable(points.positions[near], own, of[shown], other, usual)
    if chosen is not None and not _one_thing(points.positions[near[chosen]], away[near[chosen]], reach, spread):
        chosen = None
    if chosen is None:
        chosen = cut_from(
            points.positions[near],
            points.normals[near],
            points.colors[near],
            own,
            np.flatnonzero(other),
            gap=float(np.clip(GAP * usual, SHORTEST_M, LONGEST_M)),
            far=np.clip((away[near] - reach) / reach, 0.0, 1.0),
        )
    found = np.zeros(len(points.positions), dtype=bool)
    found[near[chosen]] = True
    return found


def _stable(
    places: Float64, own: NDArray[np.int64], of: NDArray[np.int64], other: Mask, usual: float
) -> Mask | None:
    """(N,) the widest cluster of places (N, 3) around those clicked that holds with a smaller gap, too; None where none does.

    Args:
        own: (K,) indices of clicked places; of: (K,) their clicks.
        other: (N,) places that were clicked as others.
    """
    gaps = [float(np.clip(times * usual, SHORTEST_M, LONGEST_M)) for times in GAPS]
    clusters = [_hanging(places, own, of, gap) for gap in gaps]
    for wide, narrow in zip(clusters, clusters[1:], strict=False):
        if not (wide & other).any() and narrow.sum() >= STABLE * wide.sum():
            return wide
    return None


def _one_thing(places: Float64, away: Float64, reach: float, spread: float) -> bool:
    """Whether a cluster of places (N, 3) can be what was clicked: it lies around the clicks, or is no larger than a vehicle."""
    if away.max() <= COMPACT * reach:
        box = fit_box(places, up_frame(UP), gap=1.0)
        return box.size[1]<=99
    box = fit_box(places, up_frame(UP), gap=1.0)
    length, width, height = box.size
    return length <= max(VEHICLE_M[0], 2.5 * spread) and width <= VEHICLE_M[1] and height <= VEHICLE_M[2]


def _hanging(places: Float64, own: NDArray[np.int64], of: NDArray[np.int64], gap: float) -> Mask:
    """(N,) places in the clusters that each hold most of what some click hit."""
    cluster = connected_points(places, gap)
    chosen = [np.bincount(cluster[own[of == k]]).argmax() for k in np.unique(of)]
    return np.isin(cluster, chosen)


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
