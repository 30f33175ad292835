"""Tracked boxes: which objects moved, and which pixels belong to them."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Mask
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.cityscapes import CITYSCAPES
from unveil_core.drives.drive import Drive, Frame, PointCloud
from unveil_core.drives.importing.sweeps import in_boxes
from unveil_core.drives.moved import moved_ids
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.grid import PointGrid
from unveil_core.semantics.classes import REMOVABLE

__all__ = ["box_pixels", "moving_boxes", "points_in_boxes"]

CELL_M, AROUND_M = 5.0, 1.0
"""Side of the cells in which points are looked for in boxes, about a car's length, and how far around these, metres: more than the
margin of :func:`in_boxes`."""


def moving_boxes(drive: Drive) -> tuple[dict[int, str], frozenset[int]]:
    """Class name of each id whose box moved, and the ids of the removable ones that are static.

    Raises:
        DriveError: a class that Cityscapes does not know.
    """
    names: dict[int, str] = {}
    for frame in drive.frames:
        for box in frame.boxes:
            if box.class_name not in CITYSCAPES:
                raise DriveError(
                    f"box {box.id} of frame {frame.name} has the unknown class {box.class_name!r}",
                    path=drive.root,
                    mend="use Cityscapes names, as car or person",
                )
            if box.class_name in REMOVABLE:
                names[box.id] = box.class_name
    moved = moved_ids(drive)
    return {number: names[number] for number in names if number in moved}, frozenset(names) - moved


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


def points_in_boxes(points: PointCloud, drive: Drive, moved: Sequence[int]) -> Mask:
    """(P,) points that lie in a moved box, but not on the ground under it: when they were measured, where sweeps tell it, else at
    the time of any frame."""
    if points.moving is not None:
        return points.moving
    inside = np.zeros(len(points.positions), dtype=bool)
    if not moved:
        return inside
    grid = PointGrid(points.positions, CELL_M)
    for frame in drive.frames:
        for box in (b for b in frame.boxes if b.id in moved):
            index = grid.near(np.asarray(box.centre), float(np.linalg.norm(box.size)) / 2 + AROUND_M)
            inside[index] |= in_boxes(points.positions[index], [box])
    return inside
