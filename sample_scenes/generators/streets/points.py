"""The drive's points: what the LiDAR measured, or what structure from motion would find; coloured, thinned and written."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from sample_scenes.generators.streets.plan import SKY
from sample_scenes.generators.streets.visibility import View

ABOVE_CAMERA_M = 0.35
"""The LiDAR stands so much above the camera."""
ACROSS = 900
"""Measurements a turn of each beam: 0.4 degrees, as spinning LiDARs have at 20 Hz."""
RANGE_M = (1.2, 90.0)
FINEST_CELL_M = 0.13
MOST_POINTS = 140_000
FEATURES = 500
"""Corners a frame that structure from motion keeps."""
SFM_SIGMA = 0.0008
"""Their error in depth is this times the depth squared, metres: half a pixel of parallax over some metres of baseline."""


def measured(pose: np.ndarray, turn: tuple[np.ndarray, np.ndarray, np.ndarray], noise: float, rng: np.random.Generator) -> np.ndarray:
    """Points (P, 3) of one turn."""
    directions, ranges, labels = turn
    kept = np.isfinite(ranges) & (ranges > RANGE_M[0]) & (ranges < RANGE_M[1]) & (labels != SKY)
    # Far and grazing returns get lost.
    kept &= rng.uniform(size=len(kept)) > 0.02 + 0.25 * np.clip(np.where(kept, ranges, 0) / RANGE_M[1], 0, 1) ** 2
    origin = pose[:3, 3] + np.array([0, 0, ABOVE_CAMERA_M])
    found: np.ndarray = origin + directions[kept] * (ranges[kept] + rng.normal(0, noise, int(kept.sum())))[:, None]
    return found


def features(view: View, picture: np.ndarray, depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Points (P, 3) at corners of a picture (H, W, 3), off along the ray as triangulation is."""
    corners = cv2.goodFeaturesToTrack(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), FEATURES, 0.008, 3)
    if corners is None:
        return np.zeros((0, 3))
    column, row = corners[:, 0].astype(int).T
    far = depth[row, column]
    kept = np.isfinite(far) & (far < 60)
    column, row, far = column[kept], row[kept], far[kept]
    far = far + rng.normal(0, 1, len(far)) * (0.01 + SFM_SIGMA * far**2)
    found: np.ndarray = view.pose[:3, 3] + view.rays()[row, column] * far[:, None]
    return found


def thinned(points: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """One point a cell, of cells that grow with the distance from the cameras' places (C, 3), and not too many in all."""
    distance = np.full(len(points), np.inf)
    for centre in centres[::2]:
        distance = np.minimum(distance, np.linalg.norm(points[:, :2] - centre[:2], axis=1))
    cell = FINEST_CELL_M * np.where(distance < 9, 1.0, np.where(distance < 20, 1.6, 2.7))
    while True:
        key = np.concatenate([np.floor(points / cell[:, None]), np.round(cell[:, None] * 1000)], axis=1).astype(np.int64)
        kept = np.sort(np.unique(key, axis=0, return_index=True)[1])
        if len(kept) <= MOST_POINTS:
            found: np.ndarray = points[kept]
            return found
        cell = cell * 1.15


def colored(points: np.ndarray, views: list[View], pictures: list[np.ndarray], depths: list[np.ndarray]) -> np.ndarray:
    """(P, 3) RGB of the nearest view that shows a point, grey where none does."""
    color, best = np.full((len(points), 3), 128.0), np.full(len(points), np.inf)
    for view, picture, depth in zip(views, pictures, depths, strict=True):
        inside, row, column, away = view.in_picture(points)
        take = inside & (np.abs(depth[row, column] - away) < 0.1 + 0.01 * away) & (away < best)
        color[take], best[take] = picture[row[take], column[take], ::-1], away[take]
    return color


def write_points(points: np.ndarray, color: np.ndarray, path: Path, offset: np.ndarray) -> None:
    """A binary PLY of doubles with colours."""
    names = [(n, "<f8") for n in "xyz"] + [(n, "u1") for n in ("red", "green", "blue")]
    table = np.empty(len(points), dtype=names)
    for k in range(3):
        table["xyz"[k]] = points[:, k] + offset[k]
        table[("red", "green", "blue")[k]] = color[:, k].round()
    kinds = {"<f8": "double", "u1": "uchar"}
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property {kinds[kind]} {name}\n" for name, kind in names)
    path.write_bytes((header + "end_header\n").encode() + table.tobytes())
