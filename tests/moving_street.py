"""A small street in the sun, ray-cast with numpy: a parked car, and a car or a walker that moves; and the street without them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import write_points

WIDTH, HEIGHT, FOCAL, FRAMES, STEP = 144, 96, 105.0, 12, 1.0
ROAD, SIDEWALK, BUILDING, SKY, PERSON, CAR = 0, 1, 2, 10, 11, 13
SUN = np.array([0.25, 0.75, 0.6]) / np.linalg.norm([0.25, 0.75, 0.6])
PARKED_ID, MOVER_ID = 5, 9
Boxes = Sequence[tuple[np.ndarray, np.ndarray, int, int]]
"""Low corner, high corner, class, id."""


@dataclass(frozen=True)
class Street:
    """What moves: its box at the first frame, its class, and its way per frame, metres."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    step: tuple[float, float, float]
    kind: int = CAR

    def boxes(self, i: int) -> Boxes:
        """What is on the street in frame i."""
        shift = i * np.array(self.step)
        return [PARKED, (np.array(self.low) + shift, np.array(self.high) + shift, self.kind, MOVER_ID)]


PARKED = (np.array([13.0, -3.9, 0.0]), np.array([16.6, -2.2, 1.4]), CAR, PARKED_ID)
ONCOMING = Street((24.0, 0.9, 0.0), (28.0, 2.6, 1.4), (-1.4, 0.0, 0.0))
AHEAD = Street((8.0, -1.2, 0.0), (11.8, 0.5, 1.4), (1.4, 0.0, 0.0))
WALKER = Street((10.0, 3.4, 0.0), (10.5, 3.9, 1.7), (0.0, -0.6, 0.0), PERSON)


