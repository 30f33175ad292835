"""A Waymo segment of a few small frames, written in the columns of the release, and its scene by formulas of their own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet
from scipy.spatial.transform import Rotation

NAME = "10023947602400723454_1120_000_1140_000"
STAMPS = [1_552_440_195_362_591 + 100_022 * i for i in range(3)]
SIZE = (96, 64)
BEAMS = [-0.3, -0.21, -0.1, -0.02]
LASERS = (1, 3)
CAMERAS = (1, 2)


def rigid(angles: Sequence[float], position: Sequence[float]) -> NDArray[np.float64]:
    """Roll, pitch and yaw about fixed axes, radians, then the shift."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
    pose[:3, 3] = position
    return pose


def vehicle(i: float) -> NDArray[np.float64]:
    """World from vehicle at frame i, or between two."""
    return rigid((0.01, -0.02, 2.0 + 0.02 * i), (860.25 + 1.5 * i, 15568.5 - 0.5 * i, -651.0))


def camera_extrinsic(camera: int) -> NDArray[np.float64]:
    return rigid((0.002, 0.01, 0.0 if camera == 1 else 0.8), (1.5, 0.1 * camera, 2.1))


def intrinsics(camera: int) -> dict[str, float]:
    numbers = (80.0 + camera, 81.0, 47.3, 31.9, 0.05, -0.02, 0.001, -0.002, 0.003)
    return dict(zip(("f_u", "f_v", "c_u", "c_v", "k1", "k2", "p1", "p2", "k3"), numbers, strict=True))


def pixel(point: NDArray[np.float64], frame: float, camera: int) -> NDArray[np.float64]:
    """(2,) of a world point by Waymo's camera model: the optical axis is x, pixels count from the first one's edge."""
    x, y, z, _ = np.linalg.inv(vehicle(frame) @ camera_extrinsic(camera)) @ [*point, 1.0]
    u, v, k = -y / x, -z / x, intrinsics(camera)
    r = u * u + v * v
    radial = 1 + k["k1"] * r + k["k2"] * r**2 + k["k3"] * r**3
    u_bent = u * radial + 2 * k["p1"] * u * v + k["p2"] * (r + 2 * u * u)
    v_bent = v * radial + k["p1"] * (r + 2 * v * v) + 2 * k["p2"] * u * v
    return np.array([u_bent * k["f_u"] + k["c_u"], v_bent * k["f_v"] + k["c_v"]])


def laser_extrinsic(laser: int) -> NDArray[np.float64]:
    return rigid((0.0, 0.01, 2.6 if laser == 1 else 1.5), (1.4, 0.0, 2.2))


def ranges(i: int, laser: int, part: int) -> NDArray[np.float32]:
    """(H, W, 4) range image of a return; most of the second is empty."""
    generator = np.random.default_rng([i, laser, part])
    image = generator.uniform(3, 60, (len(BEAMS) if laser == 1 else 3, 12, 4)).astype(np.float32)
    image[generator.random(image.shape[:2]) < (0.2 if part == 1 else 0.8), 0] = -1 if part == 1 else 0
    return image


def motion(i: int) -> NDArray[np.float32]:
    """(H, W, 6) poses of the pixels of the top LiDAR: it turns while the vehicle goes a tenth of a second."""
    image = np.zeros((len(BEAMS), 12, 6))
    for column in range(12):
        pose = vehicle(i - 0.5 + column / 12)
        image[:, column, :3] = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz")
        image[:, column, 3:] = pose[:3, 3]
    return image.astype(np.float32)


