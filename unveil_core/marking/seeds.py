"""What geometry says of an object in one photograph: pixels that are surely its own, that may be, and that something hides."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64, Mask
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import disc, grow, within
from unveil_core.marking.space.scene_points import ABOVE_GROUND_M, ScenePoints
from unveil_core.semantics.visibility import PointsInView

__all__ = ["Seeds", "seeds_of"]

FOOT_M = 0.7
"""Points of an object no higher over the ground than this, metres, stand on it: its outline may go on below them."""
SILL_M = 0.25
"""Between the wheels a car ends about this high over the ground, metres: what is lower is its own where points lie."""
WHEEL_M = 0.2
"""Points lower than this, metres, are of what the object stands on: it reaches the ground below them."""
BEFORE_M = 0.4
"""What is nearer than the object's own points beside it by more than this, metres, hides it."""
PANE_M = 0.35
"""Half the height of a window, metres: no point comes back from it, but one does not see past the car through it either."""
AROUND = 5
"""A point is hidden if most of so many points of other things about it in the picture are nearer."""
FEWEST_SEEN = 0.02
"""A frame shows an object of whose points in its picture it sees this share."""
PAD = 0.3
"""Width of what is looked at around an object, so that colours beside it are learned, a share of its size."""
CLOSED = 0.12
"""Gaps between an object's points up to twice this wide are its own, a share of its size: no point comes back from panes."""
BESIDE = 0.03
"""How far outside of its points' outline an object may reach, a share of its size."""
DEEP = 0.12
"""What lies so far inside of the outline of an object's points, a share of its size, is its own. With 0.06 and 0.18 outlines of the
sample scenes are worse (``benchmarks/input/clicks.py``)."""


@dataclass(frozen=True, eq=False)
class Seeds:
    """What geometry says of an object in a photograph. All masks are of its window of the picture.

    Attributes:
        window: rows and columns of the picture.
        sure: pixels that its points show to be its own; likely: within their outline; possible: beside it.
        hidden: pixels of what stands before it.
        other: pixels of points of something else.
        size: of the object, pixels.
    """

    window: tuple[slice, slice]
    sure: Mask
    likely: Mask
    possible: Mask
    hidden: Mask
    other: Mask
    size: float


def seeds_of(camera: Camera, points: ScenePoints, own: Mask, seen: PointsInView, loose: float = 0.0) -> Seeds | None:
    """Where an object lies in a frame; None where the frame does not show it.

    Args:
        own: (P,) the object's points; seen: what the frame sees.
        loose: by how much the outline may be elsewhere than its points say, a share of its size.
    """
    places, over = points.positions[own], points.over[own]
    low = over < FOOT_M
    hull = _hull(camera, np.concatenate([places, _on_ground(places[low], over[low])]))
    mine = own[seen.index]
    if hull is None or mine.sum() < max(2, FEWEST_SEEN * len(camera.shown(places, nearest=NEAR_M)[0])):
        return None
    inside = np.clip(hull, 0, (camera.width, camera.height))
    wide, tall = (float(v) for v in np.ptp(inside, axis=0))
    if min(wide, tall) < 1:
        return None
    size = float(np.sqrt(wide * tall))
    pad = 4 + (PAD + 2 * loose) * size
    x0, y0 = (int(v) for v in np.maximum(np.floor(inside.min(axis=0) - pad), 0))
    x1, y1 = (int(v) for v in np.minimum(np.ceil(inside.max(axis=0) + pad), (camera.width, camera.height)))
    shape = (y1 - y0, x1 - x0)
    whole = _filled(hull - (x0, y0), shape)
    high = ~(over < SILL_M)
    upper = _hull(camera, places[high]) if high.sum() > 2 else None
    body = whole if upper is None else _filled(upper - (x0, y0), shape)

    at = np.stack([seen.columns - x0, seen.rows - y0], axis=1)
    here = ((at >= 0) & (at < (shape[1], shape[0]))).all(axis=1)
    at, depth, mine, height = at[here], seen.depth[here], mine[here], points.over[seen.index[here]]
    upright = ~mine & ~(height <= ABOVE_GROUND_M)
    mine[np.flatnonzero(mine)[_behind_others(at, depth, mine, upright)]] = False
    if mine.sum() < 2:
        return None
    before = depth < _own_depth(at, depth, mine) - BEFORE_M
    covered = _covered(at[before & upright], depth[before & upright], camera, size, shape)
    mine &= ~covered[at[:, 1], at[:, 0]]
    if mine.sum() < 2:
        return None
    gap = float(np.sqrt(max(int(whole.sum()), 1) / mine.sum()))
    measured = _closed(_dotted(at[mine], shape), np.clip(1.2 * gap, 1, 1 + 0.06 * size))
    legs = _legs(camera, places, over, np.isin(np.flatnonzero(own), seen.index), (x0, y0), shape)
    # What is closed below the body would be the shade between the wheels.
    likely = (_closed(measured, 1 + CLOSED * size) & (body | ~whole)) | body | legs
    possible = within(likely | whole, 1.5 + BESIDE * size + 0.5 * gap)
    sure = (cv2.erode(measured.astype(np.uint8), disc(1)).astype(bool) if size > 30 else measured) | legs
    hidden = covered & ~sure
    behind = ~before & ~mine
    # Points behind are seen through panes, too: low ones count where none of its own lies, the others beside the object only.
    other = _dotted(at[behind & (height <= 0.3 * FOOT_M)], shape) & ~measured
    other |= _dotted(at[behind], shape) & ~likely
    if loose:
        sure = _eroded(body, 1 + loose * size)
        possible = within(whole, loose * size)
        other &= ~possible
    else:
        sure = sure | (_eroded(body, 1 + DEEP * size) & ~grow(other, 1 + 0.5 * gap))
    window = (slice(y0, y1), slice(x0, x1))
    return Seeds(window, sure & ~hidden, likely, possible, hidden, other & ~sure, size)


