"""nuScenes (Motional), as released: its tables, and the files of cameras and the LiDAR that they name.

    v1.0-mini/ or v1.0-trainval/    samples/<sensor>/ (annotated moments, 2 Hz)    sweeps/<sensor>/ (between them)
    lidarseg/ (labels of the LiDAR points of annotated moments, where installed)

Poses are ego from sensor and global from ego, quaternions wxyz; every file has the vehicle's pose at its own time, so a camera
and the LiDAR of one sample meet in the global frame only. Cameras have OpenCV axes and come rectified. Global: metres, z up; the
vehicle's height there is always 0. Boxes are annotated at samples and interpolated between them. Facts:
nutonomy/nuscenes-devkit (``schema_nuscenes.md``, ``data_classes.py``, lidarseg and panoptic instructions).
"""

from __future__ import annotations

import math
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.numbers_in_names import natural_key
from unveil_core.base.disk.open_safely import LARGEST_FILE, open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox, boxes_at
from unveil_core.drives.cityscapes import table
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep, SweepPoints
from unveil_core.drives.formats.binary import read_floats
from unveil_core.drives.formats.cameras import TrackIds, calibrated_camera, picture_size, pose_of
from unveil_core.drives.formats.nuscenes.tables import (
    LIDAR,
    MEND,
    TABLES,
    Row,
    SceneRows,
    SensorFile,
    is_tables,
    read_scene,
    scene_names,
    table_folders,
)

__all__ = ["BOX_CLASSES", "read_nuscenes", "recognizes", "scenes"]

FRONT = "CAM_FRONT"
POINT_COLUMNS = 5
"""x, y, z, intensity and ring of a LiDAR point, float32."""
NEAR_SENSOR_M = 1.0
"""Half the side of the square about the LiDAR whose points are dropped, as the devkit does: the roof it stands on."""
EGO_BOX_M = ((-0.9, 3.7), (-1.1, 1.1), (-0.5, 2.1))
"""x, y and z in the vehicle's axes, whose origin is amid the rear axle: the Renault Zoe that drove (4.1 m long, 1.9 m wide with its
mirrors, with the LiDAR on top 1.9 m high) and a hand's breadth. Points in it are its own."""
BOX_CLASSES: dict[str, str] = {
    "human.pedestrian.adult": "person",
    "human.pedestrian.child": "person",
    "human.pedestrian.construction_worker": "person",
    "human.pedestrian.personal_mobility": "person",
    "human.pedestrian.police_officer": "person",
    "human.pedestrian.stroller": "person",
    "human.pedestrian.wheelchair": "person",
    "vehicle.bicycle": "bicycle",
    "vehicle.bus.bendy": "bus",
    "vehicle.bus.rigid": "bus",
    "vehicle.car": "car",
    "vehicle.construction": "truck",
    "vehicle.emergency.ambulance": "car",
    "vehicle.emergency.police": "car",
    "vehicle.motorcycle": "motorcycle",
    "vehicle.trailer": "truck",
    "vehicle.truck": "truck",
}
"""Cityscapes classes of boxes; categories that are not listed, as cones, barriers and animals, stay in the street."""
POINT_CLASSES: dict[str, str] = {
    **BOX_CLASSES,
    "flat.driveable_surface": "road",
    "flat.sidewalk": "sidewalk",
    "flat.terrain": "terrain",
    "movable_object.barrier": "fence",
    "static.manmade": "building",
    "static.vegetation": "vegetation",
}
"""Of labelled points. "static.manmade" is buildings, walls, poles and signs alike."""
ARCHIVES = (
    "they are in v1.0-mini.tgz, or in the ten parts v1.0-trainvalNN_blobs.tgz (_keyframes, _blobs_lidar, _blobs_camera)"
)
"""Where a scene's files are to be had: each part has about 85 of the 850 scenes."""
NO_POINTS = ("noise", "vehicle.ego")
"""Categories of returns that nothing of the street sent."""


