"""What tells of shadows that removed objects left in the pictures: how much darker ground is than the ground around that is seen,
and how near to a removed object a place is.

All frames show the shadow of a parked car, so that they agree on it. Beside it the photograph is as dark, so that the nearest pixel
that stays does not contradict either.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from unveil_core.base.types import Float32, Float64, Levels, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import luminance, smoothed

__all__ = ["NEAR_M", "Leftovers", "RemovedPlaces", "leftovers_of"]

GROUND_PX = 192
"""Width at which ground is looked for, pixels: of a wider frame every second pixel, or fewer. What is compared are areas of
metres, and a drive of 28 frames takes a second instead of two."""
LEVEL = 0.85
"""Upward part of its normal from which on a surface is ground: steeper than 32 degrees is no street."""
GROUND_M, CELL_M = 40.0, 0.25
"""Reach of the ground that is looked at, metres: farther off a pixel is longer than a car's shadow. And the side of its cells."""
AROUND_M = 2.5
"""Standard deviation of the ground around that a place is compared with, metres: more than a car is wide, so that its shadow does
not count alone. On nine drawn streets 2.5 m tells more than 1 m, and ground that begins 0.75 or 1.5 m beside the hole less."""
LEAST_WEIGHT = 1e-4
"""Share of the ground around that has to be seen: without any, nothing is said."""
NEAR_M = 1.0
"""Distance from a removed object at which the doubt has fallen to 37 %, metres: contact shadows reach as far. 0.5 and 3 m tell no
more."""
FAR_M = 5.0
"""Distance beyond which nothing is looked for, metres: there the doubt is below 1 %."""
THIN_M = 0.2
"""Removed surfels are thinned to one for each cube of this side, metres: a fifth of ``NEAR_M``."""
SLACK = 0.2
"""Share by which a distance may be too large: it changes the doubt by less than 0.1."""


class RemovedPlaces:
    """Where removed objects stood."""

    def __init__(self, points: Float64) -> None:
        """Args: points: (N, 3) on them."""
        cubes = np.floor(points / THIN_M).astype(np.int64)
        thinned = points[np.unique(cubes, axis=0, return_index=True)[1]] if len(points) else points
        self.tree = cKDTree(thinned) if len(thinned) else None

    def nearness(self, points: Float64) -> Float32:
        """(P,) exp(-distance / ``NEAR_M``) from points (P, 3) to the nearest removed object; 0 beyond ``FAR_M``."""
        if self.tree is None or not len(points):
            return np.zeros(len(points), dtype=np.float32)
        distance, _ = self.tree.query(points, eps=SLACK, distance_upper_bound=FAR_M)
        return np.exp(-distance / NEAR_M).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Leftovers:
    """What tells of shadows that were left in P pixels.

    Attributes:
        darker: (P,) share by which ground is darker than what is seen of the ground around; 0 where it is not, and on all else.
        near: (P,) 1 at a removed object, falling with the distance from it; 0 for the sky.
    """

    darker: Float32
    near: Float32


def leftovers_of(
    delivered: Levels, photograph: Levels, changed: Mask, depth: Float32, camera: Camera, removed: RemovedPlaces
) -> Leftovers:
    """Of the changed pixels.

    Args:
        delivered, photograph: (H, W, 3) the clean frame and what it was made of, in canonical colours.
        changed: (H, W) of P pixels that do not show the photograph; depth: (H, W) of the empty scene, metres, 0 for the sky.
    """
    rays = camera.rays()
    points = camera.centre + depth[changed][:, None].astype(np.float64) * rays[changed]
    solid = depth[changed] > 0
    near = np.zeros(len(points), dtype=np.float32)
    near[solid] = removed.nearness(points[solid])
    step = max(1, changed.shape[1] // GROUND_PX)
    coarse = (slice(None, None, step),) * 2
    flat = _is_ground(camera.centre + depth[coarse][..., None] * rays[coarse], depth[coarse], camera.centre[2])
    seen = flat & ~changed[coarse]
    known = luminance(smoothed(photograph))[coarse]
    around = _ground_around(
        camera.centre + depth[coarse][seen][:, None] * rays[coarse][seen], known[seen], camera.centre
    )
    wide = cv2.resize(flat.astype(np.uint8), changed.shape[::-1], interpolation=cv2.INTER_NEAREST).astype(bool)
    here = wide[changed]
    darker = np.zeros(len(points), dtype=np.float32)
    level = around[_cells(points[here], camera.centre)]
    luma = luminance(smoothed(delivered))[changed][here]
    darker[here] = np.where(level > 0, np.clip(1 - luma / np.maximum(level, 1), 0, 1), 0)
    return Leftovers(darker, near)


def _is_ground(points: Float64, depth: Float32, eye: float) -> Mask:
    """(H, W) which points (H, W, 3) lie on level surfaces below the camera and in reach."""
    along, down = np.zeros_like(points), np.zeros_like(points)
    along[:, 1:-1] = points[:, 2:] - points[:, :-2]
    down[1:-1] = points[2:] - points[:-2]
    normal = np.cross(along, down)
    upward = np.abs(normal[..., 2]) / np.maximum(np.linalg.norm(normal, axis=2), 1e-12)
    level: Mask = cv2.medianBlur(upward.astype(np.float32), 5) > LEVEL
    return level & (depth > 0) & (depth < GROUND_M) & (points[..., 2] < eye)


def _cells(points: Float64, centre: Float64) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of points (P, 3) in the plan around a camera; of those beside it the nearest."""
    half = int(GROUND_M / CELL_M)
    at = np.clip(np.floor((points[:, :2] - centre[:2]) / CELL_M).astype(np.int64) + half, 0, 2 * half - 1)
    return at[:, 0], at[:, 1]


def _ground_around(points: Float64, luma: Float32, centre: Float64) -> Float32:
    """(A, A) luma of the ground around each cell of the plan, of points (P, 3) that are seen; 0 where none is near."""
    side = 2 * int(GROUND_M / CELL_M)
    row, column = _cells(points, centre)
    cell = row * side + column
    count = np.bincount(cell, minlength=side * side).reshape(side, side)
    total = np.bincount(cell, luma, minlength=side * side).reshape(side, side)
    seen = count > 0
    mean = (total / np.maximum(count, 1)).astype(np.float32)
    sigma = AROUND_M / CELL_M
    weight = cv2.GaussianBlur(seen.astype(np.float32), (0, 0), sigma)
    blurred = cv2.GaussianBlur(mean, (0, 0), sigma)
    around: Float32 = np.where(weight > LEAST_WEIGHT, blurred / np.maximum(weight, LEAST_WEIGHT), 0).astype(np.float32)
    return around