def _on_ground(places: Float64, over: Float64) -> Float64:
    """(N, 3) the ground below places (N, 3) that are so high over it (N,)."""
    found = places.copy()
    found[:, 2] -= over
    return found


def _hull(camera: Camera, places: Float64) -> NDArray[np.float32] | None:
    """(K, 2) convex outline of places (N, 3) in the picture and beyond; None of fewer than three."""
    pixel, depth = camera.project(places)
    pixel = pixel[depth > NEAR_M]
    if len(pixel) < 3:
        return None
    limit = 4.0 * max(camera.width, camera.height)
    return cv2.convexHull(np.clip(pixel, -limit, limit).astype(np.float32)).reshape(-1, 2).astype(np.float32)


def _legs(
    camera: Camera, places: Float64, over: Float64, seen: Mask, corner: tuple[int, int], shape: tuple[int, int]
) -> Mask:
    """Pixels from low points of an object that are seen down to the ground."""
    low = seen & (over < WHEEL_M)
    mask = np.zeros(shape, np.uint8)
    upper, _ = camera.project(places[low])
    lower, depth = camera.project(_on_ground(places[low], over[low]))
    ends = np.concatenate([upper - corner, lower - corner], axis=1)[depth > NEAR_M] - 0.5
    for xa, ya, xb, yb in np.clip(np.round(ends), -1e4, 1e5).astype(int).tolist():
        cv2.line(mask, (xa, ya), (xb, yb), 1, 1)
    return mask.astype(bool)


def _apart(at: NDArray[np.int64]) -> float:
    """How far apart points at pixels (K, 2) usually are, pixels; 0 of fewer than three."""
    return float(np.median(cKDTree(at).query(at, k=3)[0][:, 2])) if len(at) > 2 else 0.0


def _covered(at: NDArray[np.int64], depth: Float64, camera: Camera, size: float, shape: tuple[int, int]) -> Mask:
    """Pixels of a window that nearer things cover, by their points at pixels (K, 2): between these, and across their panes."""
    dots = _dotted(at, shape)
    if not len(at):
        return dots
    pane = PANE_M * camera.fx / float(np.median(depth))
    return _closed(dots, np.clip(max(1.5 * _apart(at), pane), 1, 1 + 0.25 * size)) | _closed_lines(dots)


def _behind_others(at: NDArray[np.int64], depth: Float64, mine: Mask, upright: Mask) -> Mask:
    """(M,) of the object's own points in a window, those that nearer things around them hide: between the points of these one sees
    through, and what stands close behind is not told apart by a coarse depth buffer.

    Args:
        at: (K, 2) pixels of all points of the window; depth: (K,).
        mine: (K,) M of them the object's; upright: (K,) of other things.
    """
    own, other = at[mine], at[upright]
    if len(other) < AROUND or not len(own):
        return np.zeros(len(own), dtype=bool)
    reach = max(3.0, 3.0 * _apart(other))
    away, index = cKDTree(other).query(own, k=AROUND, distance_upper_bound=reach)
    depths = np.append(depth[upright], np.inf)[index]
    found: Mask = ((depths < depth[mine][:, None] - BEFORE_M) & np.isfinite(away)).sum(axis=1) > AROUND // 2
    return found


def _own_depth(at: NDArray[np.int64], depth: Float64, mine: Mask) -> Float64:
    """(K,) depth of the object's own points beside points of a window at pixels (K, 2)."""
    nearest = cKDTree(at[mine]).query(at, k=min(4, int(mine.sum())))[1].reshape(len(at), -1)
    found: Float64 = np.median(depth[mine][nearest], axis=1)
    return found


def _filled(hull: NDArray[np.floating], shape: tuple[int, int]) -> Mask:
    mask = np.zeros(shape, np.uint8)
    # Pixel centres lie at + 0.5, fillConvexPoly counts from them.
    cv2.fillConvexPoly(mask, np.round((hull - 0.5) * 16).astype(np.int32), 1, shift=4)
    return mask.astype(bool)


def _dotted(at: NDArray[np.int64], shape: tuple[int, int]) -> Mask:
    mask = np.zeros(shape, dtype=bool)
    mask[at[:, 1], at[:, 0]] = True
    return mask


def _eroded(mask: Mask, radius: float) -> Mask:
    return cv2.erode(mask.astype(np.uint8), disc(radius), borderValue=1).astype(bool)


def _closed(mask: Mask, radius: float) -> Mask:
    r = max(int(radius), 1)
    padded = cv2.copyMakeBorder(mask.astype(np.uint8), r, r, r, r, cv2.BORDER_CONSTANT, value=0)
    return cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc(r))[r:-r, r:-r].astype(bool)


def _closed_lines(mask: Mask) -> Mask:
    """Points on a pole lie in rows: what is between them belongs to it."""
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 3), np.uint8)).astype(bool)
