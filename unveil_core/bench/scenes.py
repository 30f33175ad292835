"""A street of surfels of any size, to measure on: road, walks, facades, tree crowns and cars along 60 metres."""

from __future__ import annotations

import math

import numpy as np
import torch

from unveil_core.geometry.camera import Camera
from unveil_core.raster.spherical_harmonics import SH0
from unveil_core.surfels.surfels import Surfels

__all__ = ["LABELS", "corridor", "corridor_camera"]

LABELS = 8
ROAD, WALK, FACADE, CROWN, CAR = range(5)
_SHARES = ((ROAD, 0.25), (WALK, 0.12), (FACADE, 0.38), (CROWN, 0.15), (CAR, 0.10))


def _part(kind: int, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals (n, 3) of one kind of surface; x right, y down, z along the street."""
    z, side = rng.uniform(0.5, 60, n), rng.choice([-1.0, 1.0], n)
    flat = np.tile([0.0, -1.0, 0.0], (n, 1))
    if kind == ROAD:
        return np.stack([rng.uniform(-5, 5, n), 1.6 + rng.normal(0, 0.01, n), z], 1), flat
    if kind == WALK:
        return np.stack([side * rng.uniform(5, 8, n), 1.45 + rng.normal(0, 0.01, n), z], 1), flat
    if kind == FACADE:
        wall = np.stack([side * (8 + rng.normal(0, 0.05, n)), 1.45 - rng.uniform(0, 9, n), z], 1)
        return wall, np.stack([-side, 0 * side, 0 * side], 1)
    if kind == CROWN:
        trees = np.stack([np.tile([-6.5, 6.5], 7), np.full(14, -2.2), np.linspace(6, 58, 14)], 1)
        away = rng.normal(size=(n, 3))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        ball = away * 1.6 * np.cbrt(rng.uniform(0.5, 1, (n, 1)))
        return trees[rng.integers(0, 14, n)] + ball, rng.normal(size=(n, 3))
    cars = np.stack([np.tile([-3.8, 3.8], 4), np.full(8, 0.9), np.linspace(7, 50, 8)], 1)
    box, normals = rng.uniform(-1, 1, (n, 3)), np.zeros((n, 3))
    face, sign = rng.integers(0, 3, n), rng.choice([-1.0, 1.0], n)
    box[np.arange(n), face] = normals[np.arange(n), face] = sign
    return cars[rng.integers(0, 8, n)] + box * [0.9, 0.7, 2.1], normals


def corridor(count: int, *, degree: int = 0, seed: int = 0) -> Surfels:
    """A street of so many surfels; they shrink as their number grows, and one label in thirty is wrong."""
    rng = np.random.default_rng(seed)
    counts = [round(share * count) for _, share in _SHARES[:-1]]
    counts.append(count - sum(counts))
    parts = [_part(kind, n, rng) for (kind, _), n in zip(_SHARES, counts, strict=True)]
    means, normals = (np.concatenate(a) for a in zip(*parts, strict=True))
    labels = np.repeat([kind for kind, _ in _SHARES], counts)
    normals = normals + rng.normal(0, 0.12, normals.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # The shortest turn from the z axis to the normal, after a turn about the z axis.
    spin = rng.uniform(0, math.pi, count)
    tilt = np.stack([1 + normals[:, 2], -normals[:, 1], normals[:, 0], np.zeros(count)], 1)
    tilt[tilt[:, 0] < 1e-6] = (0.0, 1.0, 0.0, 0.0)
    c, s, (w, x, y, _) = np.cos(spin), np.sin(spin), tilt.T
    quats = np.stack([w * c, x * c + y * s, y * c - x * s, w * s], 1)
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    scales = 0.11 * math.sqrt(1e5 / count) * np.exp(rng.normal(0, 0.45, (count, 2)))
    opacity = np.where(rng.random(count) < 0.72, rng.uniform(0.9, 0.999, count), rng.uniform(0.03, 0.9, count))
    labels = np.where(rng.random(count) < 0.03, rng.integers(0, LABELS, count), labels)
    waves = np.sin(means * [1.3, 2.1, 0.7] + labels[:, None])
    rgb = np.clip(0.5 + 0.3 * waves + rng.normal(0, 0.08, (count, 3)), 0, 1)
    sh = np.zeros((count, (degree + 1) ** 2, 3))
    sh[:, 0] = (rgb - 0.5) / SH0
    sh[:, 1:] = rng.normal(0, 0.05, sh[:, 1:].shape)
    order = rng.permutation(count)

    def tensor(a: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(a[order])).float()

    return Surfels(
        means=tensor(means),
        quats=tensor(quats),
        log_scales=tensor(np.log(scales)),
        opacity_logits=tensor(np.log(opacity / (1 - opacity))),
        sh=tensor(sh),
        labels=torch.from_numpy(labels[order]).long(),
    )


def corridor_camera(width: int, height: int) -> Camera:
    """Someone who stands at the street's beginning, 1.6 m above the road, with a field of view of 62 degrees."""
    focal = 0.5 * width / math.tan(math.radians(31))
    yaw, pitch = 0.03, -0.02
    turn = np.array([[math.cos(yaw), 0, math.sin(yaw)], [0, 1, 0], [-math.sin(yaw), 0, math.cos(yaw)]])
    tilt = np.array([[1, 0, 0], [0, math.cos(pitch), -math.sin(pitch)], [0, math.sin(pitch), math.cos(pitch)]])
    pose = np.eye(4)
    pose[:3, :3] = tilt @ turn
    pose[:3, 3] = -pose[:3, :3] @ [0.1, 0.0, -0.5]
    return Camera(width, height, focal, focal, width / 2, height / 2, pose)
