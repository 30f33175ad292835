"""The outline of an object in one photograph: its points say where, colours decide between them (GrabCut)."""

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
from unveil_core.labelling.outlines import cut
from unveil_core.marking.prompts import Prompt
from unveil_core.marking.scene_points import ABOVE_GROUND_M, ScenePoints
from unveil_core.semantics.visibility import PointsInView

__all__ = ["Seeds", "object_outline", "seeds_of"]

FOOT_M = 0.7
"""Points of an object no higher over the ground than this, metres, stand on it: its outline goes on below them."""
BEFORE_M = 0.4
"""What is nearer than the object's own points beside it by more than this, metres, hides it."""
CLICK_PX = 0.008
"""Radius of a click, a share of the picture's width."""
TINY_PX = 12
"""Objects smaller than this, pixels, are taken by their points alone: no colours can be learned from so few."""
SILL_M = 0.25
WHEEL_M = 0.2
DEEP = 0.12
"""What lies so far inside of an object's outline, a share of its size, is its own: farther than the gap between a car's wheels."""
LEAST_SHARE = 0.5
"""Of what geometry expects: where colours find less, they are those of the shade that the object stands in."""
FEWEST_SEEN = 0.02
"""An object is shown by a frame that sees this share of the points that lie in its picture."""


@dataclass(frozen=True, eq=False)
class Seeds:
    """What geometry says of an object in a photograph. All masks are of its window of the picture.

    Attributes:
        window: rows and columns of the picture.
        sure: pixels between the object's own points; likely: between these and the outline of them all; possible: beside it.
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


def seeds_of(
    camera: Camera, points: ScenePoints, own: Mask, seen: PointsInView, loose: float = 0.0
) -> Seeds | None:
    """Where an object lies in a frame; None where the frame does not show it.

    Args:
        own: (P,) the object's points; seen: what the frame sees.
        loose: by how much the outline may be elsewhere than its points say, a share of its size.
    """
    places = points.positions[own]
    over = points.over[own]
    low = np.nan_to_num(over, nan=np.inf) < FOOT_M
    feet = places[low] - np.stack([np.zeros(low.sum()), np.zeros(low.sum()), over[low]], axis=1)
    all_of = np.concatenate([places, feet])
    limit = 4.0 * max(camera.width, camera.height)
    hull = _hull(camera, all_of, limit)
    if hull is None:
        return None
    inside = np.clip(hull, 0, (camera.width, camera.height))
    shown = np.ptp(inside, axis=0)
    if shown.min() < 1:
        return None
    in_picture = int(camera.in_picture(*camera.project(places), nearest=NEAR_M).sum())
    mine = own[seen.index]
    if mine.sum() < max(2.0, FEWEST_SEEN * in_picture):
        return None
    size = float(np.sqrt(np.prod(shown)))
    pad = 4 + (0.3 + 2 * loose) * size
    x0, y0 = np.maximum(np.floor(inside.min(axis=0) - pad), 0).astype(int)
    x1, y1 = np.minimum(np.ceil(inside.max(axis=0) + pad), (camera.width, camera.height)).astype(int)
    window = (slice(int(y0), int(y1)), slice(int(x0), int(x1)))
    shape = (int(y1 - y0), int(x1 - x0))
    outline = _filled(hull - (x0, y0), shape)
    high = ~(over < SILL_M)
    body = _hull(camera, places[high], limit) if high.sum() > 2 else hull
    body = outline if body is None else _filled(body - (x0, y0), shape)
    wheels = _legs(camera, places, over, seen_own=np.isin(np.flatnonzero(own), seen.index), corner=(x0, y0), shape=shape)
    rows, columns = seen.rows - y0, seen.columns - x0
    here = (rows >= 0) & (columns >= 0) & (rows < y1 - y0) & (columns < x1 - x0)
    at = np.stack([columns[here], rows[here]], axis=1).astype(np.float64)
    depth, mine, height = seen.depth[here], mine[here], points.over[seen.index[here]]
    if mine.sum() < 2:
        return None
    gap = float(np.sqrt(max(int(outline.sum()), 1) / mine.sum()))
    measured = _closed(_dotted(at[mine], outline.shape), np.clip(1.2 * gap, 1, 1 + 0.06 * size))
    sure = cv2.erode(measured.astype(np.uint8), disc(1)).astype(bool) if size > 30 else measured
    likely = (_closed(measured, 1 + 0.12 * size) & (body | ~outline)) | body | wheels
    possible = within(likely | outline, 1.5 + 0.03 * size + 0.5 * gap)
    sure |= wheels
    behind, before = _split(at, depth, mine)
    standing = ~(height <= ABOVE_GROUND_M)
    hidden = _closed_lines(_dotted(at[before & ~mine & standing], outline.shape)) & ~sure
    # Points behind are seen through panes, too: they count where none of the object's own is near, and on the ground.
    other = _dotted(at[~mine & behind & ~(height > 0.3 * FOOT_M)], outline.shape) & ~measured
    other |= _dotted(at[~mine & behind], outline.shape) & ~likely
    deep = cv2.erode(body.astype(np.uint8), disc(1 + DEEP * size), borderValue=1).astype(bool)
    sure |= deep & ~grow(other, 1 + 0.5 * gap)
    if loose:
        sure = cv2.erode(body.astype(np.uint8), disc(1 + loose * size), borderValue=1).astype(bool) & ~hidden
        possible = within(outline, loose * size)
        other &= ~possible
    return Seeds(window, sure & ~hidden, likely, possible, hidden, other & ~sure, size)


def _hull(camera: Camera, places: Float64, limit: float) -> NDArray[np.float32] | None:
    pixel, depth = camera.project(places)
    pixel = pixel[depth > NEAR_M]
    if len(pixel) < 3:
        return None
    return cv2.convexHull(np.clip(pixel, -limit, limit).astype(np.float32)).reshape(-1, 2)


def _legs(camera: Camera, places: Float64, over: Float64, *, seen_own: Mask, corner: tuple[int, int], shape: tuple[int, int]) -> Mask:
    low = seen_own & (over < WHEEL_M)
    mask = np.zeros(shape, np.uint8)
    if low.any():
        down = np.stack([np.zeros(low.sum()), np.zeros(low.sum()), over[low]], axis=1)
        a, _ = camera.project(places[low]); b, _ = camera.project(places[low] - down)
        for (xa, ya), (xb, yb) in zip((a - corner - 0.5).round().astype(int), (b - corner - 0.5).round().astype(int)):
            cv2.line(mask, (int(xa), int(ya)), (int(xb), int(yb)), 1, 1)
    return mask.astype(bool)


def _split(at: Float64, depth: Float64, mine: Mask) -> tuple[Mask, Mask]:
    """(K,) points of a window that lie behind the object's own beside them, and those before them."""
    nearest = cKDTree(at[mine]).query(at, k=min(4, int(mine.sum())))[1].reshape(len(at), -1)
    own = np.median(depth[mine][nearest], axis=1)
    before: Mask = depth < own - BEFORE_M
    return ~before & ~mine, before


