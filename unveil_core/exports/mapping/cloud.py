"""The drive's points without those of what was removed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Mask
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import read_points
from unveil_core.exports.job import Job
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.semantics.classes import VOID
from unveil_core.semantics.instances import Box
from unveil_core.semantics.labels import SceneLabels
from unveil_core.semantics.objects import ABOVE_GROUND_M
from unveil_core.workspace.files import load_array, load_selection

__all__ = ["StreetPoints", "street_points"]

MARGIN_M = 0.1
"""By which the box of a removed object is larger than what was measured of it."""


@dataclass(frozen=True, eq=False)
class StreetPoints:
    """Points of a state.

    Attributes:
        cloud: (P) local positions, colours where the drive has them, classes as trainIds, 255 unknown.
        objects: (P,) object ids, 0 none.
    """

    cloud: PointCloud
    objects: NDArray[np.int64]


def street_points(job: Job) -> StreetPoints:
    """The points of the job's state. The empty street has none with a removed class or object, none above the floor in the box of
    a removed object, and none on dynamic objects.

    Raises:
        DriveError, WorkspaceError: damaged or missing files.
    """
    points = read_points(job.workspace.drive_dir / "points.ply")
    count = len(points.positions)
    labels = _numbers(job, "objects/point_labels.npy", count)
    objects = _numbers(job, "objects/point_objects.npy", count)
    classes = points.classes
    if labels is not None:
        classes = labels.astype(np.uint8)
    if classes is None:
        classes = np.full(count, VOID, dtype=np.uint8)
    objects = np.zeros(count, dtype=np.int64) if objects is None else objects.astype(np.int64)
    whole = PointCloud(points.positions, points.colors, points.measured, classes)
    if job.state == "full":
        return StreetPoints(whole, objects)
    moving = _numbers(job, "movers/points.npy", count)
    gone = np.zeros(count, dtype=bool) if moving is None else moving != 0
    if points.moving is not None:
        gone |= points.moving
    gone |= _chosen(load_selection(job.workspace), classes, objects) | _in_boxes(job, points.positions)
    return StreetPoints(whole.select(~gone), objects[~gone])


def _numbers(job: Job, name: str, count: int) -> NDArray[np.int64] | None:
    """(P,) numbers of the points that a stage wrote; None where it wrote none for these points."""
    path = job.workspace.root / name
    found = load_array(path) if path.is_file() else None
    return found if found is not None and found.shape == (count,) else None


def _chosen(scene: SceneLabels, classes: NDArray[np.uint8], objects: NDArray[np.int64]) -> Mask:
    """(P,) points of the classes and objects that are removed."""
    ids = [scene.labels.disk_ids[k] for k in scene.removed_labels]
    return np.isin(classes, ids) | np.isin(objects, scene.instances)


def _in_boxes(job: Job, positions: NDArray[np.float64]) -> Mask:
    """(P,) points in the boxes of removed objects, but for the ground under them."""
    inside = np.zeros(len(positions), dtype=bool)
    for entry in job.objects:
        given = entry["box"]
        if not entry.get("removed") or given is None:
            continue
        box = Box.from_json(given)
        inside |= box.contains(positions, up_frame(UP), margin=MARGIN_M, above=ABOVE_GROUND_M)
    return inside
