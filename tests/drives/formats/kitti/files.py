"""What the tests of the KITTI readers write: numbers as text, pictures, sweeps; and an independent projection."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from unveil_core.drives.drive import Frame


def numbers(values: np.ndarray | Sequence[float]) -> str:
    return " ".join(f"{v:.12e}" for v in np.asarray(values, dtype=np.float64).ravel())


def write_text(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def write_picture(path: Path, width: int = 62, height: int = 18) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((height, width, 3), 90, np.uint8))


def write_sweep(path: Path, points: np.ndarray) -> None:
    """Points (P, 3), and a reflectance."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.column_stack([points, np.full(len(points), 0.3)]).astype("<f4").tofile(path)


def rotation(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    """(3, 3) about x, then y, then z, radians."""
    cx, cy, cz, sx, sy, sz = *np.cos([x, y, z]), *np.sin([x, y, z])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def rigid(turn: np.ndarray, shift: Sequence[float]) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, shift
    return pose


def apply(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ pose[:3, :3].T + pose[:3, 3]


def seen_at(frame: Frame, points: np.ndarray) -> np.ndarray:
    """(P, 2) pixels as OpenCV counts them, from the centre of the first pixel."""
    camera = frame.camera
    local = apply(camera.world_to_camera, points)
    return np.stack([camera.fx * local[:, 0], camera.fy * local[:, 1]], 1) / local[:, 2:] + (
        camera.cx - 0.5,
        camera.cy - 0.5,
    )


def projected(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(P, 2) pixels by a projection matrix (3, 4)."""
    found = points @ matrix[:, :3].T + matrix[:, 3]
    return found[:, :2] / found[:, 2:]
