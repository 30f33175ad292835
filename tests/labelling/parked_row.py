"""A street with parked cars in a row, one of them behind a pole, ray-cast with numpy: pictures, sweeps, boxes and their truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep, SweepPoints
from unveil_core.geometry.camera import Camera

WIDTH, HEIGHT, FOCAL, FRAMES = 240, 136, 180.0, 3
ROAD, SIDEWALK, BUILDING, POLE, SKY, PERSON, CAR = 0, 1, 2, 5, 10, 11, 13
Vector = tuple[float, float, float]
Solids = tuple[tuple[int, int, Vector, Vector, Vector], ...]
SOLIDS: Solids = (
    (1, CAR, (6.0, -3.6, 0.15), (10.2, -1.9, 1.5), (0.75, 0.12, 0.1)),
    (2, CAR, (11.4, -3.6, 0.15), (15.6, -1.9, 1.4), (0.85, 0.85, 0.85)),
    (3, CAR, (17.0, -3.6, 0.15), (21.0, -1.9, 1.6), (0.12, 0.15, 0.35)),
    (4, CAR, (14.0, 1.2, 0.15), (18.0, 2.9, 1.5), (0.1, 0.35, 0.2)),
    (5, PERSON, (12.0, 4.6, 0.0), (12.4, 5.0, 1.75), (0.6, 0.1, 0.5)),
    (0, POLE, (11.0, 0.95, 0.0), (11.16, 1.11, 6.0), (0.9, 0.75, 0.2)),
)
"""id (0 none), class, low and high corner, colour. The pole stands before car 4."""
LOOSE_M = 0.12
"""Boxes are larger than their objects by so much on every side, as those of datasets are."""


def camera_at(x: float) -> Camera:
    """A camera so many metres down the street, looking along x, a little down."""
    forward = np.array([1.0, 0.0, -0.05]) / np.hypot(1.0, 0.05)
    right = np.array([0.0, -1.0, 0.0])
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3] = rotation
    pose[:3, 3] = -rotation @ np.array([x, 0.0, 1.6])
    return Camera(WIDTH, HEIGHT, FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2, pose)


def cast(
    origin: np.ndarray, rays: np.ndarray, solids: Solids = SOLIDS
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Distance along rays (N, 3), inf in the sky; class, id and colour."""
    best, kind = np.full(len(rays), np.inf), np.full(len(rays), SKY)
    owner, color = np.zeros(len(rays), int), np.tile([0.6, 0.75, 0.95], (len(rays), 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -origin[2] / rays[:, 2]
        p = origin + np.where(np.isfinite(t), t, 0)[:, None] * rays
        hit = (t > 0) & (np.abs(p[:, 1]) < 6) & (t < 80)
        best[hit], kind[hit] = t[hit], np.where(np.abs(p[hit, 1]) > 4, SIDEWALK, ROAD)
        color[hit] = np.where((np.abs(p[hit, 1]) > 4)[:, None], 0.62, 0.38)
        for side in (-6.0, 6.0):
            t = (side - origin[1]) / rays[:, 1]
            p = origin + np.where(np.isfinite(t), t, 0)[:, None] * rays
            hit = (t > 0) & (t < best) & (p[:, 2] >= 0) & (p[:, 2] < 5) & (p[:, 0] < 60)
            best[hit], kind[hit], color[hit] = t[hit], BUILDING, (0.55, 0.42, 0.3)
        for number, name, low, high, shade in solids:
            a, b = (np.array(low) - origin) / rays, (np.array(high) - origin) / rays
            enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
            hit = (enter > 0) & (enter < leave) & (enter < best)
            best[hit], kind[hit], owner[hit], color[hit] = enter[hit], name, number, shade
    return best, kind, owner, color


def picture(camera: Camera, solids: Solids = SOLIDS) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Photograph (H, W, 3) uint8, classes and ids (H, W) that a camera sees."""
    rays = camera.rays().reshape(-1, 3)
    t, kind, owner, color = cast(camera.centre, rays, solids)
    place = camera.centre + np.where(np.isfinite(t), t, 0)[:, None] * rays
    grain = 0.03 * np.sin(11 * place[:, :1] + 5 * place[:, 1:2]) * np.cos(9 * place[:, 2:]) * np.isfinite(t)[:, None]
    shape = (HEIGHT, WIDTH)
    image = ((color + grain).clip(0, 1) * 255).round().astype(np.uint8).reshape(*shape, 3)
    return image, kind.reshape(shape).astype(np.uint8), owner.reshape(shape)


def sweep_at(x: float, classes: bool, solids: Solids = SOLIDS) -> SweepPoints:
    """What a LiDAR over the camera measures: 48 rings, a ray each 0.35 degrees before it."""
    azimuth, elevation = np.radians(np.arange(-70, 70, 0.35)), np.radians(np.linspace(-22, 12, 48))
    a, e = (v.ravel() for v in np.meshgrid(azimuth, elevation))
    rays = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)
    origin = np.array([x, 0.0, 1.9])
    t, kind, _, _ = cast(origin, rays, solids)
    hit = t < 60
    return SweepPoints(origin + t[hit, None] * rays[hit], kind[hit].astype(np.uint8) if classes else None)


def boxes(solids: Solids = SOLIDS) -> tuple[TrackedBox, ...]:
    """Loose boxes of the objects."""
    names = {CAR: "car", PERSON: "person"}
    found = []
    for number, kind, low, high, _ in solids:
        if number:
            centre, size = (np.array(low) + high) / 2, np.array(high) - low + 2 * LOOSE_M
            found.append(TrackedBox(number, names[kind], tuple(centre.tolist()), tuple(size.tolist()), 0.0))
    return tuple(found)


def parked_row(folder: Path, *, classes: bool = True, sweeps: bool = True) -> Drive:
    """The drive, localized, its pictures in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    frames, turns = [], []
    for i in range(FRAMES):
        camera, path = camera_at(1.0 * i), folder / f"{i:02d}.png"
        cv2.imwrite(str(path), picture(camera)[0][..., ::-1])
        frames.append(Frame(f"{i:02d}", "front", camera, path, timestamp=0.5 * i, boxes=boxes()))
        turns.append(Sweep(folder / f"{i:02d}", lambda i=i: sweep_at(1.0 * i, classes), 0.5 * i, boxes()))  # type: ignore[misc]
    parts = [turn.read() for turn in turns]
    points = PointCloud(np.concatenate([p.positions for p in parts]), measured=True)
    if classes:
        points = replace(points, classes=np.concatenate([p.classes for p in parts if p.classes is not None]))
    return Drive(folder, tuple(frames), points, sweeps=tuple(turns) if sweeps else ())
