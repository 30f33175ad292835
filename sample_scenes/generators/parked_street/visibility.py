"""What a view shows: pixels and rays of the scenes' camera, and which places no frame of a crowded drive shows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

WIDTH, HEIGHT, FOV = 384, 256, math.radians(70)


def intrinsics() -> dict[str, float]:
    """Of every camera, as transforms.json names them."""
    focal = WIDTH / 2 / math.tan(FOV / 2)
    return {"w": WIDTH, "h": HEIGHT, "fl_x": focal, "fl_y": focal, "cx": WIDTH / 2, "cy": HEIGHT / 2}


def project(pose: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) and depth (N,) of world points for an OpenGL camera-to-world pose."""
    focal = WIDTH / 2 / math.tan(FOV / 2)
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    depth = -local[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = np.stack([local[:, 0] / depth * focal + WIDTH / 2, -local[:, 1] / depth * focal + HEIGHT / 2], axis=1)
    return pixels, depth


def in_picture(pose: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Which points lie in the picture, with their rows and columns (0 where not) and their depths."""
    pixels, depth = project(pose, points)
    inside = (depth > 0.3) & (pixels >= 0).all(axis=1) & (pixels[:, 0] < WIDTH) & (pixels[:, 1] < HEIGHT)
    column = np.where(inside, pixels[:, 0], 0).astype(int)
    row = np.where(inside, pixels[:, 1], 0).astype(int)
    return inside, row, column, depth


def looked_up(pose: np.ndarray, points: np.ndarray, depth_image: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which points the view really sees, with their rows and columns (0 where not)."""
    inside, row, column, depth = in_picture(pose, points)
    seen = inside & (np.abs(depth_image[row, column] - depth) < tolerance + 0.01 * depth)
    return seen, row, column


def rays(pose: np.ndarray) -> np.ndarray:
    """(H, W, 3) world directions with unit depth."""
    focal = WIDTH / 2 / math.tan(FOV / 2)
    x = (np.arange(WIDTH) + 0.5 - WIDTH / 2) / focal
    y = -(np.arange(HEIGHT) + 0.5 - HEIGHT / 2) / focal
    local = np.stack(np.broadcast_arrays(x[None, :], y[:, None], np.full((1, 1), -1.0)), axis=-1)
    return local @ pose[:3, :3].T


@dataclass(frozen=True, eq=False)
class Crowd:
    """What the frames of the crowded drive show: pose (4, 4), depth (H, W) and pixels (H, W) of removed objects of each."""

    poses: list[np.ndarray]
    depth: list[np.ndarray]
    removed: list[np.ndarray]


def depth_in_pixel(pose: np.ndarray, row: np.ndarray, column: np.ndarray, places: np.ndarray, normal: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Depth (P,) that the plane through each place has at the centre of the pixel that the place falls into.

    Ground seen at a grazing angle is metres nearer at one border of a pixel than at the other: the depth of the place, which lies
    anywhere in the pixel, cannot be held against that of its centre.
    """
    ray = rays(pose)[row, column]
    with np.errstate(divide="ignore", invalid="ignore"):
        plane = ((places - pose[:3, 3]) * normal).sum(axis=1) / (ray * normal).sum(axis=1)
    # Seen along its edge a plane has no depth to speak of.
    return np.where(np.isfinite(plane) & (np.abs(plane - depth) < 0.5 * depth), plane, depth)


def never_seen(pose: np.ndarray, region: np.ndarray, depth: np.ndarray, normal: np.ndarray, crowd: Crowd) -> np.ndarray:
    """(H, W) pixels of a region of an empty view whose surface no frame of the crowded drive shows.

    A frame shows a place if the pixel into which the place falls shows the surface there and no removed object.

    Args:
        pose: of the view; region: (H, W); depth: (H, W) and normal: (H, W, 3) of what the view shows.
    """
    unseen = region & np.isfinite(depth)
    rows, columns = np.nonzero(unseen)
    places = pose[:3, 3] + rays(pose)[rows, columns] * depth[rows, columns, None]
    normal = normal[rows, columns]
    shown = np.zeros(len(rows), bool)
    for other, image, removed in zip(crowd.poses, crowd.depth, crowd.removed, strict=True):
        inside, row, column, away = in_picture(other, places)
        expected = depth_in_pixel(other, row, column, places, normal, away)
        agrees = np.abs(image[row, column] - expected) < 0.03 + 0.01 * away
        shown |= inside & agrees & ~removed[row, column]
    unseen[rows[shown], columns[shown]] = False
    return unseen
