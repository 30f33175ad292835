"""Where objects lie in a photograph, by geometry alone: what is surely theirs, what may be, and what stands before them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64, Mask
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import Frame
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import disc, within
from unveil_core.labelling.object_points import ObjectPoints, from_own_axes
from unveil_core.semantics.classes import REMOVABLE, SLIM_CLASSES

__all__ = ["Silhouette", "box_hull", "silhouettes"]

NEAR_M = 0.3
"""Boxes are cut at this depth, metres."""
FEW_POINTS = 40
"""With fewer points in view than this the shape of the class stands in for the measured one."""
MANY_POINTS = 150
"""With so many in view, what is far from all of them is not the object."""
FOOT_SHARE, FOOT_POINTS = 0.35, 0.12
"""Of an object that is seen whole, at least this share of the points lies in this lowest share of its box."""
WANTED_POINTS = 3000
"""Points of an object that are looked at: those measured nearest in time."""
TINY_PX = 12
"""Boxes less high than this, pixels, are taken whole: no outline can be found in so few."""
EXTREMES = (0.3, 99.7)
"""Percentiles of an object's points that count as its ends: single points are wrong."""
SEEN_FACE = 0.25
"""A face of a box was seen if points lie no farther inside of it than this share of its size; then it is drawn in to them."""
CORES: dict[bool, tuple[tuple[tuple[float, float], tuple[float, float], tuple[float, float]], ...]] = {
    False: (((-0.90, 0.90), (-0.86, 0.86), (-0.55, 0.1)), ((-0.45, 0.45), (-0.72, 0.72), (0.0, 0.85))),
    True: (((-0.35, 0.35), (-0.35, 0.35), (-0.7, 0.75)),),
}
"""What of a box an object surely fills: ranges along, across and up in half sizes. Vehicles: body and cabin; slim objects."""


@dataclass(frozen=True, eq=False)
class Silhouette:
    """One object in one photograph. All masks are of its window of the picture.

    Attributes:
        box: as the frame has it.
        depth: of its nearest part, metres.
        window: rows and columns of the picture.
        sure: pixels that points or the shape of its class show to be its own.
        likely: what lies between them.
        possible: all that its box covers.
        tiny: too small for an outline.
    """

    box: TrackedBox
    depth: float
    window: tuple[slice, slice]
    sure: Mask
    likely: Mask
    possible: Mask
    tiny: bool


def _outline(corners: Float64, camera: Camera) -> NDArray[np.float32] | None:
    """(K, 2) convex hull of a projected cuboid of corners (8, 3), cut where it comes close to the camera's plane."""
    pixel, depth = camera.project(corners)
    if (depth <= NEAR_M).all():
        return None
    if (depth < NEAR_M).any():
        share = np.linspace(0, 1, 33)[:, None]
        pixel, depth = camera.project(
            np.concatenate([(1 - share) * a + share * b for i, a in enumerate(corners) for b in corners[i + 1 :]])
        )
        pixel = pixel[depth >= NEAR_M]
        if len(pixel) < 3:
            return None
    limit = 4.0 * max(camera.width, camera.height)
    return cv2.convexHull(np.clip(pixel, -limit, limit).astype(np.float32)).reshape(-1, 2)


def _filled(outline: NDArray[np.float32], window: tuple[slice, slice]) -> Mask:
    """The part of a window that a convex outline covers."""
    rows, columns = window
    mask = np.zeros((rows.stop - rows.start, columns.stop - columns.start), np.uint8)
    # Pixel centres lie at + 0.5, fillConvexPoly counts from them.
    corners = np.round((outline - (columns.start + 0.5, rows.start + 0.5)) * 16).astype(np.int32)
    cv2.fillConvexPoly(mask, corners, 1, shift=4)
    return mask.astype(bool)


def box_hull(box: TrackedBox, camera: Camera) -> Mask | None:
    """(H, W) pixels that a box covers; None where it is not in the picture."""
    outline = _outline(box.corners(), camera)
    if outline is None:
        return None
    mask = _filled(outline, (slice(0, camera.height), slice(0, camera.width)))
    return mask if mask.any() else None


