"""A finished workspace of the analytic street: real files by the real importer, products computed from the truth."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from tests.mesh.street import Car, cast, street_camera
from unveil_core.base.files import write_image_atomic, write_json_atomic
from unveil_core.drives import open_drive
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import grow
from unveil_core.remove.regions import region_map

CARS = (Car(9.0, 2.1), Car(15.5, -2.2, color=(0.12, 0.20, 0.55)), Car(22.0, 2.1, color=(0.75, 0.75, 0.72)))
OFFSET = np.array([500_000.0, 6_000_000.0, 50.0])


def to_8_bit(rgb: np.ndarray) -> np.ndarray:
    return np.clip(np.round(rgb * 255), 0, 255).astype(np.uint8)


def write_drive(folder: Path, count: int, width: int, height: int, *, truth: bool, step: float) -> list[Camera]:
    """A transforms.json drive with exact truth; returns its cameras."""
    cameras = [street_camera(step * i, width, height) for i in range(count)]
    frames = []
    rng = np.random.default_rng(0)
    for i, camera in enumerate(cameras):
        name = f"{i:04d}"
        full, empty = cast(camera, CARS), cast(camera)
        semantics = np.where(full["car"] > 0, 13, np.where(full["depth"] > 0, 0, 10)).astype(np.uint8)
        write_image_atomic(folder / f"images/{name}.png", to_8_bit(full["rgb"]))
        write_image_atomic(folder / f"semantics/{name}.png", semantics)
        write_image_atomic(folder / f"instances/{name}.png", full["car"].astype(np.uint16))
        if truth:
            removed = full["car"] > 0
            write_image_atomic(folder / f"truth/images/{name}.png", to_8_bit(empty["rgb"]))
            write_image_atomic(folder / f"truth/removed/{name}.png", np.where(removed, 255, 0).astype(np.uint8))
            write_image_atomic(folder / f"truth/unseen/{name}.png", np.where(unseen(full), 255, 0).astype(np.uint8))
            shadow = full["shadow"] & ~removed
            write_image_atomic(folder / f"truth/shadow/{name}.png", np.where(shadow, 255, 0).astype(np.uint8))
        pose = camera.camera_to_world
        pose[:3, 3] += OFFSET
        pose[:3, 1:3] *= -1
        frames.append(
            {
                "file_path": f"images/{name}.png",
                "semantic_path": f"semantics/{name}.png",
                "instance_path": f"instances/{name}.png",
                "transform_matrix": pose.tolist(),
                "camera": "front",
            }
        )
    points = np.concatenate([cameras[0].unproject(cast(cameras[0])["depth"])[height // 2 :: 4, ::4].reshape(-1, 3)])
    points = points + OFFSET + rng.normal(0, 1e-3, points.shape)
    header = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {len(points)}\n"
    header += "property double x\nproperty double y\nproperty double z\nend_header\n"
    (folder / "points.ply").write_bytes(header.encode() + points.astype("<f8").tobytes())
    document = {
        "camera_model": "PINHOLE",
        "w": width,
        "h": height,
        "fl_x": cameras[0].fx,
        "fl_y": cameras[0].fy,
        "cx": cameras[0].cx,
        "cy": cameras[0].cy,
        "metric": True,
        "ply_file_path": "points.ply",
        "semantic_classes": "cityscapes",
        "frames": frames,
    }
    (folder / "transforms.json").write_text(json.dumps(document))
    return cameras


def unseen(full: dict[str, np.ndarray]) -> np.ndarray:
    """The lower part of each car, where it stands on the ground."""
    car = full["car"] > 0
    return car & (np.cumsum(car, axis=0) > 0.55 * car.sum(axis=0, keepdims=True))


def build_workspace(
    root: Path,
    *,
    count: int = 3,
    width: int = 96,
    height: int = 64,
    truth: bool = True,
    step: float = 1.2,
    error: float = 4.0,
) -> Path:
    """A workspace whose delivery is the truth plus noise of ``error`` levels inside the mask; returns its folder."""
    drive, workspace = root / "drive_on_disk", root / "workspace"
    cameras = write_drive(drive, count, width, height, truth=truth, step=step)
    import_drive(open_drive(drive), workspace / "drive")
    rng = np.random.default_rng(1)
    for i, camera in enumerate(cameras):
        full, empty = cast(camera, CARS), cast(camera)
        photograph, street = to_8_bit(full["rgb"]), to_8_bit(empty["rgb"]).astype(float)
        removed = grow(full["car"] > 0, 2)
        shadow = grow(full["shadow"], 1) & ~removed
        hidden = unseen(full)
        noisy = np.clip(np.round(street + rng.normal(0, error, street.shape)), 0, 255).astype(np.uint8)
        render = np.clip(np.round(street + rng.normal(0, 2 * error, street.shape)), 0, 255).astype(np.uint8)
        touched = removed | shadow
        where = f"front/{i:04d}.png"
        write_image_atomic(workspace / "frames" / where, np.where(touched[..., None], noisy, photograph))
        write_image_atomic(workspace / "renders" / where, render)
        write_image_atomic(workspace / "inpainted" / where, np.where(touched[..., None], noisy, photograph))
        write_image_atomic(workspace / "masks/removed" / where, np.where(removed, 255, 0).astype(np.uint8))
        write_image_atomic(workspace / "masks/shadows" / where, np.where(shadow, 255, 0).astype(np.uint8))
        write_image_atomic(workspace / "masks/unobserved" / where, np.where(hidden, 255, 0).astype(np.uint8))
        write_image_atomic(workspace / "regions" / where, region_map(removed, full["car"] > 0, hidden))
    write_instances(workspace, cameras)
    stages = ("import", "segment", "reconstruct", "instances", "remove", "inpaint", "reoptimize", "mesh")
    write_json_atomic(
        workspace / "workspace.json",
        {
            "format": 1,
            "drive": str(drive),
            "settings": {"remove": ["vehicle"], "instances": [], "quality": "standard", "device": "auto", "seed": 0},
            "versions": {"unveil": "0.1.0", "python": "3.11", "torch": "2.13"},
            "stages": {
                name: {"status": "done", "seconds": round(0.7 + 9.1 * k % 23, 2), "peak_memory_mb": 300.0 + 90 * k}
                for k, name in enumerate(stages)
            },
        },
    )
    return workspace


def write_instances(workspace: Path, cameras: list[Camera]) -> None:
    """instances.json with a thumbnail for each car but the last."""
    entries = []
    for number, car in enumerate(CARS, start=1):
        entry: dict[str, object] = {
            "id": number,
            "class": "car",
            "surfels": 900 + number,
            "removed": True,
            "thumbnail": None,
            "box": {"centre": [car.x, car.y, car.height / 2], "size": [4.0, 1.8, car.height], "yaw": 0.0},
            "first_frame": "0000",
            "last_frame": f"{len(cameras) - 1:04d}",
        }
        seen = cast(cameras[0], CARS)
        rows, columns = np.nonzero(seen["car"] == number)
        if len(rows) and number < len(CARS):
            crop = to_8_bit(seen["rgb"])[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
            picture = cv2.resize(crop, (96, 96)).astype(np.uint8)
            entry["thumbnail"] = f"instances/{number:04d}.png"
            write_image_atomic(workspace / f"instances/{number:04d}.png", picture)
        entries.append(entry)
    write_json_atomic(workspace / "instances.json", entries)
