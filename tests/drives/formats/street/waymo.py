"""The street as Waymo's segments have it: as released (v2), and as neuralsim, DriveStudio and Street Gaussians prepare them."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
from pyarrow import parquet
from scipy.spatial.transform import Rotation

from tests.drives.formats.street.street import (
    OPENCV_FROM_WAYMO,
    Array,
    Street,
    rigid,
    saved,
    transformed,
    turned_about_z,
)

__all__ = ["write_drivestudio", "write_neuralsim", "write_street_gaussians", "write_waymo"]

NAME = "10023947602400723454_1120_000_1140_000"
START_S = 1_552_440_195.0
TOP = rigid(turned_about_z(2.6), (1.4, 0.0, 2.1))
"""Vehicle from laser."""
IMAGE = (320, 2000)
"""Rows and columns of a range image: more than Waymo's, so that points lie near where they were."""
BOX_TYPES = {"car": 1, "truck": 1, "bus": 1, "person": 2, "rider": 4}
CLASS_NAMES = {1: "Vehicle", 2: "Pedestrian", 4: "Cyclist"}


def _class_name(class_name: str) -> str:
    return CLASS_NAMES[BOX_TYPES[class_name]]


def _encoded(image: np.ndarray) -> bytes:
    return cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()


def _range_image(points: Array, beams: Array) -> np.ndarray:
    """(H, W, 4) of points in the laser's axes; of two in one pixel the nearer is kept."""
    height, width = IMAGE
    image = np.zeros((height, width, 4), np.float32)
    far = np.linalg.norm(points, axis=1)
    turned = np.arctan2(TOP[1, 0], TOP[0, 0])
    around = (np.arctan2(points[:, 1], points[:, 0]) + turned + np.pi) % (2 * np.pi) - np.pi
    columns = np.clip(np.round(width - 0.5 - width * (around / np.pi + 1) / 2), 0, width - 1).astype(int)
    up = np.arcsin(points[:, 2] / far)
    rows = height - 1 - np.abs(beams[:, None] - up).argmin(axis=0)
    for k in np.argsort(-far):
        image[rows[k], columns[k], 0] = far[k]
    return image


def _return_columns(component: str, images: list[np.ndarray]) -> dict[str, Any]:
    """The columns of the top LiDAR's first return: images (H, W, C), one a frame."""
    return {
        "key.laser_name": pa.array([1] * len(images), pa.int8()),
        f"[{component}].range_image_return1.values": pa.array([m.ravel() for m in images], pa.list_(pa.float32())),
        f"[{component}].range_image_return1.shape": pa.array([m.shape for m in images], pa.list_(pa.int32(), 3)),
    }


