"""A tiny nuScenes in the released encoding: two scenes of three samples, two cameras, the LiDAR and a radar.

The global frame is far from the origin; the vehicle drives 4 m a second along a direction of its own and yaws. The points are made
from a global truth with this module's own quaternions, so that reading them can be compared with it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ORIGIN = np.array([600.0, 1600.0, 0.0])
WIDTH, HEIGHT = 64, 36
K = [[50.0, 0.0, 31.2], [0.0, 51.0, 17.6], [0.0, 0.0, 1.0]]
START_US = 1_532_402_927_612_460
CATEGORIES = [
    "noise",
    "vehicle.car",
    "flat.driveable_surface",
    "vehicle.ego",
    "static.manmade",
    "movable_object.trafficcone",
]
CAMERA_ROTATION = {"CAM_FRONT": np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
                   "CAM_BACK": np.array([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]])}  # fmt: skip
SENSOR_AT = {"CAM_FRONT": [1.7, 0.02, 1.5], "CAM_BACK": [0.03, 0.0, 1.57], "LIDAR_TOP": [0.94, 0.0, 1.84],
             "RADAR_FRONT": [3.4, 0.0, 0.5]}  # fmt: skip


def turn(yaw: float, pitch: float = 0.0) -> np.ndarray:
    c, s, d, e = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) @ np.array([[d, 0, e], [0, 1, 0], [-e, 0, d]])


def quaternion(rotation: np.ndarray) -> list[float]:
    """wxyz, by the rotation's axis and angle."""
    axis, _ = cv2.Rodrigues(rotation)
    angle = float(np.linalg.norm(axis))
    unit = axis.ravel() / angle if angle else np.zeros(3)
    return [float(np.cos(angle / 2)), *(float(v) for v in unit * np.sin(angle / 2))]


def ego_pose(time_us: int) -> np.ndarray:
    t = (time_us - START_US) / 1e6
    pose = np.eye(4)
    pose[:3, :3] = turn(0.7 + 0.1 * t, 0.01)
    pose[:3, 3] = ORIGIN + 4.0 * t * np.array([np.cos(0.7), np.sin(0.7), 0.0])
    return pose


def ego_from_sensor(channel: str) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = CAMERA_ROTATION.get(channel, turn(-np.pi / 2))
    pose[:3, 3] = SENSOR_AT[channel]
    return pose


def global_points() -> np.ndarray:
    """(40, 3) of the street about the first pose, none near the vehicle."""
    generator = np.random.default_rng(3)
    ahead = generator.uniform((8, -6, 0), (30, 6, 4), (40, 3))
    return ahead @ turn(0.7).T + ORIGIN


OWN_IN_EGO = np.array([[2.5, 0.5, 0.9], [0.94, 0.3, 1.8], [-0.6, -0.8, 0.7]])
"""Points on the vehicle itself, in its axes."""


def car_centre(time_us: int) -> np.ndarray:
    """Of a car that drives ahead at 8 m/s."""
    return ORIGIN + turn(0.7) @ np.array([10 + 8 * (time_us - START_US) / 1e6, 2.0, 0.8])


def make_nuscenes(root: Path, *, version: str = "v1.0-mini", lidarseg: bool = True, indent: int | None = 0) -> Path:
    """Write the dataset; returns its root."""
    tables: dict[str, list[dict[str, Any]]] = {
        name: [] for name in ("scene", "sample", "sample_data", "ego_pose", "sample_annotation", "instance", "lidarseg")
    }
    tables["sensor"] = [{"token": f"s-{c}", "channel": c, "modality": "x"} for c in SENSOR_AT]
    tables["calibrated_sensor"] = [
        {
            "token": f"c-{c}",
            "sensor_token": f"s-{c}",
            "translation": ego_from_sensor(c)[:3, 3].tolist(),
            "rotation": quaternion(ego_from_sensor(c)[:3, :3]),
            "camera_intrinsic": K if c.startswith("CAM") else [],
        }
        for c in SENSOR_AT
    ]
    tables["category"] = [
        {"token": f"k-{i}", "name": name, "description": '}, { "x"', **({"index": i} if lidarseg else {})}
        for i, name in enumerate(CATEGORIES)
    ]
    for name in ("attribute", "log", "map", "visibility"):
        tables[name] = []
    for scene in ("scene-0061", "scene-0103"):
        _scene(root, version, scene, tables, lidarseg)
    folder = root / version
    folder.mkdir(parents=True, exist_ok=True)
    for name, rows in tables.items():
        if name != "lidarseg" or lidarseg:
            (folder / f"{name}.json").write_text(json.dumps(rows, indent=indent))
    return root