def _filled(hull: NDArray[np.float32], shape: tuple[int, int]) -> Mask:
    mask = np.zeros(shape, np.uint8)
    # Pixel centres lie at + 0.5, fillConvexPoly counts from them.
    cv2.fillConvexPoly(mask, np.round((hull - 0.5) * 16).astype(np.int32), 1, shift=4)
    return mask.astype(bool)


def _dotted(at: Float64, shape: tuple[int, ...]) -> Mask:
    mask = np.zeros(shape, dtype=bool)
    if len(at):
        mask[at[:, 1].astype(int), at[:, 0].astype(int)] = True
    return mask


def _closed(mask: Mask, radius: float) -> Mask:
    r = max(int(radius), 1)
    padded = cv2.copyMakeBorder(mask.astype(np.uint8), r, r, r, r, cv2.BORDER_CONSTANT, value=0)
    return cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc(r))[r:-r, r:-r].astype(bool)


def _closed_lines(mask: Mask) -> Mask:
    """Points on a pole lie in rows: what is between them belongs to it."""
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((9, 3), np.uint8)).astype(bool)


def object_outline(image: NDArray[np.uint8], seeds: Seeds | None, prompt: Prompt | None = None) -> Mask:
    """(H, W) pixels of an object in a photograph (H, W, 3)."""
    shape = image.shape[:2]
    found = np.zeros(shape, dtype=bool)
    if prompt is not None and prompt.matte is not None:
        return prompt.matte.copy()
    radius = CLICK_PX * shape[1]
    own = np.zeros(shape, dtype=bool) if prompt is None else prompt.own(shape, radius)
    others = np.zeros(shape, dtype=bool) if prompt is None else prompt.others(shape, radius)
    if seeds is None:
        return found if not own.any() else _by_colour_alone(image, own, others)
    window = seeds.window
    found[window] = _within_window(image[window], seeds, own[window], others[window])
    return found