def points(i: int) -> list[NDArray[np.float64]]:
    """World points of frame i, one pixel after the other, of both LiDARs and returns in the order of the reader."""
    found = []
    for laser in LASERS:
        beams = BEAMS if laser == 1 else [-1.2 + 1.4 * (k + 0.5) / 3 for k in range(3)]
        extrinsic, poses = laser_extrinsic(laser), motion(i).astype(np.float64)
        turned = np.arctan2(extrinsic[1, 0], extrinsic[0, 0])
        for part in (1, 2):
            image = ranges(i, laser, part)
            for row, column in np.argwhere(image[..., 0] > 0):
                up = beams[len(beams) - 1 - row]
                around = np.pi - 2 * np.pi * (column + 0.5) / 12 - turned
                ray = np.array([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)])
                there = extrinsic @ [*(float(image[row, column, 0]) * ray), 1.0]
                pose = rigid(poses[row, column, :3], poses[row, column, 3:]) if laser == 1 else vehicle(i)
                found.append((pose @ there)[:3])
    return found


def photograph(i: int, camera: int) -> bytes:
    """A JPEG whose grey tells which it is."""
    return cv2.imencode(".jpg", np.full((SIZE[1], SIZE[0], 3), 40 * i + 10 * camera, np.uint8))[1].tobytes()


def panoptic() -> NDArray[np.uint16]:
    """The ego vehicle below, two cars on a road, and a bird, which has no class."""
    image = np.full(SIZE[::-1], 20_000, np.uint16)
    image[50:] = 1_000
    image[10:20, 10:20], image[10:20, 30:40] = 2_007, 2_009
    image[:5, :5] = 12_003
    return image