def write_waymo(root: Path, street: Street) -> Path:
    """Tables with boxes and the top LiDAR; photographs are not labelled, as in most segments."""
    fixed = pa.list_(pa.float64(), 16)
    stamps = [round((START_S + t) * 1e6) for t in street.times]
    in_laser = [transformed(np.linalg.inv(v @ TOP), street.sweep(i)[0]) for i, v in enumerate(street.vehicles)]
    up = np.concatenate([np.arcsin(p[:, 2] / np.linalg.norm(p, axis=1)) for p in in_laser])
    beams = np.linspace(up.min(), up.max(), IMAGE[0])
    images = [_range_image(p, beams) for p in in_laser]
    motions = []
    for pose in street.vehicles:
        six = [*Rotation.from_matrix(pose[:3, :3]).as_euler("xyz"), *pose[:3, 3]]
        motions.append(np.tile(np.array(six, np.float32), (*IMAGE, 1)))
    extrinsic = street.vehicle_from_camera @ rigid(OPENCV_FROM_WAYMO, (0, 0, 0))
    lens = "[CameraCalibrationComponent]"
    k = street.calibration(from_first_centre=False)
    numbers = {"f_u": k[0, 0], "f_v": k[1, 1], "c_u": k[0, 2], "c_v": k[1, 2]}
    beam = "[LiDARCalibrationComponent].beam_inclination"
    box = "[LiDARBoxComponent]"
    rows = [(i, *pair) for i, v in enumerate(street.vehicles) for pair in street.local_boxes(v)]
    own = "[CameraImageComponent]"
    matrices = pa.array([v.ravel().tolist() for v in street.vehicles], fixed)
    tables: dict[str, dict[str, Any]] = {
        "vehicle_pose": {
            "key.frame_timestamp_micros": stamps,
            "[VehiclePoseComponent].world_from_vehicle.transform": matrices,
        },
        "camera_image": {
            "key.frame_timestamp_micros": stamps,
            "key.camera_name": pa.array([1] * street.count, pa.int8()),
            f"{own}.image": [_encoded(image) for image in street.images],
            f"{own}.pose.transform": matrices,
            f"{own}.pose_timestamp": [s / 1e6 for s in stamps],
        },
        "camera_calibration": {
            "key.camera_name": pa.array([1], pa.int8()),
            **{f"{lens}.intrinsic.{n}": [v] for n, v in numbers.items()},
            **{f"{lens}.intrinsic.{n}": [0.0] for n in ("k1", "k2", "p1", "p2", "k3")},
            f"{lens}.extrinsic.transform": pa.array([extrinsic.ravel().tolist()], fixed),
            f"{lens}.width": pa.array([street.size[0]], pa.int32()),
            f"{lens}.height": pa.array([street.size[1]], pa.int32()),
        },
        "lidar": {
            "key.frame_timestamp_micros": stamps,
            **_return_columns("LiDARComponent", images),
        },
        "lidar_calibration": {
            "key.laser_name": pa.array([1], pa.int8()),
            "[LiDARCalibrationComponent].extrinsic.transform": pa.array([TOP.ravel().tolist()], fixed),
            f"{beam}.min": [float(beams[0])],
            f"{beam}.max": [float(beams[-1])],
            f"{beam}.values": pa.array([beams.tolist()], pa.list_(pa.float64())),
        },
        "lidar_pose": {
            "key.frame_timestamp_micros": stamps,
            **_return_columns("LiDARPoseComponent", motions),
        },
        "lidar_box": {
            "key.frame_timestamp_micros": [stamps[i] for i, *_ in rows],
            "key.laser_object_id": [f"object-{b.id}" for _, b, _ in rows],
            f"{box}.type": pa.array([BOX_TYPES[b.class_name] for _, b, _ in rows], pa.int8()),
            **{f"{box}.box.center.{a}": [float(p[j, 3]) for *_, p in rows] for j, a in enumerate("xyz")},
            **{f"{box}.box.size.{a}": [b.size[j] for _, b, _ in rows] for j, a in enumerate("xyz")},
            f"{box}.box.heading": [float(np.arctan2(p[1, 0], p[0, 0])) for *_, p in rows],
        },
    }
    for component, columns in tables.items():
        columns["key.segment_context_name"] = [NAME] * len(next(iter(columns.values())))
        path = root / component / f"{NAME}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(pa.table(columns), path, row_group_size=2)
    return root


def write_neuralsim(root: Path, street: Street) -> Path:
    """A segment with masks of trainIds, as a network would have made them."""
    folder, n = root / f"segment-{NAME}_with_camera_labels", street.count
    times = START_S + street.times
    offset = street.vehicles[0][:3, 3]
    local = street.moved(np.eye(3), -offset)
    frames = {"timestamp": times, "global_frame_ind": np.arange(n)}
    camera = {
        "hw": np.tile(street.size[::-1], (n, 1)),
        "intr": np.tile(street.calibration(from_first_centre=False), (n, 1, 1)),
        "distortion": np.zeros((n, 5)),
        "c2w": local.poses,
        **frames,
    }
    observers = {
        "ego_car": {"class_name": "EgoVehicle", "n_frames": n, "data": {"v2w": local.vehicles, **frames}},
        "camera_FRONT": {"class_name": "Camera", "n_frames": n, "data": camera},
        "lidar_TOP": {"class_name": "RaysLidar", "n_frames": n, "data": {"l2w": local.vehicles @ TOP, **frames}},
    }
    objects = {}
    for box in local.boxes:
        pose = rigid(turned_about_z(box.yaw), box.centre)
        data = {"transform": np.tile(pose, (n, 1, 1)), "scale": np.tile(box.size, (n, 1)), **frames}
        segments = [{"start_frame": 0, "n_frames": n, "data": data}]
        name = f"object-{box.id}"
        objects[name] = {"id": name, "class_name": _class_name(box.class_name), "segments": segments}
    metas = {"world_offset": offset, "n_frames": n}
    content = {"scene_id": NAME, "metas": metas, "objects": objects, "observers": observers}
    folder.mkdir(parents=True)
    (folder / "scenario.pt").write_bytes(pickle.dumps(content, protocol=4))
    for i in range(n):
        saved(folder / f"images/camera_FRONT/{i:08d}.jpg", street.images[i])
        points = transformed(np.linalg.inv(local.vehicles[i] @ TOP), local.sweep(i)[0])
        ranges = np.linalg.norm(points, axis=1)
        rays = {"rays_o": np.zeros_like(points), "rays_d": points / ranges[:, None], "ranges": ranges}
        for place, arrays in (
            ("lidars/lidar_TOP", {k: v.astype(np.float32) for k, v in rays.items()}),
            ("masks/camera_FRONT", {"arr_0": street.semantics[i]}),
        ):
            (folder / place).mkdir(parents=True, exist_ok=True)
            np.savez_compressed(folder / place / f"{i:08d}.npz", **arrays)  # type: ignore[arg-type]
    return root


