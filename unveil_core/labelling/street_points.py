"""The points of what stays in the street, with a class each, and the ground between them: made once a drive."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64, Mask
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.cityscapes import VOID, train_id
from unveil_core.drives.drive import Drive
from unveil_core.geometry.cloud import estimate_normals, thin_points
from unveil_core.geometry.images import disc
from unveil_core.ground.from_points import find_ground
from unveil_core.ground.height_field import HeightField
from unveil_core.labelling.object_points import REMOVABLE_IDS, in_boxes
from unveil_core.semantics.classes import GROUND_CLASSES, REMOVABLE

__all__ = ["GROUND_IDS", "GroundClasses", "StreetPoints", "nearest_known", "street_points"]

GROUND_IDS = tuple(train_id(name) for name in GROUND_CLASSES)
"""TrainIds of the ground."""
ROAD, BUILDING, POLE = train_id("road"), train_id("building"), train_id("pole")
MOST_POINTS = 400_000
"""Points of a drive that are looked at from every frame, however long it is; more are thinned. That bounds the time of a frame and,
at 0.8 kB each while normals are found, memory. Half as many changed 1 % of a street's pixels."""
ON_GROUND_M = 0.15
"""Points without a class lie on the ground if no higher over it than this, metres: lower than most kerbs."""
CELL_M, FILTER = 0.2, 5
"""Side of a cell of the plan of ground classes, metres; each takes the class of most of so many by so many around it."""
MOST_CELLS = 16_000_000
"""Drives over more ground than so many cells cover get larger ones."""
MOSTLY = 0.5
"""Where a larger share of the points has a class, those without one are noise, as exhaust and reflections."""
LONE_M, LONE_SHARE = 0.15, 0.02
"""Points are specks if their neighbours are farther away than so many metres and this share of the way to the nearest camera."""
GAP_M = 0.8
"""Ground goes on between points that lie no more than twice so far apart, metres: as the rings of a LiDAR 30 m away do."""
SLIM_CELL_M, SLIM_REACH, SLIM_CELLS = 0.4, 4, 12
"""A point of a pole has, of the cells of this side, metres, within so many of its own, no more than so many occupied by the like.
PandaSet calls fences, awnings and sheds "other static objects" as it does poles."""
BOX_STEP_M = 0.3
"""Boxes of one object are looked into again where it moved by so much, metres."""


@dataclass(frozen=True, eq=False)
class GroundClasses:
    """Classes of the ground in plan.

    Attributes:
        corner: (2,) of the first cell, x and y; cell: its side; metres.
        classes: (A, B) uint8 trainIds; known: (A, B) bool, where points lie on it.
    """

    corner: Float64
    cell: float
    classes: NDArray[np.uint8]
    known: Mask

    def _index(self, places: Float64) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        index = np.floor((places - self.corner) / self.cell).astype(np.int64)
        row, column = np.clip(index, 0, np.array(self.classes.shape) - 1).T
        return row, column

    def at(self, places: Float64) -> NDArray[np.uint8]:
        """(N,) class at x and y (N, 2); beyond the plan that of its nearest border."""
        return self.classes[self._index(places)]

    def known_at(self, places: Float64) -> Mask:
        """(N,) whether points lie on the ground about x and y (N, 2)."""
        return self.known[self._index(places)]


@dataclass(frozen=True, eq=False)
class StreetPoints:
    """What stays.

    Attributes:
        positions, normals: (P, 3); spacing: (P,) metres.
        classes: (P,) uint8 trainIds, none of them removable, 255 unknown.
        over: (P,) height over the ground, metres, NaN unknown.
        ground: its height; None where too few points lie on any.
        plan: classes of the ground; None where no point has one.
    """

    positions: Float64
    normals: Float64
    spacing: Float64
    classes: NDArray[np.uint8]
    over: Float64
    ground: HeightField | None
    plan: GroundClasses | None


