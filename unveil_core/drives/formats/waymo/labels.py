"""Waymo's labelled photographs: panoptic PNGs, of some frames of some segments.

A pixel is its class times a divisor plus the number of its object, which counts within the photograph; a list in the row tells
the number of each object within its sequence. Facts: waymo-research/waymo-open-dataset (``camera_segmentation.proto``,
``camera_segmentation_utils.py``).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.pictures.decoding import decode_unchanged
from unveil_core.drives.cityscapes import table
from unveil_core.drives.drive import FrameLabels
from unveil_core.drives.formats.cameras import TrackIds
from unveil_core.drives.formats.tables import Rows, read_columns
from unveil_core.drives.formats.waymo.segment import CAMERA, CONTEXT, STAMP, Segment

__all__ = ["labels_of"]

EGO_VEHICLE = 1
PIXEL_CLASSES: dict[int, str | None] = {
    2: "car", 3: "truck", 4: "bus", 5: "truck", 6: "bicycle", 7: "motorcycle", 8: "truck", 9: "person", 10: "rider",
    11: "rider", 15: "pole", 16: "person", 17: "traffic sign", 18: "traffic light", 19: "building", 20: "road",
    21: "road", 22: "road", 23: "sidewalk", 24: "vegetation", 25: "sky", 26: "terrain",
}  # fmt: skip
"""Of the ids in camera_segmentation.proto; 5 is "other large vehicle", 8 a trailer, 16 what a pedestrian pushes or carries. Birds,
animals, cones, and what is dynamic or static without a name have no class of Cityscapes."""
PREFIX = "[CameraSegmentationLabelComponent]"
IMAGE, DIVISOR, SEQUENCE = (f"{PREFIX}.{n}" for n in ("panoptic_label", "panoptic_label_divisor", "sequence_id"))
LOCAL, GLOBAL = (f"{PREFIX}.instance_id_to_global_id_mapping.{n}_instance_ids" for n in ("local", "global"))
MOST_OBJECTS = 65535
"""That 16 bits tell apart."""


def labels_of(segment: Segment) -> dict[tuple[int, str], Callable[[tuple[int, int]], FrameLabels]]:
    """Readers of the labelled photographs by time stamp and camera; each is given the photograph's width and height.

    Raises:
        DriveError: a table that cannot be read.
    """
    path = segment.files.get("camera_segmentation")
    if path is None:
        return {}
    columns = read_columns(path, (STAMP, CAMERA, DIVISOR), (CONTEXT, SEQUENCE, LOCAL, GLOBAL))
    divisors = columns.integers(DIVISOR).tolist()
    sequences = columns.words(SEQUENCE) if SEQUENCE in columns else [""] * columns.count
    both = LOCAL in columns and GLOBAL in columns
    local, shared = (columns.lists(n) if both else [None] * columns.count for n in (LOCAL, GLOBAL))
    ids = TrackIds()
    rows = Rows(path, (IMAGE,))
    found: dict[tuple[int, str], Callable[[tuple[int, int]], FrameLabels]] = {}
    for i, (stamp, camera) in sorted(segment.keys(columns, STAMP, CAMERA), key=lambda row: row[1]):
        numbers: dict[int, int] | None = None
        here, everywhere = local[i], shared[i]
        if here is not None and everywhere is not None and len(here) == len(everywhere):
            names = [f"{sequences[i]} {n}" for n in everywhere.tolist()]
            numbers = {int(k): ids.of(n) for k, n in zip(here.tolist(), names, strict=True)}
        if divisors[i] < 1:
            raise DriveError(f"has the divisor {divisors[i]} at {stamp}", path=path, mend="download it again")
        found[int(stamp), str(camera)] = partial(_read, rows, i, divisors[i], numbers)
    return found


def _read(rows: Rows, number: int, divisor: int, numbers: dict[int, int] | None, size: tuple[int, int]) -> FrameLabels:
    path = rows.path
    content = rows.row(number)[IMAGE].as_py()
    picture = _decoded(content, Path(f"{path}, row {number}"), size)
    kinds, objects = np.divmod(picture.astype(np.int64), divisor)
    instance = None
    if numbers is not None:
        known = np.zeros(max(divisor, 1 << 16), dtype=np.uint16)
        for here, name in numbers.items():
            if 0 < here < len(known) and name <= MOST_OBJECTS:
                known[here] = name
        instance = known[objects]
    return FrameLabels(table(PIXEL_CLASSES)[np.clip(kinds, 0, 255)], instance, kinds == EGO_VEHICLE)


def _decoded(content: object, path: Path, size: tuple[int, int]) -> NDArray[np.generic]:
    picture = decode_unchanged(content, path, size) if isinstance(content, bytes) else None
    if picture is None or picture.ndim != 2:
        raise DriveError("Not a grey PNG: a label image in it", path=path, mend="download it again")
    return picture
