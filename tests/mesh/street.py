"""An analytic street, ray cast exactly: ground, two facades, cars as boxes: the truth that tests compare with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from unveil_core.geometry.camera import Camera

HALF_WIDTH = 5.0
FACADE_HEIGHT = 7.0
SKY = (0.62, 0.74, 0.90)


@dataclass(frozen=True)
class Car:
    """A box on the ground: centre and half size in x and y, height, colour."""

    x: float
    y: float
    half_x: float = 2.0
    half_y: float = 0.9
    height: float = 1.5
    color: tuple[float, float, float] = (0.75, 0.12, 0.10)


def street_camera(x: float, width: int = 96, height: int = 64, focal: float | None = None, y: float = 0.0) -> Camera:
    """A camera 1.6 m above the ground that looks along +x, a little down."""
    focal = 0.9 * width if focal is None else focal
    pitch = 0.06
    forward = np.array([np.cos(pitch), 0, -np.sin(pitch)])
    right = np.array([0.0, -1.0, 0.0])
    down = np.cross(forward, right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([right, down, forward])
    matrix[:3, 3] = -matrix[:3, :3] @ np.array([x, y, 1.6])
    return Camera(width, height, focal, focal, width / 2, height / 2, matrix)


def _ground_color(p: np.ndarray) -> np.ndarray:
    tile = (np.floor(p[..., 0] / 0.8) + np.floor(p[..., 1] / 0.8)) % 2
    grain = 0.04 * np.sin(7.1 * p[..., 0]) * np.sin(5.3 * p[..., 1])
    gray = 0.42 + 0.07 * tile + grain
    walk = np.abs(p[..., 1]) > 3.2
    line = np.abs(np.abs(p[..., 1]) - 3.2) < 0.08
    color = np.where(walk[..., None], gray[..., None] * (1.25, 1.2, 1.1), gray[..., None] * (0.9, 0.92, 0.97))
    return np.where(line[..., None], (0.85, 0.83, 0.78), color)


def _facade_color(p: np.ndarray, side: float) -> np.ndarray:
    base = np.array([0.72, 0.52, 0.40]) if side > 0 else np.array([0.62, 0.66, 0.60])
    u, v = p[..., 0] % 3.0, p[..., 2] % 3.2
    window = (u > 0.9) & (u < 2.1) & (v > 1.0) & (v < 2.6)
    shade = 1 - 0.06 * (np.floor(p[..., 2] / 0.25) % 2)
    return np.where(window[..., None], (0.22, 0.27, 0.33), base * shade[..., None])


def cast(camera: Camera, cars: tuple[Car, ...] = (), *, facades: bool = True) -> dict[str, np.ndarray]:
    """``depth`` (H, W) float32 with 0 for sky, ``rgb`` (H, W, 3) float32, ``car`` (H, W) number of the car or 0,
    ``shadow`` (H, W) bool."""
    origin, rays = camera.centre, camera.rays()
    depth = np.full(rays.shape[:2], np.inf)
    rgb = np.broadcast_to(np.array(SKY), rays.shape).copy()
    index = np.zeros(rays.shape[:2], dtype=np.int64)
    shadow = np.zeros(rays.shape[:2], dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -origin[2] / rays[..., 2]
        p = origin + rays * t[..., None]
        hit = (rays[..., 2] < 0) & (np.abs(p[..., 1]) <= HALF_WIDTH if facades else True)
        shaded = np.zeros_like(hit)
        for car in cars:
            shaded |= (np.abs(p[..., 0] - car.x) < car.half_x) & (np.abs(p[..., 1] - car.y + 0.5) < car.half_y + 0.3)
        color = _ground_color(np.nan_to_num(p)) * np.where(shaded, 0.55, 1.0)[..., None]
        depth[hit], rgb[hit], shadow[hit] = t[hit], color[hit], shaded[hit]
        for side in (1.0, -1.0) if facades else ():
            t = (side * HALF_WIDTH - origin[1]) / rays[..., 1]
            p = origin + rays * t[..., None]
            hit = (t > 0) & (p[..., 2] >= 0) & (p[..., 2] <= FACADE_HEIGHT) & (t < depth)
            color = _facade_color(np.nan_to_num(p), side)
            depth[hit], rgb[hit], shadow[hit] = t[hit], color[hit], False
        for number, car in enumerate(cars, start=1):
            low = np.array([car.x - car.half_x, car.y - car.half_y, 0.0])
            high = np.array([car.x + car.half_x, car.y + car.half_y, car.height])
            first, second = (low - origin) / rays, (high - origin) / rays
            enter, leave = np.minimum(first, second).max(axis=-1), np.maximum(first, second).min(axis=-1)
            hit = (enter <= leave) & (enter > 0) & (enter < depth)
            p = origin + rays * enter[..., None]
            glass = np.where((p[..., 2] > 0.85) & (p[..., 2] < 1.35), 0.35, 1.0)
            depth[hit] = enter[hit]
            rgb[hit] = (np.array(car.color) * glass[..., None])[hit]
            index[hit], shadow[hit] = number, False
    return {
        "depth": np.where(np.isfinite(depth), depth, 0).astype(np.float32),
        "rgb": rgb.astype(np.float32),
        "car": index,
        "shadow": shadow,
    }
