"""A small street ray-cast with numpy, crowded and empty: a real drive for tests of whole runs."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from unveil_core.drives.drive import PointCloud
from unveil_core.drives.points import write_points

WIDTH, HEIGHT, FOCAL, FRAMES = 128, 80, 85.0, 8
LOW, HIGH = np.array([9.0, -3.4, 0.0]), np.array([12.5, -1.7, 1.4])
ROAD, SIDEWALK, BUILDING, SKY, CAR = 0, 1, 2, 10, 13


def shade(p: np.ndarray, kind: np.ndarray) -> np.ndarray:
    """Colours (N, 3) in [0, 1] of surface points."""
    grain = 0.03 * np.sin(9 * p[:, 0] + 4 * p[:, 1]) * np.cos(7 * p[:, 1])
    color = np.repeat((0.4 + grain)[:, None], 3, axis=1)
    color[(kind == ROAD) & (np.abs(p[:, 1] + 1.4) < 0.12)] = 0.9
    color[kind == SIDEWALK] = (0.62, 0.58, 0.52)
    wall = kind == BUILDING
    window = (np.abs((p[:, 0] / 3) % 1 - 0.5) < 0.2) & (np.abs(p[:, 2] - 2.0) < 0.7)
    color[wall] = (0.7, 0.5, 0.35)
    color[wall & window] = (0.2, 0.25, 0.3)
    color[kind == CAR] = (0.75, 0.1, 0.1)
    color[kind == SKY] = (0.55, 0.7, 0.9)
    return color


def cast(origin: np.ndarray, rays: np.ndarray, crowded: bool) -> tuple[np.ndarray, np.ndarray]:
    """Distance along rays (N, 3) and class; inf and SKY where nothing is hit."""
    best = np.full(len(rays), np.inf)
    kind = np.full(len(rays), SKY)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -origin[2] / rays[:, 2]
        p = origin + t[:, None] * rays
        hit = (t > 0) & (np.abs(p[:, 1]) < 6) & (t < 60)
        best[hit] = t[hit]
        kind[hit] = np.where(np.abs(p[hit, 1]) > 4, SIDEWALK, ROAD)
        for side in (-6.0, 6.0):
            t = (side - origin[1]) / rays[:, 1]
            p = origin + t[:, None] * rays
            hit = (t > 0) & (t < best) & (p[:, 2] >= 0) & (p[:, 2] < 5) & (p[:, 0] < 45)
            best[hit], kind[hit] = t[hit], BUILDING
        if crowded:
            a, b = (LOW - origin) / rays, (HIGH - origin) / rays
            enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
            hit = (enter > 0) & (enter < leave) & (enter < best)
            best[hit], kind[hit] = enter[hit], CAR
    return best, kind


def pose_at(x: float) -> np.ndarray:
    """(4, 4) OpenGL pose of the camera so many metres down the street."""
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = (0, -1, 0), (0.06, 0, 1), (-1, 0, 0.06)
    pose[:3, :3] /= np.linalg.norm(pose[:3, :3], axis=0)
    pose[:3, 3] = (x, 0.4, 1.6)
    return pose


def picture(pose: np.ndarray, crowded: bool, shrink: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Image (H, W, 3) uint8 BGR, antialiased, and classes (H, W) of an OpenGL pose; ``shrink`` times smaller."""
    colors, classes = colors_seen(pose, crowded, shrink)
    return (colors * 255).round().astype(np.uint8), classes