def recognizes(path: Path) -> bool:
    """Whether a folder is that of nuScenes, or of its tables."""
    return bool(table_folders(path))


def scenes(path: Path) -> list[str]:
    """Names of the scenes of all versions that a folder holds."""
    return sorted({name for folder in table_folders(path) for name in scene_names(folder)}, key=natural_key)


def read_nuscenes(path: Path, scene: str) -> Drive:
    """Read a scene with all its cameras, at annotated moments and between them.

    Args:
        path: folder of the dataset, or of its tables within it; scene: the name of one, as "scene-0061".
    Raises:
        DriveError: with the file and the mend.
    """
    folder = next((f for f in table_folders(path) if scene in scene_names(f)), None)
    if folder is None:
        raise DriveError(f"has no scene {scene}", path=path, mend="scene.json of v1.0-* names those it has")
    root = path.parent if is_tables(path) else path
    rows = read_scene(folder, scene)
    stamps, boxes = _boxes(rows)
    present = [f for f in rows.files if (root / f.filename).is_file()]
    frames, sweeps = [], []
    for file in present:
        at_its_time = boxes_at(file.seconds, stamps, boxes)
        if file.channel == LIDAR:
            sweeps.append(_sweep(rows, file, root, at_its_time))
        else:
            frames.append(_frame(rows, file, root, at_its_time))
    notices = _missing(rows, Counter(f.channel for f in present))
    notices += [] if rows.annotations else ["the scene has no boxes of objects"]
    if not frames:
        raise DriveError(
            f"has no photographs of {scene}", path=root / "samples", mend="unpack samples/ and sweeps/, too"
        )
    sources = [*(rows.table(name) for name in TABLES), *(root / name for name in rows.labels.values())]
    return Drive(
        root=root,
        frames=tuple(frames),
        points=PointCloud(np.zeros((0, 3))),
        sweeps=tuple(sweeps),
        sources=tuple(sources),
        front_cameras=(FRONT,),
        notices=tuple(notices),
        key_frames=frozenset(Path(f.filename).stem for f in present if f.key),
    )


def _missing(rows: SceneRows, present: Counter[str]) -> list[str]:
    """A line for each sensor of which files are missing."""
    wanted = Counter(f.channel for f in rows.files)
    names = {LIDAR: "LiDAR sweeps"}
    lines = [
        f"{wanted[channel] - present[channel]} of {wanted[channel]} {names.get(channel, f'photographs of {channel}')} "
        "are missing: samples/ holds the annotated ones, sweeps/ those between"
        for channel in sorted(wanted)
        if present[channel] < wanted[channel]
    ]
    lines[-1:] = [f"{line}; {ARCHIVES}" for line in lines[-1:]]
    return lines + ([] if wanted[LIDAR] else ["the scene has no LiDAR sweeps"])


def _pose(rows: SceneRows, name: str, row: Row | None, token: str) -> Float64:
    """(4, 4) of a row of ego_pose or calibrated_sensor."""
    if row is None:
        raise DriveError(f"has no row {token}", path=rows.table(name), mend=MEND)
    try:
        return pose_of(row["rotation"], row["translation"], rows.table(name), f"row {token}")
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise DriveError(f"Not a pose: row {token}: {error}", path=rows.table(name), mend=MEND) from error


def _poses(rows: SceneRows, file: SensorFile) -> tuple[Float64, Float64]:
    """(4, 4) each, global from ego and ego from sensor when a file was taken."""
    return (
        _pose(rows, "ego_pose", rows.ego_poses.get(file.ego_pose), file.ego_pose),
        _pose(rows, "calibrated_sensor", rows.calibrated.get(file.calibrated), file.calibrated),
    )