def _paint(p: np.ndarray, kind: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Colours (N, 3) in [0, 1] in full sun."""
    grain = 0.05 * np.sin(9 * p[:, 0] + 4 * p[:, 1]) * np.cos(7 * p[:, 1]) + 0.03 * np.sin(2.1 * p[:, 0])
    color = np.repeat((0.5 + grain)[:, None], 3, axis=1)
    color[(kind == ROAD) & (np.abs(p[:, 1] - 0.7) < 0.1) & (p[:, 0] % 3 < 1.5)] = 0.92
    walk = kind == SIDEWALK
    color[walk] = np.array([0.66, 0.6, 0.54]) + grain[walk, None]
    wall = kind == BUILDING
    window = (np.abs((p[:, 0] / 3) % 1 - 0.5) < 0.2) & (np.abs(p[:, 2] - 2.0) < 0.7)
    color[wall] = np.array([0.7, 0.5, 0.35]) + grain[wall, None]
    color[wall & window] = (0.2, 0.25, 0.3)
    color[number == PARKED_ID] = (0.75, 0.1, 0.1)
    color[number == MOVER_ID] = (0.1, 0.2, 0.8)
    color[kind == SKY] = (0.55, 0.7, 0.9)
    return color


def _meets(origin: np.ndarray, rays: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(N,) distance along rays to a box, inf where they miss it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - origin) / rays, (high - origin) / rays
    enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    return np.where((enter > 1e-6) & (enter < leave), enter, np.inf)


def cast(origin: np.ndarray, rays: np.ndarray, boxes: Boxes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance along rays (N, 3), class and id; inf, SKY and 0 where nothing is hit."""
    best, kind, number = np.full(len(rays), np.inf), np.full(len(rays), SKY), np.zeros(len(rays), np.int64)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -origin[2] / rays[:, 2]
        p = origin + t[:, None] * rays
        hit = (t > 0) & (np.abs(p[:, 1]) < 7) & (t < 70)
        best[hit], kind[hit] = t[hit], np.where(np.abs(p[hit, 1]) > 4.2, SIDEWALK, ROAD)
        for side in (-7.0, 7.0):
            t = (side - origin[1]) / rays[:, 1]
            p = origin + t[:, None] * rays
            hit = (t > 0) & (t < best) & (p[:, 2] >= 0) & (p[:, 2] < 5) & (p[:, 0] < 55)
            best[hit], kind[hit] = t[hit], BUILDING
    for low, high, of_box, identity in boxes:
        t = _meets(origin, rays, low, high)
        hit = t < best
        best[hit], kind[hit], number[hit] = t[hit], of_box, identity
    return best, kind, number


def pose_at(i: int) -> np.ndarray:
    """(4, 4) OpenGL pose of frame i."""
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = (0, -1, 0), (0.1, 0, 1), (-1, 0, 0.1)
    pose[:3, :3] /= np.linalg.norm(pose[:3, :3], axis=0)
    pose[:3, 3] = (i * STEP, -0.6, 1.6)
    return pose


def picture(i: int, boxes: Boxes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Image (H, W, 3) uint8 BGR, antialiased and with cast shadows; classes and ids (H, W)."""
    pose = pose_at(i)
    total = np.zeros((HEIGHT * WIDTH, 3))
    for dx, dy in ((0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75), (0.5, 0.5)):
        x, y = (np.arange(WIDTH) + dx - WIDTH / 2) / FOCAL, -(np.arange(HEIGHT) + dy - HEIGHT / 2) / FOCAL
        local = np.stack(np.broadcast_arrays(x[None], y[:, None], np.full((1, 1), -1.0)), axis=-1).reshape(-1, 3)
        rays = local @ pose[:3, :3].T
        t, kind, number = cast(pose[:3, 3], rays, boxes)
        if (dx, dy) == (0.5, 0.5):
            break
        points = pose[:3, 3] + np.where(np.isfinite(t), t, 0)[:, None] * rays
        color = _paint(points, kind, number)
        towards = np.repeat(SUN[None], len(points), axis=0)
        for low, high, _, identity in boxes:
            shaded = np.isfinite(_meets(points, towards, low, high)) & (kind != SKY) & (number != identity)
            color[shaded] *= (0.45, 0.5, 0.6)
        total += color / 4
    shape = (HEIGHT, WIDTH)
    image = (total.reshape(HEIGHT, WIDTH, 3)[..., ::-1] * 255).round().astype(np.uint8)
    return image, kind.reshape(shape).astype(np.uint8), number.reshape(shape)


def lidar(i: int, boxes: Boxes, rays: int, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(P, 3) points that a LiDAR on the camera's roof measures within 40 m in frame i, and the ids that they lie on."""
    origin = pose_at(i)[:3, 3] + (0, 0, 0.3)
    directions = generator.normal(size=(rays, 3)) * (1, 1, 0.35)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    t, _, number = cast(origin, directions, boxes)
    near = t < 40
    return origin + t[near, None] * directions[near], number[near]


def make_moving_street(folder: Path, street: Street, *, instances: bool = False, boxes: bool = False) -> Path:
    """Write the drive with its truth, without anything on the street; returns the path of transforms.json.

    ``on_mover.npy`` tells which of its points lie on what moves.
    """
    for name in ("images", "semantics", "instances", "truth/images", "truth/removed"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    generator = np.random.default_rng(0)
    frames, cloud, owner = [], [], []
    for i in range(FRAMES):
        there = street.boxes(i)
        image, kind, number = picture(i, there)
        cv2.imwrite(str(folder / f"images/{i:02d}.png"), image)
        cv2.imwrite(str(folder / f"semantics/{i:02d}.png"), kind)
        cv2.imwrite(str(folder / f"truth/images/{i:02d}.png"), picture(i, ())[0])
        cv2.imwrite(str(folder / f"truth/removed/{i:02d}.png"), np.where(number > 0, 255, 0).astype(np.uint8))
        cv2.imwrite(str(folder / f"instances/{i:02d}.png"), number.astype(np.uint16))
        entry: dict[str, object] = {
            "file_path": f"images/{i:02d}.png",
            "transform_matrix": pose_at(i).tolist(),
            "semantic_path": f"semantics/{i:02d}.png",
        }
        if instances:
            entry["instance_path"] = f"instances/{i:02d}.png"
        if boxes:
            entry["boxes"] = [
                {
                    "id": identity,
                    "class": "car" if of_box == CAR else "person",
                    "centre": ((low + high) / 2).tolist(),
                    "size": (high - low).tolist(),
                    "yaw": 0.0,
                }
                for low, high, of_box, identity in there
            ]
        frames.append(entry)
        points, on = lidar(i, there, 2500, generator)
        cloud.append(points)
        owner.append(on == MOVER_ID)
    write_points(PointCloud(np.concatenate(cloud)), folder / "points.ply")
    np.save(folder / "on_mover.npy", np.concatenate(owner))
    path = folder / "transforms.json"
    path.write_text(
        json.dumps(
            {
                "w": WIDTH,
                "h": HEIGHT,
                "fl_x": FOCAL,
                "fl_y": FOCAL,
                "cx": WIDTH / 2,
                "cy": HEIGHT / 2,
                "metric": True,
                "ply_file_path": "points.ply",
                "semantic_classes": "cityscapes",
                "frames": frames,
            }
        )
    )
    return path
