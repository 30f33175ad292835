"""Waymo's LiDARs: range images to points in the world, with their labels.

A range image has a row for each beam, the highest first, and a column for each direction, from behind over the left to behind
again as the sensor's x points. Four of the five LiDARs are stored as seen from where the vehicle was at the frame's pose; the
one on top has a pose of the vehicle for each pixel. Facts: waymo-research/waymo-open-dataset (``range_image_utils.py``,
``lidar_utils.py``, ``segmentation.proto``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64, Mask
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.cityscapes import VOID, table
from unveil_core.drives.drive import Sweep, SweepPoints
from unveil_core.drives.formats.tables import Rows, array_of, read_columns
from unveil_core.drives.formats.waymo.segment import CONTEXT, LASER, STAMP, Laser, Segment, lasers

__all__ = ["points_of_range_image", "sweeps_of"]

TOP = "TOP"
RETURNS = ("range_image_return1", "range_image_return2")
POINT_CLASSES: dict[int, str | None] = {
    1: "car", 2: "truck", 3: "bus", 4: "truck", 5: "rider", 6: "rider", 7: "person", 8: "traffic sign", 9: "traffic light",
    10: "pole", 12: "bicycle", 13: "motorcycle", 14: "building", 15: "vegetation", 16: "vegetation", 17: "sidewalk",
    18: "road", 19: "road", 20: "terrain", 21: "terrain", 22: "sidewalk",
}  # fmt: skip
"""Of the ids in segmentation.proto; 4 is "other vehicle", 11 a cone, 16 a trunk, 17 a kerb, 21 what is walkable but no sidewalk."""


@dataclass(frozen=True, eq=False)
class _Lidar:
    """What the sweeps of a segment share: calibrations, and the tables with their rows by time stamp and laser."""

    lasers: dict[str, Laser]
    images: Rows
    image_rows: dict[tuple[int, str], int]
    poses: Rows | None
    pose_rows: dict[tuple[int, str], int]
    labels: Rows | None
    label_rows: dict[tuple[int, str], int]


def sweeps_of(
    segment: Segment, poses: Mapping[int, Float64], boxes: Mapping[int, tuple[TrackedBox, ...]], notices: list[str]
) -> list[Sweep]:
    """The sweeps of a segment, of all its LiDARs together, in order of time; nothing of them is read yet.

    Args:
        poses: (4, 4) world from vehicle by time stamp; boxes: likewise, in the world.
        notices: what a user should know is added.
    Raises:
        DriveError: a table that cannot be read.
    """
    path = segment.files.get("lidar")
    if path is None:
        notices.append("no LiDAR: the table lidar is missing")
        return []
    calibrations = lasers(segment)
    if not calibrations:
        notices.append("no LiDAR: the table lidar_calibration is missing")
        return []
    image_rows = _rows(segment, "lidar")
    poses_path, labels_path = segment.files.get("lidar_pose"), segment.files.get("lidar_segmentation")
    if poses_path is None and any(laser == TOP for _, laser in image_rows):
        notices.append(
            "points of the top LiDAR are not corrected for the vehicle's motion: the table lidar_pose is missing"
        )
    unknown = sorted({laser for _, laser in image_rows} - set(calibrations))
    if unknown:
        notices.append(f"LiDAR {unknown[0]} is not read: lidar_calibration does not have it")
    lidar = _Lidar(
        calibrations,
        _images(path, "LiDARComponent"),
        image_rows,
        None if poses_path is None else _images(poses_path, "LiDARPoseComponent"),
        _rows(segment, "lidar_pose"),
        None if labels_path is None else _images(labels_path, "LiDARSegmentationLabelComponent"),
        _rows(segment, "lidar_segmentation"),
    )
    stamps = sorted({stamp for stamp, laser in image_rows if laser in calibrations})
    lost = sum(stamp not in poses for stamp in stamps)
    if lost:
        notices.append(f"{lost} of {len(stamps)} LiDAR sweeps have no vehicle_pose and are left out")
    return [
        Sweep(path, partial(_read, lidar, stamp, poses[stamp]), stamp / 1e6, boxes.get(stamp, ()))
        for stamp in stamps
        if stamp in poses
    ]


def _rows(segment: Segment, component: str) -> dict[tuple[int, str], int]:
    path = segment.files.get(component)
    if path is None:
        return {}
    columns = read_columns(path, (STAMP, LASER), (CONTEXT,))
    return {(int(stamp), str(laser)): i for i, (stamp, laser) in segment.keys(columns, STAMP, LASER)}


def _images(path: Path, component: str) -> Rows:
    """The range images of a table, of the second return where it has them."""
    first, second = (tuple(f"[{component}].{name}.{part}" for part in ("values", "shape")) for name in RETURNS)
    return Rows(path, first, second)


def _read(lidar: _Lidar, stamp: int, pose: Float64) -> SweepPoints:
    positions: list[Float64] = []
    classes: list[NDArray[np.uint8]] = []
    labelled = False
    # In the order of the rows, which are read forward.
    for key in sorted((k for k in lidar.image_rows if k[0] == stamp), key=lambda k: lidar.image_rows[k]):
        laser = lidar.lasers.get(key[1])
        if laser is None:
            continue
        row = lidar.images.row(lidar.image_rows[key])
        motion = None
        if lidar.poses is not None and key in lidar.pose_rows:
            motion = _image(lidar.poses.row(lidar.pose_rows[key]), RETURNS[0], lidar.poses.path, np.float64)
        labels = None
        if lidar.labels is not None and key in lidar.label_rows:
            labels = lidar.labels.row(lidar.label_rows[key])
            labelled = True
        for name in RETURNS:
            ranges = _image(row, name, lidar.images.path, np.float32)
            if ranges is None:
                continue
            found, valid = points_of_range_image(ranges, laser, motion, pose, lidar.images.path)
            kinds = np.full(len(found), VOID, dtype=np.uint8)
            image = (
                None if labels is None or lidar.labels is None else _image(labels, name, lidar.labels.path, np.int64)
            )
            if image is not None and lidar.labels is not None:
                if image.shape[:2] != valid.shape or image.shape[2] < 2:
                    raise DriveError(f"labels at {stamp} have another size than the sweep", path=lidar.labels.path)
                kinds = table(POINT_CLASSES)[np.clip(image[..., 1][valid], 0, 255)]
            finite = np.isfinite(found).all(axis=1)
            positions.append(found[finite])
            classes.append(kinds[finite])
    if not positions:
        return SweepPoints(np.zeros((0, 3)), None)
    return SweepPoints(np.concatenate(positions), np.concatenate(classes) if labelled else None)


def _image(row: Mapping[str, Any], name: str, path: Path, kind: type) -> NDArray[Any] | None:
    """The (H, W, C) image of a return in a row, None where it has none."""
    parts = {column.rsplit(".", 1)[1]: value for column, value in row.items() if f".{name}." in column}
    if len(parts) < 2:
        return None
    values, shape = (array_of(parts[part], path, part) for part in ("values", "shape"))
    if values is None or shape is None or not len(values):
        return None
    if len(shape) != 3 or (shape < 1).any() or int(np.prod(shape.astype(np.int64))) != len(values):
        raise DriveError(f"has a range image of {len(values)} numbers, not {shape.tolist()}", path=path)
    return values.reshape(shape.tolist()).astype(kind, copy=False)


def points_of_range_image(
    image: NDArray[Any], laser: Laser, motion: Float64 | None, pose: Float64, path: Path
) -> tuple[Float64, Mask]:
    """Points of a range image in the world, in the order of its pixels.

    Args:
        image: (H, W, C), its first channel the range in metres, 0 or less where nothing came back.
        laser: its calibration.
        motion: (H, W, 6) roll, pitch, yaw, x, y, z of the vehicle in the world at each pixel, or None.
        pose: (4, 4) world from vehicle of the frame, taken where ``motion`` is None.
        path: of the table, for messages.
    Returns:
        (P, 3) float64, and the pixels (H, W) that they are of.
    Raises:
        DriveError: calibration or motion that does not fit to the image.
    """
    height, width = image.shape[:2]
    beams = laser.inclinations
    if beams is None:
        beams = (np.arange(height) + 0.5) / height * (laser.highest - laser.lowest) + laser.lowest
    if len(beams) != height or not np.isfinite(beams).all():
        raise DriveError(f"has {height} rows in a range image, lidar_calibration {len(beams)} beams", path=path)
    if motion is not None and motion.shape != (height, width, 6):
        raise DriveError("has range images of another size than lidar_pose", path=path, mend="download both again")
    valid = (image[..., 0] > 0) & np.isfinite(image[..., 0])
    rows, columns = np.nonzero(valid)
    far = image[..., 0][valid].astype(np.float64)
    extrinsic = laser.vehicle_from_laser
    inclination = beams[::-1][rows]
    # Columns count from the vehicle's back, so the way the sensor is turned on it is taken out again.
    azimuth = ((width - columns - 0.5) / width * 2 - 1) * np.pi - np.arctan2(extrinsic[1, 0], extrinsic[0, 0])
    level = far * np.cos(inclination)
    seen = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), far * np.sin(inclination)], axis=1)
    in_vehicle = seen @ extrinsic[:3, :3].T + extrinsic[:3, 3]
    if motion is None:
        return in_vehicle @ pose[:3, :3].T + pose[:3, 3], valid
    return _moved(in_vehicle, motion[valid]), valid


def _moved(points: Float64, poses: Float64) -> Float64:
    """(P, 3) points by poses (P, 6) of roll, pitch, yaw about x, y, z in this order, then x, y, z."""
    (x, y, z), (roll, pitch, yaw) = points.T, poses[:, :3].T
    y, z = y * np.cos(roll) - z * np.sin(roll), y * np.sin(roll) + z * np.cos(roll)
    x, z = x * np.cos(pitch) + z * np.sin(pitch), z * np.cos(pitch) - x * np.sin(pitch)
    x, y = x * np.cos(yaw) - y * np.sin(yaw), x * np.sin(yaw) + y * np.cos(yaw)
    return np.stack([x, y, z], axis=1) + poses[:, 3:]
