"""Waymo Open Dataset v2 (perception, parquet): a segment as a drive. ``segment`` tells of its folders.

Photographs have the pose of the vehicle at their own time; boxes are in the vehicle at the frame's pose. A frame's boxes are
given to its photographs as they are: each camera is released as the turning LiDAR, whose points the boxes enclose, passes its
view, so both show an object at one time, while the stamp of the frame is that of the turn's start.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import Drive, Frame, PointCloud
from unveil_core.drives.formats.cameras import TrackIds, calibrated_camera, rigid
from unveil_core.drives.formats.tables import Columns, Rows, read_columns
from unveil_core.drives.formats.waymo.labels import labels_of
from unveil_core.drives.formats.waymo.segment import (
    CAMERA,
    CONTEXT,
    IMAGES,
    OBJECT,
    STAMP,
    Segment,
    holds_components,
    lenses,
    segment_at,
    segments,
    vehicle_poses,
)
from unveil_core.drives.formats.waymo.sweeps import sweeps_of

__all__ = ["is_one", "read_waymo", "recognizes", "scenes"]

FRONT = "FRONT"
IMAGE, OWN_POSE, OWN_TIME = (f"[CameraImageComponent].{n}" for n in ("image", "pose.transform", "pose_timestamp"))
BOX_CLASSES = {"1": "car", "2": "person", "4": "rider", "VEHICLE": "car", "PEDESTRIAN": "person", "CYCLIST": "rider"}
"""Cityscapes classes of boxes; a vehicle may as well be a truck or a bus, which Waymo's boxes do not tell. Signs (3) stay in the
street."""
LONGEST_TURN_S = 1.0
"""A photograph's own time is taken when it lies so near to the frame's; a turn of the LiDAR takes 0.1 s."""


def recognizes(path: Path) -> bool:
    """Whether a folder holds tables of the dataset, or splits with such."""
    return path.is_dir() and bool(segments(path))


def is_one(folder: Path) -> bool:
    """Whether a folder holds tables itself."""
    return holds_components(folder) and recognizes(folder)


def scenes(path: Path) -> list[str]:
    """Names of the segments in a folder."""
    return segments(path)


def read_waymo(path: Path, scene: str) -> Drive:
    """Read a segment. Tables that are missing leave gaps that a notice tells; of the photographs' own, camera_calibration must be
    there.

    Args:
        path: folder of the components, or of the splits; scene: name of the segment.
    Raises:
        DriveError: with the table and the mend.
    """
    segment = segment_at(path, scene)
    notices: list[str] = []
    poses = vehicle_poses(segment)
    boxes = _boxes(segment, poses)
    frames = _frames(segment, poses, boxes, notices)
    sweeps = sweeps_of(segment, poses, boxes, notices)
    labelled = sum(f.labels is not None for f in frames)
    if 0 < labelled < len(frames):
        notices.append(f"{labelled} of {len(frames)} photographs are labelled")
    return Drive(
        root=path,
        frames=tuple(frames),
        points=PointCloud(np.zeros((0, 3))),
        semantic_classes="cityscapes" if labelled else None,
        sources=tuple(segment.files.values()),
        sweeps=tuple(sweeps),
        front_cameras=(FRONT,),
        notices=tuple(notices),
    )


def _frames(
    segment: Segment,
    poses: Mapping[int, Float64],
    boxes: Mapping[int, tuple[TrackedBox, ...]],
    notices: list[str],
) -> list[Frame]:
    path = segment.files.get(IMAGES)
    if path is None:
        notices.append(f"no images: the table {IMAGES} is missing")
        return []
    columns = read_columns(path, (STAMP, CAMERA), (CONTEXT, OWN_POSE, OWN_TIME))
    own_poses = columns.vectors(OWN_POSE, 16) if OWN_POSE in columns else np.full((columns.count, 16), np.nan)
    own_times = columns.numbers(OWN_TIME) if OWN_TIME in columns else np.full(columns.count, np.nan)
    calibrations, labels = lenses(segment), labels_of(segment)
    rows = Rows(path, (IMAGE,))
    found: list[Frame] = []
    placeless = 0
    unknown: set[str] = set()
    for i, (stamp, camera) in sorted(segment.keys(columns, STAMP, CAMERA), key=lambda row: row[1]):
        stamp, camera = int(stamp), str(camera)
        lens = calibrations.get(camera)
        pose = poses.get(stamp)
        if np.isfinite(own_poses[i]).all() and own_poses[i].any():
            pose = rigid(own_poses[i], path, f"the pose of {camera} at {stamp}")
        if lens is None or pose is None:
            unknown |= {camera} if lens is None else set()
            placeless += lens is not None
            continue
        image = path / camera / f"{stamp}.jpg"
        reader = labels.get((stamp, camera))
        found.append(
            Frame(
                name=str(stamp),
                camera_name=camera,
                camera=calibrated_camera(lens.size, lens.focal, lens.centre, pose @ lens.vehicle_from_camera, path),
                image_path=image,
                distortion=lens.distortion,
                timestamp=float(own_times[i]) if abs(own_times[i] - stamp / 1e6) < LONGEST_TURN_S else stamp / 1e6,
                boxes=boxes.get(stamp, ()),
                labels=None if reader is None else partial(reader, lens.size),
                image_bytes=partial(_image, rows, i, image),
            )
        )
    notices += [f"camera {c} is left out: camera_calibration does not have it" for c in sorted(unknown)]
    if placeless:
        notices.append(f"{placeless} photographs have no pose and are left out")
    if not found:
        raise DriveError("has no photograph with a pose and a calibration", path=path, mend="download all tables again")
    return sorted(found, key=lambda f: f.camera_name != FRONT)


def _image(rows: Rows, number: int, path: Path) -> bytes:
    content = rows.row(number)[IMAGE].as_py()
    if not isinstance(content, bytes) or not content:
        raise DriveError("Empty", path=path, mend="download the table again, or leave the frame out")
    return content


def _boxes(segment: Segment, poses: Mapping[int, Float64]) -> dict[int, tuple[TrackedBox, ...]]:
    """Boxes in the world by the time stamp of their frame."""
    path = segment.files.get("lidar_box")
    if path is None:
        return {}
    prefix = "[LiDARBoxComponent]"
    numbers = [f"{prefix}.box.{n}.{a}" for n in ("center", "size") for a in "xyz"] + [f"{prefix}.box.heading"]
    columns = read_columns(path, (STAMP, OBJECT, f"{prefix}.type", *numbers), (CONTEXT,))
    values = np.stack([columns.numbers(n) for n in numbers], axis=1)
    names = _class_names(columns, f"{prefix}.type")
    ids = TrackIds()
    found: dict[int, list[TrackedBox]] = {}
    for i, (stamp, track) in sorted(segment.keys(columns, STAMP, OBJECT), key=lambda row: row[1]):
        pose, name = poses.get(int(stamp)), names[i]
        if pose is None or name is None or not np.isfinite(values[i]).all() or values[i, 3:6].min() <= 0:
            continue
        x, y, z = (pose[:3, :3] @ values[i, :3] + pose[:3, 3]).tolist()
        length, width, height, heading = values[i, 3:].tolist()
        ahead = pose[:2, :2] @ (math.cos(heading), math.sin(heading))
        yaw = math.atan2(ahead[1], ahead[0])
        box = TrackedBox(ids.of(str(track)), name, (x, y, z), (length, width, height), yaw)
        found.setdefault(int(stamp), []).append(box)
    return {stamp: tuple(boxes) for stamp, boxes in found.items()}


def _class_names(columns: Columns, kind: str) -> list[str | None]:
    return [BOX_CLASSES.get(word.removeprefix("TYPE_")) for word in columns.words(kind)]