def street_points(drive: Drive) -> StreetPoints:
    """Choose and class the points of a drive that show what stays."""
    points = drive.points
    positions = points.positions
    classes = np.full(len(positions), VOID, np.uint8) if points.classes is None else points.classes
    stays = ~np.isin(classes, REMOVABLE_IDS)
    if points.moving is not None:
        stays &= ~points.moving
    known_ground = stays & np.isin(classes, GROUND_IDS)
    labelled = bool(known_ground.any())
    ground = _ground(drive, positions[known_ground if labelled else stays])
    unknown = np.flatnonzero(stays & (classes == VOID))
    stays[unknown[in_boxes(positions[unknown], _all_boxes(drive), 0.0) >= 0]] = False
    if (classes != VOID).sum() > MOSTLY * len(classes):
        stays &= classes != VOID
    kept = np.flatnonzero(stays)
    cell = 0.0
    while len(kept) > MOST_POINTS:
        cell = max(0.06, cell * 1.3)
        kept = np.flatnonzero(stays)[thin_points(positions[stays], cell)]
    positions, classes = positions[kept], classes[kept].copy()
    over = np.full(len(positions), np.nan) if ground is None else ground.over(positions)
    if not labelled:
        guess = classes == VOID
        classes[guess & (over <= ON_GROUND_M)] = ROAD
        classes[guess & ~(over <= ON_GROUND_M)] = BUILDING
    poles = np.flatnonzero(classes == POLE)
    if len(poles):
        classes[poles[_wide(positions[poles])]] = BUILDING
    centres = np.stack([f.camera.centre for f in drive.frames])
    normals, spacing = estimate_normals(positions, centres)
    # Specks in the air, as exhaust and reflections leave them, would hide what is behind them.
    lone = spacing > LONE_M + LONE_SHARE * cKDTree(centres).query(positions)[0]
    positions, normals, spacing, classes, over = (v[~lone] for v in (positions, normals, spacing, classes, over))
    on_ground = np.isin(classes, GROUND_IDS)
    plan = _plan(positions[on_ground], classes[on_ground]) if on_ground.any() else None
    return StreetPoints(positions, normals, spacing, classes, over, ground, plan)


def _ground(drive: Drive, positions: Float64) -> HeightField | None:
    if not len(positions):
        return None
    return find_ground(replace(drive, points=replace(drive.points, positions=positions)), (), (), ())


def _all_boxes(drive: Drive) -> tuple[TrackedBox, ...]:
    """Boxes of removable objects at all the places where they were."""
    found: dict[tuple[int, ...], TrackedBox] = {}
    for part in (drive.sweeps, drive.frames):
        for boxes in (item.boxes for item in part):  # type: ignore[attr-defined]
            for box in boxes:
                if box.class_name in REMOVABLE:
                    found.setdefault((box.id, *(round(v / BOX_STEP_M) for v in box.centre)), box)
    return tuple(found.values())


def _plan(positions: Float64, classes: NDArray[np.uint8]) -> GroundClasses:
    """The class that most points of each cell and those around it have; of empty cells that of the nearest."""
    low, size = positions[:, :2].min(axis=0), np.ptp(positions[:, :2], axis=0)
    cell = max(CELL_M, float(np.sqrt(max(np.prod(size), 1.0) / MOST_CELLS)))
    shape = (np.floor(size / cell).astype(int) + 1).tolist()
    index = np.floor((positions[:, :2] - low) / cell).astype(np.int64)
    votes = []
    for number in GROUND_IDS:
        own = index[classes == number]
        count = np.zeros(shape, np.float32)
        # A cell with many points counts little more than one with few: they lie denser where the LiDAR was near.
        np.add.at(count, tuple(own.T), 1.0)
        votes.append(cv2.blur(np.minimum(count, 4.0), (FILTER, FILTER)))
    best = np.asarray(GROUND_IDS, np.uint8)[np.argmax(votes, axis=0)]
    empty = np.max(votes, axis=0) < 1e-6
    known = cv2.morphologyEx((~empty).astype(np.uint8), cv2.MORPH_CLOSE, disc(GAP_M / cell)).astype(bool)
    return GroundClasses(low, cell, nearest_known(best, ~empty), known)


def nearest_known(classes: NDArray[np.uint8], known: Mask) -> NDArray[np.uint8]:
    """(H, W) classes, where they are not known those of the nearest place where they are."""
    unknown = (~known).astype(np.uint8)
    _, nearest = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    of_label = np.zeros(int(nearest.max()) + 1, np.uint8)
    of_label[nearest[known]] = classes[known]
    return of_label[nearest]


def _wide(positions: Float64) -> Mask:
    """(P,) points of things wider than poles are, as seen from above."""
    low = positions[:, :2].min(axis=0)
    square = np.floor((positions[:, :2] - low) / SLIM_CELL_M).astype(np.int64)
    cells, index = np.unique(square, axis=0, return_inverse=True)
    tree = cKDTree(cells.astype(np.float64))
    around = np.asarray(tree.query_ball_point(cells.astype(np.float64), SLIM_REACH, return_length=True))
    wide: Mask = (around > SLIM_CELLS)[index.ravel()]
    return wide
