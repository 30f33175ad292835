"""What the LiDAR measured of each tracked object: its points in the axes of its box, from all sweeps.

A box alone is no outline, and loose: in PandaSet by 4 to 11 cm a side in the median. The points of an object, carried along
with its box, show its outline also in frames that have no sweep of their own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox, has_moved
from unveil_core.drives.cityscapes import VOID, train_id
from unveil_core.drives.drive import Drive, Sweep, SweepPoints
from unveil_core.geometry.cloud import thin_points
from unveil_core.semantics.classes import REMOVABLE

__all__ = ["REMOVABLE_IDS", "ObjectPoints", "Stray", "from_own_axes", "gather_objects", "in_boxes", "own_axes"]

REMOVABLE_IDS = tuple(train_id(name) for name in REMOVABLE)
"""TrainIds of what can be removed."""
MARGIN_M = 0.1
"""Points so close to a box, metres, belong to its object: mirrors and bumpers stick out a little."""
FLOOR_M = 0.12
"""Points without a class that lie lower than this over the ground or the floor of a box, metres, are the ground under it."""
CELL_M = 0.04
"""Points of one object are thinned to one a cell of this size, metres: finer than a pixel of a wide picture 20 m away."""
MOST_POINTS = 12_000
"""Points kept of one object and sweep."""
LABELLED_MARGIN_M = 0.5
"""Points that the dataset labels as removable belong to a box so close to them, metres: it is nearly always a loose one."""


@dataclass(frozen=True, eq=False)
class ObjectPoints:
    """The points of one object.

    Attributes:
        times: (S,) seconds of the sweeps that hit it, ascending; NaN where sweeps have no time.
        parts: S arrays (P, 3), metres from the centre of its box, along its length, width and up.
    """

    times: Float64
    parts: tuple[Float64, ...]

    def near(self, time: float | None, most: int) -> Float64:
        """(P, 3) of the sweeps nearest to a time, so many of them that there are ``most`` points if there are enough."""
        if not self.parts:
            return np.zeros((0, 3))
        away = np.abs(self.times - (np.nan if time is None else time))
        chosen: list[Float64] = []
        for i in np.argsort(np.nan_to_num(away), kind="stable"):
            chosen.append(self.parts[i])
            if sum(map(len, chosen)) >= most:
                break
        return np.concatenate(chosen)


@dataclass(frozen=True, eq=False)
class Stray:
    """Points of removable classes that no box holds, measured at one time.

    Attributes:
        time: seconds, or None.
        positions: (P, 3) in the drive's coordinates; classes: (P,) uint8 trainIds.
    """

    time: float | None
    positions: Float64
    classes: NDArray[np.uint8]


def own_axes(box: TrackedBox, positions: Float64) -> Float64:
    """(P, 3) metres from the centre of a box, along its length, width and up."""
    return box.local(positions) * (np.asarray(box.size) / 2)


def from_own_axes(box: TrackedBox, local: Float64) -> Float64:
    """Inverse of :func:`own_axes`."""
    cos, sin = np.cos(box.yaw), np.sin(box.yaw)
    x, y, z = local.T
    return np.stack([x * cos - y * sin, x * sin + y * cos, z], axis=1) + np.asarray(box.centre)


def in_boxes(positions: Float64, boxes: tuple[TrackedBox, ...], margin: float) -> NDArray[np.int64]:
    """(P,) index of the box that each point lies in, of several that whose centre is nearest; -1 = none."""
    owner = np.full(len(positions), -1, dtype=np.int64)
    if not boxes or not len(positions):
        return owner
    tree = cKDTree(positions[:, :2])
    nearest = np.full(len(positions), np.inf)
    for k, box in enumerate(boxes):
        reach = float(np.hypot(box.size[0], box.size[1])) / 2 + 2 * margin
        near = np.asarray(tree.query_ball_point(box.centre[:2], reach), dtype=np.int64)
        if not len(near):
            continue
        local = own_axes(box, positions[near])
        inside = (np.abs(local) <= np.asarray(box.size) / 2 + margin).all(axis=1)
        away = np.abs(local[:, :2] / np.asarray(box.size[:2])).max(axis=1)
        better = inside & (away < nearest[near])
        owner[near[better]], nearest[near[better]] = k, away[better]
    return owner


def gather_objects(
    drive: Drive, over_ground: Callable[[Float64], Float64] | None, progress: Progress = no_progress
) -> tuple[dict[int, ObjectPoints], list[Stray]]:
    """Read every sweep once and share its points out to the boxes at its time.

    Args:
        drive: localized.
        over_ground: gives the height (P,) of points over the ground, NaN unknown; None where the ground is not known.
    Returns:
        the points of each object by id, and points of removable classes outside of all boxes, by sweep.
    Raises:
        DriveError: a sweep that cannot be read.
    """
    times: dict[int, list[float]] = {}
    parts: dict[int, list[Float64]] = {}
    strays: list[Stray] = []
    sweeps = drive.sweeps or (_all_at_once(drive),)
    for done, sweep in enumerate(sweeps):
        boxes = tuple(b for b in sweep.boxes if b.class_name in REMOVABLE)
        points = sweep.read()
        classes = np.full(len(points.positions), VOID, np.uint8) if points.classes is None else points.classes
        owner = _owners(points.positions, classes, boxes, over_ground)
        for k in np.unique(owner[owner >= 0]):
            local = own_axes(boxes[k], points.positions[owner == k])
            local = local[thin_points(local, CELL_M)]
            local = local[:: -(-len(local) // MOST_POINTS)]
            times.setdefault(boxes[k].id, []).append(np.nan if sweep.timestamp is None else sweep.timestamp)
            parts.setdefault(boxes[k].id, []).append(local)
        stray = np.isin(classes, REMOVABLE_IDS) & (owner < 0)
        strays.append(Stray(sweep.timestamp, points.positions[stray], classes[stray]))
        progress(done + 1, len(sweeps), "sorting points into boxes")
    return {i: ObjectPoints(np.asarray(times[i]), tuple(parts[i])) for i in parts}, strays


def _all_at_once(drive: Drive) -> Sweep:
    """The points of a drive without sweeps, as one: they show the objects that never moved."""
    found: dict[int, list[TrackedBox]] = {}
    for frame in drive.frames:
        for box in frame.boxes:
            found.setdefault(box.id, []).append(box)
    static = tuple(boxes[len(boxes) // 2] for boxes in found.values() if not has_moved(boxes))
    points = drive.points if drive.points.moving is None else drive.points.select(~drive.points.moving)
    return Sweep(drive.root, lambda: SweepPoints(points.positions, points.classes), None, static)


def _owners(
    positions: Float64,
    classes: NDArray[np.uint8],
    boxes: tuple[TrackedBox, ...],
    over_ground: Callable[[Float64], Float64] | None,
) -> NDArray[np.int64]:
    """(P,) index of the box whose object each point is of, -1 = none."""
    owner = np.full(len(positions), -1, dtype=np.int64)
    removable = np.flatnonzero(np.isin(classes, REMOVABLE_IDS))
    owner[removable] = in_boxes(positions[removable], boxes, LABELLED_MARGIN_M)
    unknown = np.flatnonzero(classes == VOID)
    held = in_boxes(positions[unknown], boxes, MARGIN_M)
    unknown, held = unknown[held >= 0], held[held >= 0]
    if not len(unknown):
        return owner
    floor = np.array([b.centre[2] - b.size[2] / 2 for b in boxes])
    over = positions[unknown, 2] - floor[held]
    if over_ground is not None:
        over = np.fmin(over, over_ground(positions[unknown]))
    stands = over > FLOOR_M
    owner[unknown[stands]] = held[stands]
    return owner