def _frame(rows: SceneRows, file: SensorFile, root: Path, boxes: tuple[TrackedBox, ...]) -> Frame:
    global_from_ego, ego_from_camera = _poses(rows, file)
    calibration, path = rows.table("calibrated_sensor"), root / file.filename
    try:
        k = np.asarray(rows.calibrated[file.calibrated]["camera_intrinsic"], dtype=np.float64)
        if k.shape != (3, 3):
            raise ValueError(f"it has {k.size} numbers")
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        problem = f"the camera_intrinsic of {file.channel} is none: {error}"
        raise DriveError(problem, path=calibration, mend=MEND) from error
    size = file.size if min(file.size) > 0 else picture_size(path)
    pose = global_from_ego @ ego_from_camera
    return Frame(
        name=path.stem,
        camera_name=file.channel,
        camera=calibrated_camera(size, (k[0, 0], k[1, 1]), (k[0, 2], k[1, 2]), pose, calibration),
        image_path=path,
        timestamp=file.seconds,
        boxes=boxes,
    )


def _boxes(rows: SceneRows) -> tuple[list[float], list[tuple[TrackedBox, ...]]]:
    """Times of the annotated moments, and the boxes at each."""
    found: dict[str, list[TrackedBox]] = {token: [] for token in rows.samples}
    ids = TrackIds()
    order = {token: i for i, token in enumerate(rows.samples)}
    for row in sorted(rows.annotations, key=lambda r: order[r["sample_token"]]):
        class_name = BOX_CLASSES.get(rows.classes.get(row["instance_token"], ""))
        if class_name is None:
            continue
        try:
            x, y, z = (float(v) for v in row["translation"])
            width, length, height = (float(v) for v in row["size"])
            qw, qx, qy, qz = (float(v) for v in row["rotation"])
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise DriveError(f"Not a box in a row: {error}", path=rows.table("sample_annotation"), mend=MEND) from error
        yaw = math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
        if np.isfinite([x, y, z, yaw, width, length, height]).all() and min(width, length, height) > 0:
            number = ids.of(str(row["instance_token"]))
            found[row["sample_token"]].append(TrackedBox(number, class_name, (x, y, z), (length, width, height), yaw))
    return list(rows.samples.values()), [tuple(boxes) for boxes in found.values()]


def _sweep(rows: SceneRows, file: SensorFile, root: Path, boxes: tuple[TrackedBox, ...]) -> Sweep:
    label_file = rows.labels.get(file.token)
    labels = None if label_file is None or not rows.categories else root / label_file
    path = root / file.filename
    read = partial(_points, path, *_poses(rows, file), labels, rows.categories)
    return Sweep(path, read, file.seconds, boxes, annotated=file.key)


def _points(
    path: Path, global_from_ego: Float64, ego_from_lidar: Float64, labels: Path | None, categories: dict[int, str]
) -> SweepPoints:
    local = read_floats(path, POINT_COLUMNS)[:, :3].astype(np.float64)
    ego = local @ ego_from_lidar[:3, :3].T + ego_from_lidar[:3, 3]
    keep = np.isfinite(local).all(axis=1) & (np.abs(local[:, :2]) >= NEAR_SENSOR_M).any(axis=1)
    low, high = np.array(EGO_BOX_M).T
    keep &= ((ego < low) | (ego > high)).any(axis=1)
    classes = None
    if labels is not None and labels.is_file():
        numbers = _label_numbers(labels, len(local))
        keep &= ~np.isin(numbers, [n for n, name in categories.items() if name in NO_POINTS])
        named: Any = {n: POINT_CLASSES.get(name) for n, name in categories.items() if 0 <= n < 256}
        classes = table(named)[numbers][keep]
    positions = ego[keep] @ global_from_ego[:3, :3].T + global_from_ego[:3, 3]
    return SweepPoints(positions, classes)


def _label_numbers(path: Path, count: int) -> NDArray[np.uint8]:
    """(count,) category number of each point."""
    try:
        with open_file(path, LARGEST_FILE) as stream:
            numbers = np.fromfile(stream, dtype=np.uint8)
    except OSError as error:
        raise DriveError(f"cannot be read: {error.strerror}", path=path, mend="download it again") from error
    if len(numbers) != count:
        raise DriveError(f"labels {len(numbers)} points, the sweep has {count}", path=path, mend="download both again")
    return numbers