def colors_seen(pose: np.ndarray, crowded: bool, shrink: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """The same in [0, 1], not rounded."""
    width, height, focal = WIDTH // shrink, HEIGHT // shrink, FOCAL / shrink
    total, classes = np.zeros((height, width, 3)), np.zeros((height, width), np.uint8)
    for dx, dy in ((0.5, 0.5), (0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)):
        x = (np.arange(width) + dx - width / 2) / focal
        y = -(np.arange(height) + dy - height / 2) / focal
        local = np.stack(np.broadcast_arrays(x[None], y[:, None], np.full((1, 1), -1.0)), axis=-1).reshape(-1, 3)
        rays = local @ pose[:3, :3].T
        t, kind = cast(pose[:3, 3], rays, crowded)
        points = pose[:3, 3] + np.where(np.isfinite(t), t, 0)[:, None] * rays
        if (dx, dy) == (0.5, 0.5):
            classes = kind.reshape(height, width).astype(np.uint8)
        else:
            total += shade(points, kind).reshape(height, width, 3) / 4
    return total[..., ::-1], classes


def true_depth(pose: np.ndarray) -> np.ndarray:
    """(H, W) metres along the optical axis of the empty street, inf for the sky."""
    x = (np.arange(WIDTH) + 0.5 - WIDTH / 2) / FOCAL
    y = -(np.arange(HEIGHT) + 0.5 - HEIGHT / 2) / FOCAL
    local = np.stack(np.broadcast_arrays(x[None], y[:, None], np.full((1, 1), -1.0)), axis=-1).reshape(-1, 3)
    return cast(pose[:3, 3], local @ pose[:3, :3].T, False)[0].reshape(HEIGHT, WIDTH)


def lidar(pose: np.ndarray, rays: int, generator: np.random.Generator) -> np.ndarray:
    """(P, 3) points that a LiDAR on the camera's roof measures within 40 m."""
    origin = pose[:3, 3] + (0, 0, 0.3)
    directions = generator.normal(size=(rays, 3)) * (1, 1, 0.35)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    t, _ = cast(origin, directions, True)
    near = t < 40
    points: np.ndarray = origin + t[near, None] * directions[near]
    return points


def write_free_truth(folder: Path) -> None:
    """``truth/free`` of two places 1.5 m beside the path and two 1 m above it."""
    for name in ("images", "removed"):
        (folder / "truth/free" / name).mkdir(parents=True, exist_ok=True)
    entries = []
    for track, shift in (("beside", (0.0, -1.5, 0.0)), ("above", (0.0, 0.0, 1.0))):
        for i in (1, 5):
            pose = pose_at(i * 1.0)
            pose[:3, 3] += shift
            empty, _ = picture(pose, False)
            _, kind = picture(pose, True)
            cv2.imwrite(str(folder / f"truth/free/images/{i:02d}_{track}.png"), empty)
            mask = np.where(kind == CAR, 255, 0).astype(np.uint8)
            cv2.imwrite(str(folder / f"truth/free/removed/{i:02d}_{track}.png"), mask)
            entries.append(
                {"file_path": f"images/{i:02d}_{track}.png", "camera": track, "transform_matrix": pose.tolist()}
            )
    size = {"w": WIDTH, "h": HEIGHT, "fl_x": FOCAL, "fl_y": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2}
    (folder / "truth/free/transforms.json").write_text(json.dumps({**size, "frames": entries}))


def make_small_street(folder: Path, *, masks_only: bool = False) -> Path:
    """Write the drive and its truth; returns the path of transforms.json."""
    for name in ("images", "semantics", "instances", "masks", "truth/images", "truth/removed", "truth/depth"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    frames, cloud = [], []
    generator = np.random.default_rng(0)
    for i in range(FRAMES):
        pose = pose_at(i * 1.0)
        image, kind = picture(pose, True)
        empty, _ = picture(pose, False)
        cv2.imwrite(str(folder / f"images/{i:02d}.png"), image)
        cv2.imwrite(str(folder / f"truth/images/{i:02d}.png"), empty)
        cv2.imwrite(str(folder / f"truth/removed/{i:02d}.png"), np.where(kind == CAR, 255, 0).astype(np.uint8))
        depth = true_depth(pose)
        steps = np.where(depth < 255, depth * 256, 0).round().astype(np.uint16)
        cv2.imwrite(str(folder / f"truth/depth/{i:02d}.png"), steps)
        entry: dict[str, object] = {"file_path": f"images/{i:02d}.png", "transform_matrix": pose.tolist()}
        if masks_only:
            cv2.imwrite(str(folder / f"masks/{i:02d}.png"), np.where(kind == CAR, 0, 255).astype(np.uint8))
            if i % 2 == 0:  # the others have none: it is carried to them through the scene
                entry["mask_path"] = f"masks/{i:02d}.png"
        else:
            cv2.imwrite(str(folder / f"semantics/{i:02d}.png"), kind)
            cv2.imwrite(str(folder / f"instances/{i:02d}.png"), np.where(kind == CAR, 5, 0).astype(np.uint16))
            entry["semantic_path"], entry["instance_path"] = f"semantics/{i:02d}.png", f"instances/{i:02d}.png"
        frames.append(entry)
        cloud.append(lidar(pose, 3000, generator))
    write_free_truth(folder)
    write_points(PointCloud(np.concatenate(cloud)), folder / "points.ply")
    document = {
        "w": WIDTH,
        "h": HEIGHT,
        "fl_x": FOCAL,
        "fl_y": FOCAL,
        "cx": WIDTH / 2,
        "cy": HEIGHT / 2,
        "camera_model": "PINHOLE",
        "metric": True,
        "ply_file_path": "points.ply",
        "semantic_classes": "cityscapes",
        "frames": frames,
    }
    path = folder / "transforms.json"
    path.write_text(json.dumps(document))
    return path
