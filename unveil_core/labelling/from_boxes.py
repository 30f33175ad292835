"""Labels of photographs from what a dataset has: boxes of objects, and points that may have classes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.frame_cache import Frames
from unveil_core.base.pictures.decoding import read_image
from unveil_core.base.progress import Progress, no_progress
from unveil_core.drives.cityscapes import VOID, train_id
from unveil_core.drives.drive import Drive, Frame, FrameLabels
from unveil_core.labelling.leftovers import far_queues, strays_in_view
from unveil_core.labelling.object_points import ObjectPoints, Stray, gather_objects
from unveil_core.labelling.outlines import outlined
from unveil_core.labelling.silhouettes import silhouettes
from unveil_core.labelling.street_classes import street_classes, view_street
from unveil_core.labelling.street_points import StreetPoints, street_points
from unveil_core.labelling.tracks import continued, put_in_line
from unveil_core.semantics.classes import CITYSCAPES

__all__ = ["label_frame", "label_frames"]


def label_frames(drive: Drive, progress: Progress = no_progress) -> Sequence[FrameLabels]:
    """Labels of every frame, found when they are asked for.

    Args:
        drive: localized, its frames undistorted and of the size of their files; with points, boxes, and sweeps where there are.
        progress: called per sweep.
    Returns:
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
    drive = put_in_line(drive)
    street = street_points(drive)
    objects, strays = gather_objects(drive, None if street.ground is None else street.ground.over, progress)
    whole = continued(drive, objects)
    if whole is not drive:
        # Points without classes in the boxes that were found missing are no part of the street.
        street = street_points(whole)
    frames = whole.frames
    return Frames(len(frames), lambda i: label_frame(frames[i], street, objects, strays))


def label_frame(
    frame: Frame, street: StreetPoints, objects: Mapping[int, ObjectPoints], strays: Sequence[Stray]
) -> FrameLabels:
    """Label one frame; see :func:`label_frames`."""
    image = read_image(frame.image_path)
    found = silhouettes(frame, objects)
    view = view_street(street, frame.camera)
    owner = outlined(image, found, view.upright)
    label = street_classes(image, frame.camera, street, view, owner > 0)
    for more in (far_queues(found, owner, view.open_ground), strays_in_view(strays, frame, view.upright)):
        use = (more != VOID) & (owner == 0)
        label[use] = more[use]
    table = np.zeros(65536, np.uint8)
    for box in frame.boxes:
        table[box.id] = train_id(box.class_name)
    own = owner > 0
    label[own] = table[owner[own]]
    return FrameLabels(label, owner)
