"""A tiny but real drive on disk, for tests: four frames of 32x24, points, semantics, instances, masks."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import write_points

ROAD, SKY, CAR, VOID = 0, 10, 13, 255


def camera_to_world(i: int, offset: np.ndarray) -> np.ndarray:
    """OpenGL pose: looks along +x, one metre a frame, 1.6 m above the ground."""
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = (0, -1, 0), (0, 0, 1), (-1, 0, 0)
    pose[:3, 3] = np.array([i * 1.0, 0.0, 1.6]) + offset
    return pose


def make_tiny_drive(
    folder: Path, *, semantics: bool = True, masks: bool = False, offset: tuple[float, ...] = (0, 0, 0)
) -> Path:
    """Write the drive; returns the path of its transforms.json."""
    generator = np.random.default_rng(0)
    shift = np.asarray(offset, dtype=np.float64)
    frames = []
    for i in range(4):
        image = generator.integers(0, 255, (24, 32, 3), dtype=np.uint8)
        for name in ("images", "semantics", "instances", "masks"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / f"images/{i:02d}.png"), image)
        entry: dict[str, object] = {
            "file_path": f"images/{i:02d}.png",
            "transform_matrix": camera_to_world(i, shift).tolist(),
            "timestamp": 0.1 * i,
        }
        label = np.full((24, 32), ROAD, np.uint8)
        label[:10] = SKY
        label[12:18, 18:26] = CAR
        if semantics:
            cv2.imwrite(str(folder / f"semantics/{i:02d}.png"), label)
            cv2.imwrite(str(folder / f"instances/{i:02d}.png"), np.where(label == CAR, 300, 0).astype(np.uint16))
            entry["semantic_path"], entry["instance_path"] = f"semantics/{i:02d}.png", f"instances/{i:02d}.png"
        if masks:
            cv2.imwrite(str(folder / f"masks/{i:02d}.png"), np.where(label == CAR, 0, 255).astype(np.uint8))
            entry["mask_path"] = f"masks/{i:02d}.png"
        frames.append(entry)
    points = generator.uniform((2, -4, 0), (20, 4, 0.01), (400, 3)) + shift
    colors = generator.integers(0, 255, (400, 3), dtype=np.uint8)
    write_points(PointCloud(points, colors), folder / "points.ply")
    document = {
        "w": 32,
        "h": 24,
        "fl_x": 25.0,
        "fl_y": 26.0,
        "cx": 16.0,
        "cy": 12.0,
        "camera_model": "PINHOLE",
        "metric": True,
        "ply_file_path": "points.ply",
        "frames": frames,
    }
    path = folder / "transforms.json"
    path.write_text(json.dumps(document))
    return path


def edit(path: Path, change) -> None:  # type: ignore[no-untyped-def]
    """Change the parsed transforms.json in place."""
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