def _part(box: TrackedBox, ranges: Sequence[tuple[float, float]]) -> Float64:
    """(8, 3) corners of the part of a box between shares of its half sizes."""
    low, high = np.array(ranges).T * np.asarray(box.size)[None].T.ravel() / 2
    corners = np.array(
        [[(low, high)[i][0], (low, high)[j][1], (low, high)[k][2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    )
    return from_own_axes(box, corners)


def drawn_in(box: TrackedBox, local: Float64) -> TrackedBox:
    """The box with the faces that its points (P, 3), in its own axes, show to be loose drawn in to them."""
    if len(local) < MANY_POINTS:
        return box
    return _of_faces(box, *_drawn_faces(box, local))


def _drawn_faces(box: TrackedBox, local: Float64) -> tuple[Float64, Float64]:
    """(3,) the lower and the upper face of :func:`drawn_in`, metres in the box's own axes."""
    half = np.asarray(box.size) / 2
    low, high = np.percentile(local, EXTREMES, axis=0)
    low = np.where(low + half < SEEN_FACE * 2 * half, np.maximum(low - 0.03, -half), -half)
    return low, np.where(half - high < SEEN_FACE * 2 * half, np.minimum(high + 0.03, half), half)


def _of_faces(box: TrackedBox, low: Float64, high: Float64) -> TrackedBox:
    """A box between faces (3,) in the own axes of another."""
    x, y, z = (float(v) for v in from_own_axes(box, ((low + high) / 2)[None])[0])
    length, width, height = (float(v) for v in high - low)
    return replace(box, centre=(x, y, z), size=(length, width, height))


def _sticking_out(box: TrackedBox, local: Float64) -> tuple[Float64, Float64]:
    """(3,) how far points (P, 3) stick out of the lower and the upper face of their box, level, metres."""
    low, high = np.percentile(local, EXTREMES, axis=0)
    half, level = np.asarray(box.size) / 2, np.array([1, 1, 0])
    return np.maximum(-half - low, 0) * level, np.maximum(high - half, 0) * level


def _wide(box: TrackedBox, local: Float64) -> TrackedBox:
    """The box that surely holds an object of points (P, 3).

    Where they stick out the box is too short, or displaced against them: annotations between key frames are interpolated. Then
    the object ends as much farther behind the points as they stick out before it.
    """
    if len(local) < MANY_POINTS:
        return box
    half = np.asarray(box.size) / 2
    (low, high), (before, beyond) = _drawn_faces(box, local), _sticking_out(box, local)
    low = np.where(before > 0, -half - before, np.maximum(low - beyond, -half))
    high = np.where(beyond > 0, half + beyond, np.minimum(high + before, half))
    return _of_faces(box, low, high)


def silhouettes(frame: Frame, objects: Mapping[int, ObjectPoints]) -> list[Silhouette]:
    """The removable objects of a frame that lie in its picture, near ones first."""
    found = []
    for box in frame.boxes:
        if box.class_name in REMOVABLE:
            points = objects.get(box.id)
            local = points.near(frame.timestamp, WANTED_POINTS) if points is not None else np.zeros((0, 3))
            silhouette = _silhouette(box, local, frame.camera)
            if silhouette is not None:
                found.append(silhouette)
    return sorted(found, key=lambda s: (s.depth, s.box.id))


def _silhouette(box: TrackedBox, local: Float64, camera: Camera) -> Silhouette | None:
    tight, wide = drawn_in(box, local), _wide(box, local)
    outline = _outline(wide.corners(), camera)
    if outline is None:
        return None
    inside = np.clip(outline, 0, (camera.width, camera.height))
    size = float(np.sqrt(max(np.prod(np.ptp(outline, axis=0)), 1.0)))
    shown = np.ptp(inside, axis=0)
    if shown.min() < 1:
        return None
    pad = 4 + 0.25 * min(size, float(max(camera.width, camera.height)))
    x0, y0 = np.maximum(np.floor(inside.min(axis=0) - pad), 0).astype(int)
    x1, y1 = np.minimum(np.ceil(inside.max(axis=0) + pad), (camera.width, camera.height)).astype(int)
    window = (slice(int(y0), int(y1)), slice(int(x0), int(x1)))
    hull = _filled(outline, window)
    if not hull.any():
        return None
    size = min(size, float(np.sqrt(np.prod(shown))) * 2)
    places = from_own_axes(box, local)
    pixel, depth = camera.project(places)
    ok = camera.in_picture(pixel, depth, nearest=NEAR_M)
    pixel, depth = pixel[ok] - (x0, y0), depth[ok]
    nearest = float(np.percentile(depth, 2)) if len(depth) > FEW_POINTS else _nearest(tight, camera)
    measured = _measured(pixel, hull, size)
    core = np.zeros_like(hull)
    for ranges in CORES[box.class_name in SLIM_CLASSES]:
        part = _outline(_part(tight, ranges), camera)
        if part is not None:
            core |= _filled(part, window)
    grown = cv2.dilate(hull.astype(np.uint8), disc(1 + 0.02 * size)).astype(bool) | measured
    tall = float(np.ptp(outline[:, 1]))
    if len(pixel) < FEW_POINTS:
        return Silhouette(box, nearest, window, core | measured, core | measured | hull, grown, tall < TINY_PX)
    sure = cv2.erode(measured.astype(np.uint8), disc(1)).astype(bool) if size > 30 else measured
    likely = cv2.morphologyEx(measured.astype(np.uint8), cv2.MORPH_CLOSE, disc(0.12 * size + 1)).astype(bool) & grown
    if len(pixel) >= MANY_POINTS:
        feet = _feet(places[ok], local[ok], box, tight)
        # Vehicles and people are nearly convex: what lies beyond the convex hull of their points is not theirs.
        more, ahead = camera.project(np.concatenate([feet, *_displaced(box, local, ok)]))
        spread = np.concatenate([pixel, more[ahead > NEAR_M] - (x0, y0)])
        convex = _filled(cv2.convexHull(spread.astype(np.float32)).reshape(-1, 2) + (x0, y0), window) | likely
        grown &= within(convex, 1.5 + 0.01 * size + _apart(hull, len(pixel)))
        core &= convex if len(feet) else likely
    return Silhouette(box, nearest, window, sure | core, likely | core, grown | core, tall < TINY_PX)


def _feet(places: Float64, local: Float64, box: TrackedBox, tight: TrackedBox) -> Float64:
    """(F, 3) places on the ground below an object's points, if something hid its lower part from the LiDAR, else none.

    The camera looks from elsewhere and may see it.
    """
    if (local[:, 2] < (FOOT_SHARE - 0.5) * box.size[2]).mean() >= FOOT_POINTS:
        return np.zeros((0, 3))
    feet = places.copy()
    feet[:, 2] = tight.centre[2] - tight.size[2] / 2
    return feet


def _displaced(box: TrackedBox, local: Float64, seen: Mask) -> list[Float64]:
    """Where those of an object's points (P, 3) that are ``seen`` (P,) would be if its box was displaced by as much as they stick
    out of it: (D, 3) for each way that they do."""
    before, beyond = _sticking_out(box, local)
    return [from_own_axes(box, local[seen] + shift) for shift in (before, -beyond) if shift.any()]


def _nearest(box: TrackedBox, camera: Camera) -> float:
    depth = camera.project(box.corners())[1]
    return max(float(np.sort(depth)[:2].mean()), NEAR_M)


def _measured(pixel: Float64, hull: Mask, size: float) -> Mask:
    """Pixels between points (P, 2) of a window, closed over gaps as wide as the points usually lie apart."""
    mask = np.zeros(hull.shape, np.uint8)
    if len(pixel):
        mask[pixel[:, 1].astype(int), pixel[:, 0].astype(int)] = 1
        radius = int(np.clip(1.2 * _apart(hull, len(pixel)), 1, 1 + 0.06 * size))
        padded = cv2.copyMakeBorder(mask, radius, radius, radius, radius, cv2.BORDER_CONSTANT, value=0)
        mask = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, disc(radius))[radius:-radius, radius:-radius]
    return mask.astype(bool)


def _apart(hull: Mask, count: int) -> float:
    """How far apart so many points on an object usually lie, pixels."""
    return float(np.sqrt(max(int(hull.sum()), 1) / max(count, 1)))