def tables() -> dict[str, dict[str, Any]]:
    """All tables by component, as columns of plain lists or of arrays with the types of the release."""
    fixed = pa.list_(pa.float64(), 16)
    shape = pa.list_(pa.int32(), 3)
    frames, n = range(len(STAMPS)), len(STAMPS)
    images = [(i, c) for i in frames for c in CAMERAS]
    sweeps = [(i, k) for i in frames for k in LASERS]
    own = "[CameraImageComponent]"
    lens = "[CameraCalibrationComponent]"
    box = "[LiDARBoxComponent]"
    beam = "[LiDARCalibrationComponent].beam_inclination"
    mapping = "[CameraSegmentationLabelComponent].instance_id_to_global_id_mapping"
    found: dict[str, dict[str, Any]] = {
        "vehicle_pose": {
            "key.frame_timestamp_micros": STAMPS,
            "[VehiclePoseComponent].world_from_vehicle.transform": pa.array(
                [vehicle(i).ravel().tolist() for i in frames], fixed
            ),
        },
        "camera_image": {
            "key.frame_timestamp_micros": [STAMPS[i] for i, _ in images],
            "key.camera_name": pa.array([c for _, c in images], pa.int8()),
            f"{own}.image": [photograph(i, c) for i, c in images],
            # Each camera is released at a time of its own.
            f"{own}.pose.transform": pa.array([vehicle(i + 0.1 * c).ravel().tolist() for i, c in images], fixed),
            f"{own}.pose_timestamp": [STAMPS[i] / 1e6 + 0.01 * c for i, c in images],
        },
        "camera_calibration": {
            "key.camera_name": pa.array(CAMERAS, pa.int8()),
            **{f"{lens}.intrinsic.{k}": [intrinsics(c)[k] for c in CAMERAS] for k in intrinsics(1)},
            f"{lens}.extrinsic.transform": pa.array([camera_extrinsic(c).ravel().tolist() for c in CAMERAS], fixed),
            f"{lens}.width": pa.array([SIZE[0]] * 2, pa.int32()),
            f"{lens}.height": pa.array([SIZE[1]] * 2, pa.int32()),
            f"{lens}.rolling_shutter_direction": pa.array([2, 2], pa.int8()),
        },
        "camera_segmentation": {
            "key.frame_timestamp_micros": [STAMPS[1], STAMPS[2]],
            "key.camera_name": pa.array([1, 1], pa.int8()),
            "[CameraSegmentationLabelComponent].panoptic_label_divisor": pa.array([1000] * 2, pa.int32()),
            "[CameraSegmentationLabelComponent].panoptic_label": [cv2.imencode(".png", panoptic())[1].tobytes()] * 2,
            # The second object is another one in the second photograph.
            f"{mapping}.local_instance_ids": pa.array([[7, 9, 3], [7, 9]], pa.list_(pa.int32())),
            f"{mapping}.global_instance_ids": pa.array([[70_000, 5, 6], [70_000, 8]], pa.list_(pa.int32())),
            "[CameraSegmentationLabelComponent].sequence_id": ["s", "s"],
        },
        "lidar": {
            "key.frame_timestamp_micros": [STAMPS[i] for i, _ in sweeps],
            "key.laser_name": pa.array([k for _, k in sweeps], pa.int8()),
        },
        "lidar_calibration": {
            "key.laser_name": pa.array(LASERS, pa.int8()),
            "[LiDARCalibrationComponent].extrinsic.transform": pa.array(
                [laser_extrinsic(k).ravel().tolist() for k in LASERS], fixed
            ),
            f"{beam}.min": [-9.0, -1.2],
            f"{beam}.max": [9.0, 0.2],
            f"{beam}.values": pa.array([BEAMS, None], pa.list_(pa.float64())),
        },
        "lidar_pose": {
            "key.frame_timestamp_micros": STAMPS,
            "key.laser_name": pa.array([1] * n, pa.int8()),
            "[LiDARPoseComponent].range_image_return1.values": pa.array(
                [motion(i).ravel() for i in frames], pa.list_(pa.float32())
            ),
            "[LiDARPoseComponent].range_image_return1.shape": pa.array([motion(i).shape for i in frames], shape),
        },
        "lidar_box": {
            "key.frame_timestamp_micros": [STAMPS[0], STAMPS[0], STAMPS[0], STAMPS[1]],
            "key.laser_object_id": ["sign", "walker", "parked", "parked"],
            f"{box}.type": pa.array([3, 2, 1, 1], pa.int8()),
            **{f"{box}.box.center.{a}": [4.0, 5.0, 12.0 + k, 10.5 + k] for k, a in enumerate("xyz")},
            **{f"{box}.box.size.{a}": [0.5, 0.8, 4.5 - k, 4.5 - k] for k, a in enumerate("xyz")},
            f"{box}.box.heading": [0.0, 0.0, 0.3, 0.28],
            f"{box}.speed.x": [None, 0.1, 0.0, 0.0],
        },
        "lidar_segmentation": {
            "key.frame_timestamp_micros": [STAMPS[1]],
            "key.laser_name": pa.array([1], pa.int8()),
        },
    }
    for part in (1, 2):
        column = f"range_image_return{part}"
        values = [ranges(i, k, part) for i, k in sweeps]
        found["lidar"][f"[LiDARComponent].{column}.values"] = pa.array(
            [v.ravel() for v in values], pa.list_(pa.float32())
        )
        found["lidar"][f"[LiDARComponent].{column}.shape"] = pa.array([v.shape for v in values], shape)
        kinds = np.zeros((len(BEAMS), 12, 2), np.int32)
        kinds[..., 0], kinds[..., 1] = 99, 18 if part == 1 else 1
        prefix = f"[LiDARSegmentationLabelComponent].{column}"
        found["lidar_segmentation"][f"{prefix}.values"] = pa.array([kinds.ravel()], pa.list_(pa.int32()))
        found["lidar_segmentation"][f"{prefix}.shape"] = pa.array([kinds.shape], shape)
    for columns in found.values():
        count = len(next(iter(columns.values())))
        columns["key.segment_context_name"] = [NAME] * count
        columns["index"] = [f"{NAME};{i}" for i in range(count)]
    return found


def write(root: Path, content: dict[str, dict[str, Any]], *, shuffled: bool = False) -> Path:
    """Write tables under a folder, in small row groups, and give it back."""
    for number, (component, columns) in enumerate(content.items()):
        table = pa.table(columns)
        if shuffled:
            table = table.take(np.random.default_rng(number).permutation(table.num_rows))
        (root / component).mkdir(parents=True, exist_ok=True)
        parquet.write_table(table, root / component / f"{NAME}.parquet", row_group_size=4)
    return root
