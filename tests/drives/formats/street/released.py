"""The street as PandaSet, nuScenes and Argoverse 2 are released: photographs, sweeps and boxes in tables of their own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import feather

from tests.drives.formats.pandas_pickles import table_pickle
from tests.drives.formats.street.street import Array, Street, rigid, saved, transformed, turned_about_z
from unveil_core.geometry.transforms import rotation_to_quat

__all__ = ["write_argoverse2", "write_nuscenes", "write_pandaset"]

PANDA_NAMES = {"car": "Car", "truck": "Semi-truck", "person": "Pedestrian", "bicycle": "Bicycle"}
PANDA_POINTS = {0: 7, 1: 11, 2: 41, 4: 35, 5: 42, 7: 36, 8: 5, 9: 6, 11: 30, 13: 13, 14: 16, 17: 18, 18: 26}
NUSCENES_NAMES = {
    "car": "vehicle.car", "truck": "vehicle.truck", "person": "human.pedestrian.adult", "bicycle": "vehicle.bicycle",
}  # fmt: skip
NUSCENES_POINTS = {
    0: "flat.driveable_surface", 1: "flat.sidewalk", 2: "static.manmade", 4: "movable_object.barrier",
    5: "static.manmade", 7: "static.manmade", 8: "static.vegetation", 9: "flat.terrain", 11: "human.pedestrian.adult",
    13: "vehicle.car", 14: "vehicle.truck", 18: "vehicle.bicycle",
}  # fmt: skip
UNKNOWN = "movable_object.debris"
"""Of nuScenes' categories, one that has no class of Cityscapes."""
ARGOVERSE_NAMES = {"car": "REGULAR_VEHICLE", "truck": "TRUCK", "person": "PEDESTRIAN", "bicycle": "BICYCLE"}
START_S = 1_557_540_000
LIDAR = rigid(turned_about_z(-np.pi / 2), (0.94, 0.0, 1.84))
"""nuScenes' LiDAR on the vehicle: its x is to the right."""


def _wxyz(pose: Array) -> list[float]:
    return [float(v) for v in rotation_to_quat(pose[:3, :3])]


def _json(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def write_pandaset(root: Path, street: Street) -> Path:
    """Sequence 002, its world at the first pose of the LiDAR, with labelled points; a pose's x is to the right there."""
    folder = root / "002"
    lidar = street.vehicles @ rigid(turned_about_z(-np.pi / 2), (0, 0, 0))
    street = street.moved(np.eye(3), -lidar[0][:3, 3])
    lidar = street.vehicles @ rigid(turned_about_z(-np.pi / 2), (0, 0, 0))

    def listed(poses: Array) -> list[dict[str, dict[str, float]]]:
        return [
            {
                "position": dict(zip("xyz", p[:3, 3].tolist(), strict=True)),
                "heading": dict(zip("wxyz", _wxyz(p), strict=True)),
            }
            for p in poses
        ]

    for place, poses in (("camera/front_camera", street.poses), ("lidar", lidar)):
        _json(folder / place / "poses.json", listed(poses))
        _json(folder / place / "timestamps.json", (START_S + street.times).tolist())
    k = street.calibration()
    intrinsics = {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]}
    _json(folder / "camera/front_camera/intrinsics.json", intrinsics)
    for part in ("cuboids", "semseg"):
        (folder / "annotations" / part).mkdir(parents=True)
    boxes = street.boxes
    for i in range(street.count):
        saved(folder / f"camera/front_camera/{i:02d}.jpg", street.images[i])
        points, kinds = street.sweep(i)
        columns = {a: points[:, j].copy() for j, a in enumerate("xyz")}
        columns |= {"i": np.full(len(points), 20.0), "t": np.full(len(points), START_S + street.times[i])}
        columns |= {"d": np.zeros(len(points), np.int64)}
        (folder / f"lidar/{i:02d}.pkl").write_bytes(table_pickle(columns))
        numbers = np.array([PANDA_POINTS.get(int(c), 0) for c in kinds], np.int64)
        (folder / f"annotations/semseg/{i:02d}.pkl").write_bytes(table_pickle({"class": numbers}))
        sizes = [(b.size[1], b.size[0], b.size[2]) for b in boxes]  # width, length, height
        cuboids = {
            "uuid": np.array([f"object-{b.id}" for b in boxes], object),
            "label": np.array([PANDA_NAMES[b.class_name] for b in boxes], object),
            "yaw": np.array([b.yaw - np.pi / 2 for b in boxes]),
            "stationary": np.ones(len(boxes), bool),
            **{f"position.{a}": np.array([b.centre[j] for b in boxes]) for j, a in enumerate("xyz")},
            **{f"dimensions.{a}": np.array([s[j] for s in sizes]) for j, a in enumerate("xyz")},
            "cuboids.sibling_id": np.array(["-"] * len(boxes), object),
        }
        (folder / f"annotations/cuboids/{i:02d}.pkl").write_bytes(table_pickle(cuboids))
    return root


