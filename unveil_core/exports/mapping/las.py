"""The points as LAS 1.4 or LAZ (ASPRS), by ``laspy``: point format 7 with colours, 6 without. These formats ask for the bit that
says that a coordinate system, if there is one, is text (WKT); readers refuse a file without it.

Classification codes are those of ASPRS where it has one for a class, else 64 + the Cityscapes trainId, in the range that is free
for users; extra bytes ``train_id`` and ``object_id`` keep both. Coordinates are the drive's own, as whole steps of a millimetre
(0.001 units of a metre's length) from an offset near the points.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from unveil_core.exports.job import Job
from unveil_core.exports.mapping.cloud import street_points
from unveil_core.semantics.classes import CITYSCAPES, VOID

__all__ = ["ASPRS", "STEP_M", "write_las"]

STEP_M = 0.001
"""Resolution of coordinates, metres: finer than any scanner."""
ASPRS = {"road": 11, "sidewalk": 2, "terrain": 2, "building": 6, "vegetation": 5}
"""Codes of LAS 1.4 R15, table 17: road surface, ground, building, high vegetation."""
UNCLASSIFIED, FIRST_OF_USERS = 1, 64


def write_las(job: Job, path: Path) -> None:
    """The points as LAS, or as LAZ where the suffix of ``path`` says so."""
    import laspy

    found = street_points(job)
    cloud = found.cloud
    world = job.drive.to_world.to_world(cloud.positions)
    header = laspy.LasHeader(version="1.4", point_format=6 if cloud.colors is None else 7)
    header.add_extra_dims(
        [
            laspy.ExtraBytesParams("train_id", np.uint8, "Cityscapes trainId, 255 none"),
            laspy.ExtraBytesParams("object_id", np.uint16, "object, 0 none"),
        ]
    )
    header.generating_software = "unveil"
    header.global_encoding.wkt = True
    header.global_encoding.synthetic_return_numbers = True
    if job.coordinate_system is not None:
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(job.coordinate_system))
    header.offsets = np.floor(world.min(axis=0)) if len(world) else np.zeros(3)
    header.scales = np.full(3, STEP_M * job.drive.to_world.scale)
    las = laspy.LasData(header)
    las.x, las.y, las.z = world.T
    classes = np.full(len(world), VOID, np.uint8) if cloud.classes is None else cloud.classes
    semantic = job.labels.source == "semantics"
    las.classification = _codes()[classes] if semantic else np.full(len(world), UNCLASSIFIED, np.uint8)
    las["train_id"] = classes
    las["object_id"] = found.objects.astype(np.uint16)
    las.return_number = las.number_of_returns = np.ones(len(world), np.uint8)
    if cloud.colors is not None:
        # LAS keeps colours in 16 bits.
        las.red, las.green, las.blue = (cloud.colors.astype(np.uint16) * 257).T
    las.write(str(path))


def _codes() -> np.ndarray:
    """(256,) classification code by trainId."""
    codes = np.full(256, UNCLASSIFIED, dtype=np.uint8)
    for number, name in enumerate(CITYSCAPES):
        codes[number] = ASPRS.get(name, FIRST_OF_USERS + number)
    return codes