def _within_window(image: NDArray[np.uint8], it: Seeds, own: Mask, others: Mask) -> Mask:
    if it.size < TINY_PX:
        return (it.likely & ~it.hidden | own) & ~others
    sure = (it.sure | own) & ~others
    state = np.full(image.shape[:2], cv2.GC_BGD, np.uint8)
    state[it.possible] = cv2.GC_PR_BGD
    state[it.likely] = cv2.GC_PR_FGD
    state[it.other | it.hidden] = cv2.GC_BGD
    state[sure] = cv2.GC_FGD
    state[others] = cv2.GC_BGD
    open_ = (it.possible | own) & ~others & ~it.hidden
    mask = cut(image, state) & open_ | sure
    expected = it.likely & open_
    if mask.sum() < LEAST_SHARE * expected.sum():
        mask = expected | sure
    mask = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, disc(1)).astype(bool) & ~others & ~it.hidden
    return _joined(mask | sure, sure)


def _joined(own: Mask, sure: Mask) -> Mask:
    """Without crumbs that hold nothing sure, and without small holes."""
    count, label = cv2.connectedComponents(own.astype(np.uint8), connectivity=4)
    keep = np.zeros(count, dtype=bool)
    keep[np.unique(label[sure])] = True
    keep[0] = False
    own = keep[label]
    count, label, stats, _ = cv2.connectedComponentsWithStats((~own).astype(np.uint8), connectivity=4)
    hole = stats[:, cv2.CC_STAT_AREA] < 0.02 * own.sum()
    hole[0] = False
    return own | hole[label]


def _by_colour_alone(image: NDArray[np.uint8], own: Mask, others: Mask) -> Mask:
    """An object that no point lies on: what looks like the clicked pixels and hangs together with them."""
    height, width = own.shape
    rows, columns = np.nonzero(own)
    reach = max(0.12 * width, 1.0 * np.ptp(columns), 1.0 * np.ptp(rows))
    y0, y1 = int(max(rows.min() - 2 * reach, 0)), int(min(rows.max() + 2 * reach + 1, height))
    x0, x1 = int(max(columns.min() - 2 * reach, 0)), int(min(columns.max() + 2 * reach + 1, width))
    window = (slice(y0, y1), slice(x0, x1))
    near = within(own, reach)[window]
    state = np.where(near, cv2.GC_PR_BGD, cv2.GC_BGD).astype(np.uint8)
    state[within(own, 0.4 * reach)[window]] = cv2.GC_PR_FGD
    state[others[window]] = cv2.GC_BGD
    state[own[window]] = cv2.GC_FGD
    found = np.zeros(own.shape, dtype=bool)
    if (state == cv2.GC_BGD).any():
        found[window] = _joined(cut(image[window], state) & ~others[window] | own[window], own[window])
    return found