def write_nuscenes(root: Path, street: Street) -> Path:
    """One scene of v1.0-mini, each frame annotated, with lidarseg."""
    names = sorted({*NUSCENES_NAMES.values(), *NUSCENES_POINTS.values()})
    categories = ["noise", UNKNOWN, *names]
    mounted = {"CAM_FRONT": street.vehicle_from_camera, "LIDAR_TOP": LIDAR}
    rows: dict[str, list[dict[str, Any]]] = {n: [] for n in ("attribute", "log", "map", "visibility")}
    rows["scene"] = [{"token": "scene", "name": "scene-0061", "nbr_samples": street.count}]
    rows["sensor"] = [{"token": f"s-{c}", "channel": c, "modality": "x"} for c in mounted]
    rows["calibrated_sensor"] = [
        {
            "token": f"c-{c}", "sensor_token": f"s-{c}", "translation": pose[:3, 3].tolist(), "rotation": _wxyz(pose),
            "camera_intrinsic": street.calibration().tolist() if c == "CAM_FRONT" else [],
        }
        for c, pose in mounted.items()
    ]  # fmt: skip
    rows["category"] = [{"token": f"k-{i}", "name": n, "index": i} for i, n in enumerate(categories)]
    rows["instance"] = [
        {"token": f"o-{b.id}", "category_token": f"k-{categories.index(NUSCENES_NAMES[b.class_name])}"}
        for b in street.boxes
    ]
    for table in ("sample", "sample_data", "ego_pose", "sample_annotation", "lidarseg"):
        rows[table] = []
    for i, vehicle in enumerate(street.vehicles):
        time = round((START_S + street.times[i]) * 1e6)
        rows["sample"].append({"token": f"m-{i}", "timestamp": time, "scene_token": "scene"})
        pose = {"token": f"e-{i}", "translation": vehicle[:3, 3].tolist(), "rotation": _wxyz(vehicle)}
        rows["ego_pose"].append({**pose, "timestamp": time})
        for box in street.boxes:
            length, width, height = box.size
            turn = _wxyz(rigid(turned_about_z(box.yaw), (0, 0, 0)))
            row = {"token": f"a-{i}-{box.id}", "sample_token": f"m-{i}", "instance_token": f"o-{box.id}"}
            row |= {"translation": list(box.centre), "size": [width, length, height], "rotation": turn}
            rows["sample_annotation"].append(row)
        for channel in mounted:
            is_camera = channel == "CAM_FRONT"
            place = f"samples/{channel}/n015__{channel}__{time}.{'jpg' if is_camera else 'pcd.bin'}"
            width, height = street.size if is_camera else (0, 0)
            row = {"token": f"d-{channel}-{i}", "sample_token": f"m-{i}", "ego_pose_token": f"e-{i}"}
            row |= {"calibrated_sensor_token": f"c-{channel}", "filename": place, "timestamp": time}
            rows["sample_data"].append({**row, "is_key_frame": True, "width": width, "height": height})
            if is_camera:
                saved(root / place, street.images[i])
                continue
            points, kinds = street.sweep(i)
            values = np.zeros((len(points), 5), "<f4")
            values[:, :3], values[:, 3] = transformed(np.linalg.inv(vehicle @ LIDAR), points), 17
            labels = root / f"lidarseg/v1.0-mini/d-{channel}-{i}_lidarseg.bin"
            for path in (root / place, labels):
                path.parent.mkdir(parents=True, exist_ok=True)
            values.tofile(root / place)
            numbers = [categories.index(NUSCENES_POINTS.get(int(c), UNKNOWN)) for c in kinds]
            np.array(numbers, np.uint8).tofile(labels)
            label = {"token": row["token"], "sample_data_token": row["token"]}
            rows["lidarseg"].append({**label, "filename": labels.relative_to(root).as_posix()})
    for table, content in rows.items():
        _json(root / f"v1.0-mini/{table}.json", content)
    return root


