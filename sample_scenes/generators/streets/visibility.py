"""Pixels and rays of a view, and which places no frame of a crowded drive shows; as the parked street's, for any camera."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

NEAR_M, NEAR_SHARE = 0.03, 0.01
"""A frame shows a place if its depth there agrees within 3 cm and 1 %."""


@dataclass(frozen=True, eq=False)
class View:
    """A pinhole camera: OpenGL camera-to-world pose (4, 4), size in pixels, field of view across in degrees."""

    pose: np.ndarray
    width: int
    height: int
    fov: float

    @property
    def focal(self) -> float:
        """Pixels."""
        return self.width / 2 / math.tan(math.radians(self.fov) / 2)

    def intrinsics(self) -> dict[str, float]:
        """As transforms.json names them."""
        return {"w": self.width, "h": self.height, "fl_x": self.focal, "fl_y": self.focal, "cx": self.width / 2, "cy": self.height / 2}

    def in_picture(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Which points (N, 3) lie in the picture, with their rows and columns (0 where not) and their depths."""
        local = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        depth = -local[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = local[:, 0] / depth * self.focal + self.width / 2, -local[:, 1] / depth * self.focal + self.height / 2
        inside = (depth > 0.3) & (x >= 0) & (y >= 0) & (x < self.width) & (y < self.height)
        return inside, np.where(inside, y, 0).astype(int), np.where(inside, x, 0).astype(int), depth

    def rays(self) -> np.ndarray:
        """(H, W, 3) world directions with unit depth."""
        x = (np.arange(self.width) + 0.5 - self.width / 2) / self.focal
        y = -(np.arange(self.height) + 0.5 - self.height / 2) / self.focal
        local = np.stack(np.broadcast_arrays(x[None, :], y[:, None], np.full((1, 1), -1.0)), axis=-1)
        found: np.ndarray = local @ self.pose[:3, :3].T
        return found


@dataclass(frozen=True, eq=False)
class Shown:
    """What a frame of the crowded drive shows: depth (H, W), and pixels (H, W) of things that are removed."""

    view: View
    depth: np.ndarray
    removed: np.ndarray


def never_seen(view: View, region: np.ndarray, depth: np.ndarray, normal: np.ndarray, crowd: list[Shown]) -> np.ndarray:
    """(H, W) pixels of a region of an empty view whose surface no frame of the crowded drive shows.

    Args:
        depth: (H, W) and normal: (H, W, 3) of what the view shows. The depth of a pixel is held against the one that the plane
            through the place has at the pixel's centre: ground at a grazing angle fills metres of depth in one pixel.
    """
    unseen = region & np.isfinite(depth)
    rows, columns = np.nonzero(unseen)
    places = view.pose[:3, 3] + view.rays()[rows, columns] * depth[rows, columns, None]
    normals = normal[rows, columns]
    left = np.arange(len(rows))
    for other in crowd:
        inside, row, column, away = other.view.in_picture(places[left])
        at = np.nonzero(inside)[0]
        row, column, away, which = row[at], column[at], away[at], left[at]
        ray = other.view.rays()[row, column]
        with np.errstate(divide="ignore", invalid="ignore"):
            plane = ((places[which] - other.view.pose[:3, 3]) * normals[which]).sum(1) / (ray * normals[which]).sum(1)
        # Seen along its edge a plane has no depth to speak of.
        expected = np.where(np.isfinite(plane) & (np.abs(plane - away) < 0.5 * away), plane, away)
        agrees = np.abs(other.depth[row, column] - expected) < NEAR_M + NEAR_SHARE * away
        shown = which[agrees & ~other.removed[row, column]]
        unseen[rows[shown], columns[shown]] = False
        left = np.setdiff1d(left, shown, assume_unique=True)
    return unseen
