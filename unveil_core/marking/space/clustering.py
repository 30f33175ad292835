"""The points of an object in space: those that hang together with what was clicked."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64, Mask
from unveil_core.drives.drive import Drive
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.geometry.clusters import connected_points
from unveil_core.marking.asked.prompts import Prompts
from unveil_core.marking.space.min_cut import cut_from
from unveil_core.marking.space.scene_points import ScenePoints
from unveil_core.semantics.instances import fit_box
from unveil_core.semantics.visibility import PointsInView

__all__ = ["clicked_points", "cluster_around", "first_points"]

CLICK_SHARE, LEAST_PX = 0.02, 3.0
"""Points no farther from a click than this share of the picture's width, and than so many pixels, may be what was clicked."""
MOST_NEAR = 8
"""Points that a click hits at most, the nearest in the picture."""
STEP_M, STEP_SHARE = 0.4, 0.02
"""Points near a click that are farther apart in depth than so many metres and this share of it are of two surfaces: something is
seen past the object, or stands before it. The surface with most of them was clicked."""
WELL = MOST_NEAR // 2
"""A click that hits fewer points than this hit what stands before the object, if they are nearer by such a step than what others
hit well: no point comes back from panes and dark paint, and then the next in the picture are of the nearer thing's border."""
UNDER_M = 2.5
"""Of the points under a stroke those count that lie no farther from the middle one in depth, metres: a car's half length."""
GAPS = (5.0, 4.0, 3.2, 2.6, 2.1, 1.7)
"""Points no farther apart than so many times what is usual between those clicked hang together; the widest that holds is taken."""
SHORTEST_M, LONGEST_M = 0.08, 1.2
"""Between which such a gap lies, metres."""
STABLE = 0.9
"""A cluster holds if with the next smaller gap this share of its points still hangs together: what is joined by a few points is two
things."""
BOX_MARGIN_M = 0.15
"""Around the box of a cluster, metres: what lies in it is of one thing with the cluster that it hangs together with."""
TALL = np.array([1.0, 1.0, 1.5])
"""How much more a metre counts that a point is higher or lower than the clicks: what is on the street is longer than high."""
LEAST_REACHES_M, REACH = (3.0, 2.5, 2.0), 0.6
"""Clicks mean what lies no farther away than this, metres, and than this share of what they are apart from each other: those on one
end of a car mean all of it. The first that cuts out what may be one thing counts; where none does, the last."""
HOLD_M = 1.8
"""What lies nearer to a click than this, metres, is rather its object's: a car is so wide, and clicks on its tail alone mean all of
it."""
VEHICLE_M = (6.5, 2.9, 4.3)
"""Length, width and height of a cluster that is one thing, however close together the clicks are: a van with its mirrors. It may be
longer where clicks are farther apart."""
LONG = 2.5
"""So many times as long as the clicks are apart."""
FARTHEST = 4.0
"""What lies so many times farther away than clicks mean is not looked at."""


def first_points(drive: Drive, points: ScenePoints, prompts: Prompts) -> Mask:
    """(P,) the points of an object by its clicks and strokes; none where these hit no point."""
    inside, of, outside = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    count = 0
    for v, prompt in prompts.frames.items():
        width, seen = drive.frames[v].camera.width, points.views[v]
        hit, click = clicked_points(points, seen, prompt.inside, width)
        inside.append(hit)
        of.append(click + count)
        count += len(prompt.inside)
        outside.append(clicked_points(points, seen, prompt.outside, width)[0])
        for drawn in (prompt.stroke, prompt.matte):
            if drawn is not None:
                hit = _under(points, seen, drawn)
                inside.append(hit)
                of.append(np.full(len(hit), count))
                count += 1
    own = np.concatenate(inside)
    if not len(own):
        return np.zeros(len(points.positions), dtype=bool)
    return cluster_around(points, own, np.concatenate(of), np.setdiff1d(np.concatenate(outside), own))


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
    found, owner = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    if len(standing) and len(places):
        tree = cKDTree(np.stack([seen.columns[standing], seen.rows[standing]], axis=1) + 0.5)
        reach, k = max(LEAST_PX, CLICK_SHARE * width), min(MOST_NEAR, len(standing))
        away, index = (a.reshape(len(places), k) for a in tree.query(places, k=k, distance_upper_bound=reach))
        for click in range(len(places)):
            near = standing[index[click][np.isfinite(away[click])]]
            if len(near):
                near = near[_of_one_surface(seen.depth[near])]
                found.append(seen.index[near])
                owner.append(np.full(len(near), click))
    hit, of = np.concatenate(found), np.concatenate(owner)
    depth = np.full(len(points.positions), np.nan)
    depth[seen.index] = seen.depth
    kept = ~np.isin(of, _strays(depth[hit], of))
    return hit[kept], of[kept]


def _strays(depth: Float64, of: NDArray[np.int64]) -> list[int]:
    """The clicks, of those that points of some depths (K,) belong to, that hit something before the object."""
    middles = {int(k): float(np.median(depth[of == k])) for k in np.unique(of)}
    well = [m for k, m in middles.items() if (of == k).sum() >= WELL]
    nearest = min(well, default=0.0) * (1 - STEP_SHARE) - STEP_M
    return [k for k, m in middles.items() if (of == k).sum() < WELL and m < nearest]


