"""Tracked boxes: which objects moved, and which pixels belong to them."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Mask
from unveil_core.drives.boxes import TrackedBox, has_moved
from unveil_core.drives.drive import Drive, Frame
from unveil_core.geometry.camera import Camera
from unveil_core.semantics.classes import CITYSCAPES, REMOVABLE

__all__ = ["box_pixels", "moving_boxes", "points_in_boxes"]

MARGIN_M = 0.15
"""Points so close to a box, metres, belong to its object."""


def moving_boxes(drive: Drive) -> tuple[dict[int, str], frozenset[int]]:
    """Class name of each id whose box moved, and the ids of the removable ones that are static.

    Raises:
        DriveError: a class that Cityscapes does not know.
    """
    found: dict[int, list[TrackedBox]] = {}
    for frame in drive.frames:
        for box in frame.boxes:
            if box.class_name not in CITYSCAPES:
                raise DriveError(
                    f"box {box.id} of frame {frame.name} has the unknown class {box.class_name!r}",
                    path=drive.root,
                    mend="use Cityscapes names, as car or person",
                )
            if box.class_name in REMOVABLE:
                found.setdefault(box.id, []).append(box)
    moved = {number: boxes[-1].class_name for number, boxes in found.items() if has_moved(boxes)}
    return moved, frozenset(set(found) - set(moved))


def _hull(box: TrackedBox, camera: Camera) -> Mask | None:
    """(H, W) pixels that a box covers; None where it is not before the camera."""
    corners = box.corners()
    pixel, depth = camera.project(corners)
    if (depth <= 0).all():
        return None
    if (depth < 0.1).any():
        # A box that reaches beside the camera is cut where its corners come close: points along its edges stand for it.
        steps = np.linspace(0, 1, 24)[:, None]
        edges = [(1 - steps) * a + steps * b for i, a in enumerate(corners) for b in corners[i + 1 :]]
        pixel, depth = camera.project(np.concatenate(edges))
        pixel = pixel[depth > 0.1]
        if len(pixel) < 3:
            return None
    limit = 4.0 * max(camera.width, camera.height)
    hull = cv2.convexHull(np.clip(pixel, -limit, limit).astype(np.float32)).round().astype(np.int32)
    mask = np.zeros((camera.height, camera.width), np.uint8)
    cv2.fillConvexPoly(mask, hull, 1)
    return mask.astype(bool) if mask.any() else None


def box_pixels(
    frame: Frame, label: NDArray[np.int8], labels_of: Sequence[int], instances: NDArray[np.int64] | None
) -> NDArray[np.int64]:
    """(H, W) id of the box that each pixel belongs to, 0 = none.

    Pixels of removable labels belong to the nearest box that covers them; an object of the instance image belongs, whole, to the
    box that covers most of it. Where the frame has no labels, a box gets all pixels that it covers.

    Args:
        label: (H, W), negative = unknown; labels_of: the removable labels; instances: (H, W) or None.
    """
    owner = np.zeros(label.shape, dtype=np.int64)
    possible = np.isin(label, labels_of) | (label < 0 if (label < 0).all() else False)
    known = [b for b in frame.boxes if b.class_name in REMOVABLE]
    known.sort(key=lambda b: -float(np.linalg.norm(np.asarray(b.centre) - frame.camera.centre)))
    for box in known:
        covered = _hull(box, frame.camera)
        if covered is not None:
            owner[covered & possible] = box.id
    if instances is not None:
        by_box = owner.copy()
        owner[instances > 0] = 0
        for number in np.unique(instances[(instances > 0) & (by_box > 0)]):
            shown = instances == number
            ids, counts = np.unique(by_box[shown], return_counts=True)
            best = int(ids[counts.argmax()])
            if best and counts.max() > 0.5 * shown.sum():
                owner[shown] = best
    return owner


def points_in_boxes(points: NDArray[np.float64], drive: Drive, moved: Sequence[int]) -> Mask:
    """(P,) points that lie in a moved box at any time, but not on the ground under it."""
    inside = np.zeros(len(points), dtype=bool)
    for frame in drive.frames:
        for box in frame.boxes:
            if box.id not in moved:
                continue
            low, high = box.corners().min(axis=0) - 1.0, box.corners().max(axis=0) + 1.0
            near = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
            local = box.local(points[near]) * (np.asarray(box.size) / 2)
            half = np.asarray(box.size) / 2
            hit = (np.abs(local) <= half + MARGIN_M).all(axis=1) & (local[:, 2] > -half[2] + MARGIN_M)
            inside[near[hit]] = True
    return inside