def _scene(root: Path, version: str, scene: str, tables: dict[str, list[dict[str, Any]]], lidarseg: bool) -> None:
    samples = [f"{scene}-sample{i}" for i in range(3)]
    tables["scene"].append({"token": f"{scene}-t", "name": scene, "nbr_samples": 3, "description": 'a "{" in it'})
    for i, token in enumerate(samples):
        time = START_US + 500_000 * i
        tables["sample"].append({"token": token, "timestamp": time, "scene_token": f"{scene}-t"})
        for instance, category, yaw in (("moving", 1, 0.7), ("cone", 5, 0.0)):
            centre = car_centre(time) if instance == "moving" else ORIGIN + 3.0
            row = {
                "token": f"{token}-{instance}",
                "sample_token": token,
                "instance_token": f"{scene}-{instance}",
                "translation": centre.tolist(),
                "size": [1.9, 4.6, 1.7],
                "rotation": quaternion(turn(yaw)),
            }
            tables["sample_annotation"].append(row)
            if i == 0:
                tables["instance"].append({"token": f"{scene}-{instance}", "category_token": f"k-{category}"})
    for channel, offsets in (("CAM_FRONT", 10_000), ("CAM_BACK", 35_000), ("LIDAR_TOP", 0), ("RADAR_FRONT", 5_000)):
        for i in range(5):
            _file(
                root,
                version,
                scene,
                samples[i // 2],
                channel,
                START_US + 250_000 * i + offsets,
                i % 2 == 0,
                tables,
                lidarseg,
            )


def _file(
    root: Path, version: str, scene: str, sample: str, channel: str, time: int, key: bool,
    tables: dict[str, list[dict[str, Any]]], lidarseg: bool,
) -> None:  # fmt: skip
    ending = {"L": "pcd.bin", "R": "pcd", "C": "jpg"}[channel[0]]
    place = f"{'samples' if key else 'sweeps'}/{channel}/{scene}__{channel}__{time}.{ending}"
    token, pose = f"{scene}-{channel}-{time}", ego_pose(time)
    tables["ego_pose"].append(
        {
            "token": f"e-{token}",
            "translation": pose[:3, 3].tolist(),
            "rotation": quaternion(pose[:3, :3]),
            "timestamp": time,
        }
    )
    is_camera = channel.startswith("CAM")
    tables["sample_data"].append(
        {
            "token": token,
            "sample_token": sample,
            "ego_pose_token": f"e-{token}",
            "calibrated_sensor_token": f"c-{channel}",
            "filename": place,
            "timestamp": time,
            "is_key_frame": key,
            "width": WIDTH if is_camera else 0,
            "height": HEIGHT if is_camera else 0,
        }
    )
    path = root / place
    path.parent.mkdir(parents=True, exist_ok=True)
    if is_camera:
        cv2.imwrite(str(path), np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
    elif channel == "LIDAR_TOP":
        to_lidar = np.linalg.inv(pose @ ego_from_sensor(channel))
        street = global_points() @ to_lidar[:3, :3].T + to_lidar[:3, 3]
        back = np.linalg.inv(ego_from_sensor(channel))
        own = OWN_IN_EGO @ back[:3, :3].T + back[:3, 3]
        rows = np.zeros((len(street) + len(own), 5), "<f4")
        rows[:, :3] = np.concatenate([street, own])
        rows[:, 3], rows[:, 4] = 17, np.arange(len(rows)) % 32
        rows.tofile(path)
        if key and lidarseg:
            numbers = np.full(len(rows), 2, np.uint8)
            numbers[:4] = (1, 4, 0, 5)
            numbers[len(street) :] = 3
            label = f"lidarseg/{version}/{token}_lidarseg.bin"
            (root / label).parent.mkdir(parents=True, exist_ok=True)
            numbers.tofile(root / label)
            tables["lidarseg"].append({"token": token, "sample_data_token": token, "filename": label})
