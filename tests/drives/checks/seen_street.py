"""A short drive along a textured street, whose photographs, poses and points agree; tests spoil one of them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from tests.textured_street import WALL_M, TexturedStreet
from unveil_core.drives.drive import Drive, Frame, PointCloud
from unveil_core.geometry.camera import Camera

__all__ = ["cameras", "seen_street", "street_points", "with_cameras"]

COUNT, STEP_M = 5, 0.6
STREET = TexturedStreet()


@lru_cache(maxsize=1)
def _photographs() -> tuple[np.ndarray, ...]:
    return tuple(STREET.photograph(c)[0] for c in cameras())


def cameras(count: int = COUNT) -> list[Camera]:
    return [STREET.camera(STEP_M * k) for k in range(count)]


def street_points(around: bool = False) -> np.ndarray:
    """(P, 3) of the ground and the walls; ``around``: behind the cameras as well, as a LiDAR has them."""
    generator = np.random.default_rng(0)
    x = generator.uniform(-40.0 if around else 2.0, 40, 4000)
    ground = np.stack([x, generator.uniform(-WALL_M, WALL_M, 4000), np.zeros(4000)], axis=1)
    ground[:, 2] = STREET.height(ground)
    walls = np.stack([x, np.where(np.arange(4000) % 2, WALL_M, -WALL_M), generator.uniform(0, 6, 4000)], axis=1)
    return np.concatenate([ground, walls])


def seen_street(folder: Path, points: np.ndarray | None = None) -> Drive:
    """The drive, its photographs in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    frames = []
    for k, (camera, picture) in enumerate(zip(cameras(), _photographs(), strict=True)):
        path = folder / f"{k:02d}.png"
        if not path.is_file():
            assert cv2.imwrite(str(path), picture[..., ::-1])
        frames.append(Frame(path.stem, "camera", camera, path))
    cloud = PointCloud(street_points() if points is None else points)
    return Drive(folder, tuple(frames), cloud)


def with_cameras(drive: Drive, cameras: list[Camera]) -> Drive:
    return replace(drive, frames=tuple(replace(f, camera=c) for f, c in zip(drive.frames, cameras, strict=True)))