def _of_one_surface(depth: Float64) -> NDArray[np.int64]:
    """Which of some depths (N,) follow each other without a step: the most that do, the nearest of as many."""
    order = np.argsort(depth, kind="stable")
    steps = np.diff(depth[order]) > STEP_M + STEP_SHARE * depth[order][:-1]
    groups = np.split(order, np.flatnonzero(steps) + 1)
    return max(groups, key=len)


def _under(points: ScenePoints, seen: PointsInView, drawn: Mask) -> NDArray[np.int64]:
    """Standing points under a stroke, without what is seen past the object."""
    hit = np.flatnonzero(drawn[seen.rows, seen.columns] & points.standing[seen.index])
    if not len(hit):
        return np.zeros(0, np.int64)
    middle = float(np.median(seen.depth[hit]))
    return seen.index[hit[np.abs(seen.depth[hit] - middle) <= UNDER_M + STEP_SHARE * middle]]


def cluster_around(
    points: ScenePoints, inside: NDArray[np.int64], of: NDArray[np.int64], outside: NDArray[np.int64]
) -> Mask:
    """(P,) the points that hang together with those that were clicked, and not with those that were clicked as others.

    Args:
        inside: (K,) indices of clicked points, one at least; of: (K,) the click that each belongs to.
        outside: indices of points clicked as others.
    """
    clicks = [inside[of == k] for k in np.unique(of)]
    middles = np.stack([np.median(points.positions[hit], axis=0) for hit in clicks])
    hit = points.positions[inside]
    spread = float(np.linalg.norm(np.ptp(np.concatenate([middles, _bulk(hit)]), axis=0)))
    reaches = list(dict.fromkeys(max(least, REACH * spread) for least in LEAST_REACHES_M))
    away = cKDTree(np.concatenate([middles, hit[:: max(1, len(hit) // 200)]]) * TALL).query(points.positions * TALL)[0]
    near = np.flatnonzero(points.standing & (away < FARTHEST * reaches[-1]))
    places, usual = points.positions[near], float(np.median(points.spacing[inside]))
    known = np.isin(inside, near)
    own, other = np.searchsorted(near, inside[known]), np.isin(near, outside)
    chosen = _stable(places, own, of[known], other, usual, spread)
    others_nearer = np.zeros(len(near), dtype=bool)
    if other.any():
        others_nearer = cKDTree(places[other] * TALL).query(places * TALL)[0] < away[near]
    for reach in reaches if chosen is None else ():
        chosen = cut_from(
            places,
            points.normals[near],
            points.colors[near],
            own,
            np.flatnonzero(other),
            gap=float(np.clip(GAPS[0] * usual, SHORTEST_M, LONGEST_M)),
            near=np.where(others_nearer, 0.0, np.clip(1 - away[near] / HOLD_M, 0.0, 1.0)),
            far=np.where(others_nearer, 1.0, np.clip((away[near] - reach) / reach, 0.0, 1.0)),
        )
        if _one_thing(places[chosen], spread):
            break
    found = np.zeros(len(points.positions), dtype=bool)
    found[near[chosen]] = True
    return found


def _bulk(places: Float64) -> Float64:
    """(2, 3) corners of a box around most of places (N, 3): a stroke has no clicks that are apart."""
    return np.percentile(places, [10, 90], axis=0)


def _stable(
    places: Float64, own: NDArray[np.int64], of: NDArray[np.int64], other: Mask, usual: float, spread: float
) -> Mask | None:
    """(N,) the cluster of places (N, 3) around those clicked, by the widest gap that holds with a smaller one, too, and makes
    one thing; None where none does.

    Args:
        own: (K,) indices of clicked places; of: (K,) their clicks.
        other: (N,) places that were clicked as others.
        usual: distance between neighbours; spread: between the clicks, metres.
    """
    gaps = [float(np.clip(times * usual, SHORTEST_M, LONGEST_M)) for times in GAPS]
    clusters = [_hanging(places, own, of, gap) for gap in gaps]
    for k, wide in enumerate(clusters[:-1]):
        narrower = [c for c in clusters[k + 1 :] if c.sum() >= STABLE * wide.sum()]
        if narrower and not (wide & other).any():
            # What a few points join, as a sign beside a van, is left out, but not the object's own sparse parts.
            box = fit_box(places[narrower[-1]], up_frame(UP), gap=1.0)
            found = narrower[-1] | (wide & box.contains(places, up_frame(UP), margin=BOX_MARGIN_M, above=-BOX_MARGIN_M))
            if _one_thing(places[found], spread):
                return found
    return None


def _hanging(places: Float64, own: NDArray[np.int64], of: NDArray[np.int64], gap: float) -> Mask:
    """(N,) places in the clusters that each hold most of what some click hit."""
    cluster = connected_points(places, gap)
    chosen = [np.bincount(cluster[own[of == k]]).argmax() for k in np.unique(of)]
    return np.isin(cluster, chosen)


def _one_thing(places: Float64, spread: float) -> bool:
    """Whether a cluster of places (N, 3) can be what was clicked, ``spread`` metres apart: it is no larger than a vehicle."""
    length, width, height = fit_box(places, up_frame(UP), gap=1.0).size
    return length <= max(VEHICLE_M[0], LONG * spread) and width <= VEHICLE_M[1] and height <= VEHICLE_M[2]
