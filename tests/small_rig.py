"""Several cameras on one car in the street of :mod:`tests.small_street`: of other directions, sizes, colours and rates."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from tests.small_street import CAR, cast, lidar, pose_at, shade
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import write_points


@dataclass(frozen=True)
class OnCar:
    """A camera of a rig.

    Attributes:
        name: of its track.
        yaw: degrees to the left of the way; aside, behind: of the front camera, metres to the left and back.
        size: width and height of its pictures, pixels; focal: likewise.
        gain: (3,) of its colours, RGB.
        every: it takes each n-th frame; late: seconds after the others.
    """

    name: str
    yaw: float = 0.0
    aside: float = 0.0
    behind: float = 0.0
    size: tuple[int, int] = (64, 40)
    focal: float = 42.5
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    every: int = 1
    late: float = 0.0

    def pose(self, x: float) -> np.ndarray:
        """(4, 4) OpenGL pose while the front camera is ``x`` metres down the street."""
        angle = np.radians(self.yaw)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        pose = pose_at(x)
        pose[:3, :3] = turn @ pose[:3, :3]
        pose[:3, 3] += (-self.behind, self.aside, 0.0)
        return pose

    def picture(self, x: float, crowded: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Image (H, W, 3) uint8 BGR, antialiased, and classes (H, W)."""
        pose, (width, height) = self.pose(x), self.size
        total, classes = np.zeros((height, width, 3)), np.zeros((height, width), np.uint8)
        for dx, dy in ((0.5, 0.5), (0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)):
            u = (np.arange(width) + dx - width / 2) / self.focal
            v = -(np.arange(height) + dy - height / 2) / self.focal
            local = np.stack(np.broadcast_arrays(u[None], v[:, None], np.full((1, 1), -1.0)), axis=-1).reshape(-1, 3)
            rays = local @ pose[:3, :3].T
            t, kind = cast(pose[:3, 3], rays, crowded)
            if (dx, dy) == (0.5, 0.5):
                classes = kind.reshape(height, width).astype(np.uint8)
                continue
            points = pose[:3, 3] + np.where(np.isfinite(t), t, 0)[:, None] * rays
            total += shade(points, kind).reshape(height, width, 3) / 4
        seen = np.clip(total * self.gain, 0, 1)
        return (seen[..., ::-1] * 255).round().astype(np.uint8), classes


FRONT = OnCar("front")
LEFT = OnCar("left", yaw=70.0, aside=0.6, behind=0.4)
RIGHT = OnCar("right", yaw=-70.0, aside=-0.6, behind=0.4, size=(56, 30), focal=30.0)
REAR = OnCar("rear", yaw=180.0, behind=3.5, size=(48, 40), focal=36.0)


def make_small_rig(folder: Path, cameras: Sequence[OnCar], places: Sequence[float], *, stamps: bool = True) -> Path:
    """A drive with frames of several cameras, the front camera at these metres down the street; returns transforms.json."""
    generator = np.random.default_rng(0)
    frames, cloud = [], []
    for car in cameras:
        for name in ("images", "semantics", "instances"):
            (folder / name / car.name).mkdir(parents=True, exist_ok=True)
        for i in range(0, len(places), car.every):
            image, kind = car.picture(places[i])
            stem = f"{car.name}/{i:03d}.png"
            cv2.imwrite(str(folder / "images" / stem), image)
            cv2.imwrite(str(folder / "semantics" / stem), kind)
            cv2.imwrite(str(folder / "instances" / stem), np.where(kind == CAR, 5, 0).astype(np.uint16))
            width, height = car.size
            entry: dict[str, object] = {
                "file_path": f"images/{stem}",
                "semantic_path": f"semantics/{stem}",
                "instance_path": f"instances/{stem}",
                "camera": car.name,
                "transform_matrix": car.pose(places[i]).tolist(),
                "w": width,
                "h": height,
                "fl_x": car.focal,
                "fl_y": car.focal,
                "cx": width / 2,
                "cy": height / 2,
            }
            if stamps:
                entry["timestamp"] = 0.1 * i + car.late
            frames.append(entry)
    for x in places:
        cloud.append(lidar(pose_at(x), 3000, generator))
    write_points(PointCloud(np.concatenate(cloud)), folder / "points.ply")
    document = {"metric": True, "ply_file_path": "points.ply", "semantic_classes": "cityscapes", "frames": frames}
    path = folder / "transforms.json"
    path.write_text(json.dumps(document))
    return path
