"""What can be removed but has no box: annotations end somewhere, queues of cars go on to the horizon."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask
from unveil_core.drives.cityscapes import VOID, train_id
from unveil_core.drives.depth_range import NEAR_M
from unveil_core.drives.drive import Frame
from unveil_core.geometry.images import disc, within
from unveil_core.labelling.object_points import LABELLED_MARGIN_M, Stray, in_boxes
from unveil_core.labelling.silhouettes import Silhouette
from unveil_core.semantics.classes import SLIM_CLASSES

__all__ = ["far_queues", "strays_in_view"]

SAME_TIME_S = 0.15
"""Points of what may move are shown in frames no farther from their sweep than this, seconds."""
HALF_M = 0.25
"""Half of what a stray point stands for, metres, and at least a pixel."""
BEHIND_M = 2.0
"""Points farther than this behind what stands beside them, metres, are hidden."""
FAR_M, FEWEST, GAP_SHARE = 45.0, 3, 0.03
"""Objects farther than this, metres, if there are so many in view, are a queue: what lies between them, over gaps of this share of
the picture's width, goes with them."""


def strays_in_view(strays: Sequence[Stray], frame: Frame, before: Float32) -> NDArray[np.uint8]:
    """(H, W) trainId of points of removable classes outside of all boxes, 255 where there are none.

    Args:
        strays: of each sweep; before: (H, W) depth of upright things that stay, metres.
    """
    camera = frame.camera
    label = np.full((camera.height, camera.width), VOID, np.uint8)
    if frame.timestamp is None:
        return label
    now = [s for s in strays if s.time is not None and abs(s.time - frame.timestamp) <= SAME_TIME_S]
    if not now:
        return label
    nearest = min(now, key=lambda s: abs((s.time or 0.0) - (frame.timestamp or 0.0)))
    # Points of objects that the frame has boxes of are shown by their outlines.
    free = in_boxes(nearest.positions, frame.boxes, LABELLED_MARGIN_M) < 0
    classes = nearest.classes[free]
    pixels, depth = camera.project(nearest.positions[free])
    shown = np.flatnonzero(camera.in_picture(pixels, depth, nearest=NEAR_M))
    column, row = pixels[shown].astype(np.int64).T
    shown = shown[depth[shown] < cv2.erode(before, disc(2))[row, column] + BEHIND_M]
    for i in shown[np.argsort(-depth[shown], kind="stable")]:
        radius = max(1, round(HALF_M * camera.fx / depth[i]))
        place = (int(pixels[i, 0]), int(pixels[i, 1]))
        cv2.circle(label, place, radius, int(classes[i]), cv2.FILLED)
    return label


def far_queues(found: Sequence[Silhouette], owner: NDArray[np.uint16], street: Mask) -> NDArray[np.uint8]:
    """(H, W) trainId of car between far vehicles of a queue, 255 elsewhere.

    Args:
        found: the objects in view; owner: (H, W) their ids.
        street: (H, W) where points show that the street is open.
    """
    far = [s.box.id for s in found if s.depth > FAR_M and s.box.class_name not in SLIM_CLASSES]
    label = np.full(owner.shape, VOID, np.uint8)
    seen = np.isin(owner, far)
    if len(far) < FEWEST or not seen.any():
        return label
    # Sideways only: above a queue stand trees and houses.
    gap = 2 * int(GAP_SHARE * owner.shape[1] / 2) + 1
    padded = cv2.copyMakeBorder(seen.astype(np.uint8), 0, 0, gap, gap, cv2.BORDER_CONSTANT, value=0)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, np.ones((1, gap), np.uint8))[:, gap:-gap].astype(bool)
    label[closed & (owner == 0) & ~within(street, 2.0)] = train_id("car")
    return label
