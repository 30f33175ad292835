"""Labels of photographs from what a dataset has: boxes of objects, and points that may have classes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float32, Mask
from unveil_core.drives.cityscapes import train_id
from unveil_core.drives.drive import Drive, Frame, FrameLabels
from unveil_core.labelling.object_points import ObjectPoints, gather_objects
from unveil_core.labelling.outlines import outlined
from unveil_core.labelling.silhouettes import silhouettes
from unveil_core.labelling.street_classes import street_classes, view_street
from unveil_core.labelling.street_points import StreetPoints, street_points
from unveil_core.semantics.classes import CITYSCAPES
from unveil_core.semantics.visibility import PointsInView

__all__ = ["label_frames"]

OBSTACLE_M = 0.3
"""Points of the street higher than this over the ground, metres, may stand before an object."""


def label_frames(drive: Drive, progress: Progress = no_progress) -> Iterator[FrameLabels]:
    """Label every frame.

    Args:
        drive: localized, its frames undistorted and of the size of their files; with points, boxes, and sweeps where there are.
        progress: called per sweep and per frame.
    Yields:
        classes, and ids of boxes as instances, in the order of the frames.
    Raises:
        DriveError: a picture or sweep that cannot be read, or a box of an unknown class.
    """
    for frame in drive.frames:
        for box in frame.boxes:
            if box.class_name not in CITYSCAPES:
                raise DriveError(
                    f"box {box.id} of frame {frame.name} has the unknown class {box.class_name!r}",
                    path=drive.root,
                    mend="use Cityscapes names, as car or person",
                )
    street = street_points(drive)
    objects, _ = gather_objects(drive, None if street.ground is None else street.ground.over, progress)
    for done, frame in enumerate(drive.frames):
        yield _label(frame, street, objects)
        progress(done + 1, len(drive.frames), "labelling frames")


def _label(frame: Frame, street: StreetPoints, objects: dict[int, ObjectPoints]) -> FrameLabels:
    image = read_image(frame.image_path)
    found = silhouettes(frame, objects)
    seen = view_street(street, frame.camera)
    owner = outlined(image, found, *_before(street, seen, image.shape))
    label = street_classes(image, frame.camera, street, seen, owner > 0)
    table = np.zeros(65536, np.uint8)
    for box in frame.boxes:
        table[box.id] = train_id(box.class_name)
    own = owner > 0
    label[own] = table[owner[own]]
    return FrameLabels(label, owner)


def _before(street: StreetPoints, seen: PointsInView, shape: tuple[int, ...]) -> tuple[Mask, Float32]:
    """Pixels with something upright, and its depth."""
    upright = ~(street.over[seen.index] < OBSTACLE_M)
    depth = np.full(shape[:2], np.inf, np.float32)
    np.minimum.at(depth, (seen.rows[upright], seen.columns[upright]), seen.depth[upright].astype(np.float32))
    return np.isfinite(depth), depth