def _matrix(path: Path, values: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, values)


def _lens(street: Street) -> list[float]:
    return [street.focal, street.focal, *street.centre, 0.0, 0.0, 0.0, 0.0, 0.0]


def write_drivestudio(root: Path, street: Street) -> Path:
    """A scene made of Waymo: cameras with its axes, points of 14 columns."""
    folder = root / "000"
    _matrix(folder / "extrinsics/0.txt", street.vehicle_from_camera @ rigid(OPENCV_FROM_WAYMO, (0, 0, 0)))
    _matrix(folder / "intrinsics/0.txt", _lens(street))
    (folder / "lidar").mkdir()
    generator = np.random.default_rng(0)
    for i, vehicle in enumerate(street.vehicles):
        saved(folder / f"images/{i:03d}_0.jpg", street.images[i])
        _matrix(folder / f"ego_pose/{i:03d}.txt", vehicle)
        points = transformed(np.linalg.inv(vehicle), street.sweep(i)[0])
        rows = np.zeros((len(points), 14), "<f4")
        rows[:, :3], rows[:, 3:6], rows[:, 10] = TOP[:3, 3], points, 1
        rows[:, 11], rows[:, 12] = generator.uniform(0, 200, len(points)), generator.uniform(0, 1.5, len(points))
        rows.tofile(folder / f"lidar/{i:03d}.bin")
    entries = {}
    for k, box in enumerate(street.boxes):
        pose = rigid(turned_about_z(box.yaw), box.centre).tolist()
        annotations = {
            "frame_idx": list(range(street.count)),
            "obj_to_world": [pose] * street.count,
            "box_size": [list(box.size)] * street.count,
        }
        kind = _class_name(box.class_name)
        entries[str(k)] = {"id": f"object-{box.id}", "class_name": kind, "frame_annotations": annotations}
    (folder / "instances").mkdir()
    (folder / "instances/instances_info.json").write_text(json.dumps(entries))
    return root


def write_street_gaussians(root: Path, street: Street) -> Path:
    """A segment with tracks, and the points of all frames in one archive."""
    folder = root / "segment"
    _matrix(folder / "extrinsics/0.txt", street.vehicle_from_camera)
    _matrix(folder / "intrinsics/0.txt", _lens(street))
    lines = ["frame_id track_id object_class alpha box_height box_width box_length cx cy cz heading speed"]
    points = {}
    for i, vehicle in enumerate(street.vehicles):
        saved(folder / f"images/{i:06d}_0.png", street.images[i])
        for name in (f"{i:06d}", f"{i:06d}_0"):
            _matrix(folder / f"ego_pose/{name}.txt", vehicle)
        points[i] = transformed(np.linalg.inv(vehicle), street.sweep(i)[0]).astype(np.float32)
        for box, pose in street.local_boxes(vehicle):
            (x, y, z), (length, width, height) = pose[:3, 3], box.size
            yaw = np.arctan2(pose[1, 0], pose[0, 0])
            kind = _class_name(box.class_name).lower()
            lines.append(f"{i} {box.id} {kind} -10 {height} {width} {length} {x} {y} {z} {yaw} 0.0")
    (folder / "track").mkdir()
    (folder / "track/track_info.txt").write_text("\n".join(lines) + "\n")
    stamps = {n: {f"{i:06d}": START_S + t for i, t in enumerate(street.times)} for n in ("FRAME", "FRONT")}
    (folder / "timestamps.json").write_text(json.dumps(stamps))
    seen = {i: np.zeros((len(p), 6), np.int16) for i, p in points.items()}
    np.savez_compressed(folder / "pointcloud.npz", pointcloud=points, camera_projection=seen)  # type: ignore[arg-type]
    return root