def write_argoverse2(root: Path, street: Street) -> Path:
    """A log in the split "val"; photographs and sweeps of one moment have one stamp. Points are half floats, as released."""
    folder, camera = root / "val/7fab2350-7eaf-3b7e-a39d-6937a4c1bede", "ring_front_center"
    stamps = [round((START_S + t) * 1e9) for t in street.times]

    def se3(poses: list[Array]) -> dict[str, list[float]]:
        values = np.array([[*_wxyz(p), *p[:3, 3]] for p in poses])
        return dict(zip(("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m"), values.T.tolist(), strict=True))

    k = street.calibration()
    boxes = [(s, *pair) for s, v in zip(stamps, street.vehicles, strict=True) for pair in street.local_boxes(v)]
    tables: dict[str, dict[str, Any]] = {
        "city_SE3_egovehicle": {"timestamp_ns": stamps, **se3(list(street.vehicles))},
        "calibration/egovehicle_SE3_sensor": {
            "sensor_name": [camera, "up_lidar"],
            **se3([street.vehicle_from_camera, rigid(np.eye(3), (1.35, 0, 1.64))]),
        },
        "calibration/intrinsics": {
            "sensor_name": [camera],
            **{f"{n}_px": [float(k[at])] for n, at in (("fx", (0, 0)), ("fy", (1, 1)), ("cx", (0, 2)), ("cy", (1, 2)))},
            **{n: [0.0] for n in ("k1", "k2", "k3")},
            "height_px": pa.array([street.size[1]], pa.uint16()),
            "width_px": pa.array([street.size[0]], pa.uint16()),
        },
        "annotations": {
            "timestamp_ns": [s for s, *_ in boxes],
            "track_uuid": [f"object-{b.id}" for _, b, _ in boxes],
            "category": [ARGOVERSE_NAMES[b.class_name] for _, b, _ in boxes],
            **{n: [b.size[j] for _, b, _ in boxes] for j, n in enumerate(("length_m", "width_m", "height_m"))},
            **se3([p for *_, p in boxes]),
            "num_interior_pts": [9] * len(boxes),
        },
    }
    for i, stamp in enumerate(stamps):
        saved(folder / f"sensors/cameras/{camera}/{stamp}.jpg", street.images[i])
        points = transformed(np.linalg.inv(street.vehicles[i]), street.sweep(i)[0]).astype(np.float16)
        tables[f"sensors/lidar/{stamp}"] = {
            **{a: pa.array(points[:, j]) for j, a in enumerate("xyz")},
            "intensity": pa.array([10] * len(points), pa.uint8()),
            "laser_number": pa.array([3] * len(points), pa.uint8()),
            "offset_ns": pa.array([0] * len(points), pa.int32()),
        }
    for name, columns in tables.items():
        path = folder / f"{name}.feather"
        path.parent.mkdir(parents=True, exist_ok=True)
        feather.write_feather(pa.table(columns), str(path), compression="zstd")
    return root
