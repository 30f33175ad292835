"""One point cloud from the sweeps of a drive, read one after the other: bounded memory, however many there are."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Checkpoint
from unveil_core.base.types import Float64, Mask
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.cityscapes import VOID
from unveil_core.drives.depth_range import FAR_M
from unveil_core.drives.drive import Drive, PointCloud, Sweep, SweepPoints
from unveil_core.drives.moved import moved_ids
from unveil_core.geometry.similarity import Similarity

__all__ = ["gathered", "in_boxes", "local_sweep"]

CELL_M = 0.05
"""Points of all sweeps closer than this, metres, are one: the finest spacing that surfels start with."""
MOST_POINTS = 3_000_000
"""Points of a drive that are kept at most, however long it is: beyond, cells grow. Three million take 0.1 GB, and are held whole
while blocks are made. A block of 100 m starts from some ten thousands of its points: of 1 km each has 300,000, of 5 km 60,000."""
CELL_GROWTH = 1.5
MARGIN_M = 0.15
"""Points so close to a box, metres, belong to its object."""


def local_sweep(sweep: Sweep, to_world: Similarity) -> Sweep:
    """A sweep in local coordinates, as :meth:`Similarity.to_local` has them."""

    def read() -> SweepPoints:
        found = sweep.read()
        return replace(found, positions=to_world.to_local(found.positions))

    return replace(sweep, read=read, boxes=tuple(b.to_local(to_world) for b in sweep.boxes))


def in_boxes(points: Float64, boxes: Collection[TrackedBox], margin: float = MARGIN_M) -> Mask:
    """(P,) points that lie in one of the boxes or within ``margin`` metres, but not on the ground under it."""
    inside = np.zeros(len(points), dtype=bool)
    for box in boxes:
        corners = box.corners()
        near = np.flatnonzero(((points > corners.min(axis=0) - 1) & (points < corners.max(axis=0) + 1)).all(axis=1))
        half = np.asarray(box.size) / 2
        local = box.local(points[near]) * half
        hit = (np.abs(local) <= half + margin).all(axis=1) & (local[:, 2] > -half[2] + margin)
        inside[near[hit]] = True
    return inside


def gathered(drive: Drive, progress: Progress = no_progress, checkpoint: Checkpoint | None = None) -> PointCloud:
    """The points of all sweeps of a localized drive, thinned to one a cell; of those in a cell that of the earliest sweep, and its
    class, stay.

    Points in the box of a moving object at the time of their sweep are marked as ``moving``. Points farther from all cameras
    than anything is drawn are left out.

    Args:
        drive: in metres; with frames.
        checkpoint: from which an interrupted call is continued.
    Raises:
        DriveError: a sweep that cannot be read, or no points at all.
    """
    moved = moved_ids(drive)
    cameras = np.stack([f.camera.centre for f in drive.frames])
    low, high = cameras.min(axis=0) - FAR_M, cameras.max(axis=0) + FAR_M
    cloud, cell, begun = _Cells(), CELL_M, 0
    checkpoint = checkpoint or Checkpoint()
    if (state := checkpoint.load()) is not None:
        cloud, cell, begun = _Cells(**state[0]), state[1]["cell"], state[1]["done"]
    for done, sweep in enumerate(drive.sweeps[begun:], start=begun):
        found = sweep.read()
        keep = ((found.positions > low) & (found.positions < high)).all(axis=1)
        positions = found.positions[keep]
        classes = np.full(len(positions), VOID, np.uint8) if found.classes is None else found.classes[keep]
        moving = in_boxes(positions, [b for b in sweep.boxes if b.id in moved])
        cloud = cloud.with_points(positions, classes, moving, cell)
        while len(cloud.keys) > MOST_POINTS:
            cell *= CELL_GROWTH
            cloud = _Cells().with_points(cloud.positions, cloud.classes, cloud.moving, cell)
        if checkpoint.due():
            checkpoint.save(vars(cloud), {"cell": cell, "done": done + 1})
        progress(done + 1, len(drive.sweeps), "reading sweeps")
    if not len(cloud.keys):
        raise DriveError("its sweeps hold no points near the cameras", path=drive.root, mend="a drive needs points")
    known = (cloud.classes != VOID).any()
    return PointCloud(
        cloud.positions, None, True, cloud.classes if known else None, cloud.moving if cloud.moving.any() else None
    )


class _Cells:
    """Points by cell: ``keys`` (P,) ascending, with their positions, classes and whether they move."""

    def __init__(
        self,
        keys: NDArray[np.int64] | None = None,
        positions: Float64 | None = None,
        classes: NDArray[np.uint8] | None = None,
        moving: Mask | None = None,
    ) -> None:
        self.keys = np.zeros(0, np.int64) if keys is None else keys
        self.positions = np.zeros((0, 3)) if positions is None else positions
        self.classes = np.zeros(0, np.uint8) if classes is None else classes
        self.moving = np.zeros(0, bool) if moving is None else moving

    def with_points(self, positions: Float64, classes: NDArray[np.uint8], moving: Mask, cell: float) -> _Cells:
        """These cells and those that the points add; a moving point takes no cell from a static one, nor the other way."""
        index = np.floor(positions / cell).astype(np.int64)
        half = 1 << 19
        packed = ((index[:, 0] + half) << 41) | ((index[:, 1] + half) << 21) | ((index[:, 2] + half) << 1) | moving
        keys, first = np.unique(packed, return_index=True)
        if len(self.keys):
            at = np.searchsorted(self.keys, keys).clip(max=len(self.keys) - 1)
            new = self.keys[at] != keys
            keys, first = keys[new], first[new]
        place = np.searchsorted(self.keys, keys)
        return _Cells(
            np.insert(self.keys, place, keys),
            np.insert(self.positions, place, positions[first], axis=0),
            np.insert(self.classes, place, classes[first]),
            np.insert(self.moving, place, moving[first]),
        )
