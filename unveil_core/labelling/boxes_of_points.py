"""Boxes of objects where a dataset labels its points but has none, as SemanticKITTI: around what hangs together of one class."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.cityscapes import train_id
from unveil_core.drives.depth_range import ASKED_M
from unveil_core.drives.drive import Drive, Frame
from unveil_core.semantics.classes import REMOVABLE
from unveil_core.semantics.instances import cluster_points, fit_box
from unveil_core.semantics.members import Members

__all__ = ["points_have_classes", "with_boxes_of_points"]

CLUSTER_M = 0.6
"""Points of one class nearer than this seen from above, metres, are of one object. Sides that face away from the LiDAR leave gaps
of that size; cars that are parked closer to each other become one object, which is removed as well as two."""
LEAST_POINTS = 20
"""Of an object, thinned to one a cell of 5 cm; fewer are crumbs at a wrong label's edge."""
LONGEST_M = 20.0
"""Of one object. What is longer is the way of one that moved, seen in one sweep after the other, and its box would be street."""
SMALLEST_M = 0.2
"""Side of a box at least: an object may be seen from one side only."""
MOST_OBJECTS = 65535
"""That 16 bits tell apart."""


def points_have_classes(drive: Drive) -> bool:
    """Whether a drive's points, or those of its first sweep, are labelled.

    Raises:
        DriveError: the sweep cannot be read.
    """
    return drive.points.classes is not None or any(s.read().classes is not None for s in drive.sweeps[:1])


def with_boxes_of_points(drive: Drive) -> Drive:
    """The drive with a box around each cluster of points of a removable class, in all sweeps and in the frames within
    ``ASKED_M`` of it: it stands still.

    Args:
        drive: localized, with points that have classes.
    """
    points = drive.points
    if points.classes is None:
        return drive
    boxes: list[TrackedBox] = []
    for class_name in REMOVABLE:
        positions = points.positions[points.classes == train_id(class_name)]
        if len(positions) < LEAST_POINTS:
            continue
        clusters = cluster_points(positions * (1, 1, 0), CLUSTER_M, minimum=LEAST_POINTS)
        members = Members(clusters)
        for k in range(1, int(clusters.max()) + 1):
            found = fit_box(positions[members[k]], np.eye(3))
            length, width, height = (max(side, SMALLEST_M) for side in found.size)
            if length <= LONGEST_M and len(boxes) < MOST_OBJECTS:
                box = TrackedBox(len(boxes) + 1, class_name, found.centre, (length, width, height), found.yaw)
                boxes.append(box)
    centres = np.array([b.centre for b in boxes]).reshape(-1, 3)

    def near(frame: Frame) -> tuple[TrackedBox, ...]:
        away = np.linalg.norm(centres - frame.camera.centre, axis=1)
        return tuple(boxes[k] for k in np.flatnonzero(away < ASKED_M))

    return replace(
        drive,
        frames=tuple(replace(f, boxes=near(f)) for f in drive.frames),
        sweeps=tuple(replace(s, boxes=tuple(boxes)) for s in drive.sweeps),
    )
