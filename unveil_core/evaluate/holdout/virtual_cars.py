"""Cars that were never there: a convex body and cabin, met exactly by rays, painted like a parked car.

The paint only has to look like something that stands there: it is world-fixed and has parts, so that a reconstruction finds it
where it is, and it shows nothing of the street behind it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64
from unveil_core.ground.street import Ground

__all__ = ["HEIGHT_M", "LENGTH_M", "WIDTH_M", "CarHits", "VirtualCar", "cast_car", "paint_car", "park"]


LENGTH_M, WIDTH_M, HEIGHT_M = 4.4, 1.8, 1.5
PAINTS = ((0.55, 0.10, 0.10), (0.12, 0.22, 0.45), (0.62, 0.62, 0.60), (0.10, 0.30, 0.20), (0.70, 0.55, 0.15))
LIGHT = np.array([0.35, 0.45, 0.82])
"""Where the light comes from, in the car's own axes."""
GLASS, TYRE = (0.13, 0.15, 0.17), (0.06, 0.06, 0.06)


@dataclass(frozen=True, eq=False)
class VirtualCar:
    """A car on the ground.

    Attributes:
        centre: (3,) world position of the middle of its floor.
        axes: (3, 3) rows forward, left and up, in the world.
        number: 1, 2, ... of this drive's cars; chooses the paint.
        s, t: street coordinates of its middle, metres.
    """

    centre: Float64
    axes: Float64
    number: int
    s: float
    t: float

    def corners(self) -> Float64:
        """(8, 3) world corners of its box."""
        signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 3)
        local = signs * (LENGTH_M / 2, WIDTH_M / 2, HEIGHT_M)
        return self.centre + local @ self.axes


@dataclass(frozen=True, eq=False)
class CarHits:
    """Where M rays meet a car.

    Attributes:
        depth: (M,) along the rays, inf where they miss.
        normal: (M, 3) outward in the car's axes, 0 where they miss.
        cabin: (M,) bool, the cabin and not the body is met.
    """

    depth: Float64
    normal: Float64
    cabin: NDArray[np.bool_]


def park(ground: Ground, s: float, t: float, *, number: int) -> VirtualCar:
    """A car along the path at street coordinates, level across and as steep as the street along."""
    half = 0.35 * LENGTH_M
    street = np.array([[s - half, t, 0.0], [s + half, t, 0.0], [s, t, 0.0]])
    street[:, 2] = ground.height_at(street[:, 0], street[:, 1])
    back, front, middle = ground.path.to_world(street)
    forward = (front - back) / np.linalg.norm(front - back)
    left = np.cross(ground.path.axes[2], forward)
    left /= np.linalg.norm(left)
    return VirtualCar(middle, np.stack([forward, left, np.cross(forward, left)]), number, s, t)


@cache
def _planes() -> tuple[tuple[Float64, Float64], tuple[Float64, Float64]]:
    """Body and cabin as half-spaces ``normals (P, 3) @ p <= offsets (P,)``, metres, x forward, y left, z up."""

    def through(*planes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> tuple[Float64, Float64]:
        normals = np.array([n for n, _ in planes], dtype=np.float64)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals, np.sum(normals * np.array([p for _, p in planes]), axis=1)

    length, width = LENGTH_M / 2, WIDTH_M / 2
    body = through(
        ((1, 0, 0), (length, 0, 0)), ((-1, 0, 0), (-length, 0, 0)), ((0, 1, 0), (0, width, 0)),
        ((0, -1, 0), (0, -width, 0)), ((0, 0, 1), (0, 0, 0.9)), ((0, 0, -1), (0, 0, 0)),
        # Bonnet and boot slope, the corners are cut: seen from above it is no rectangle.
        ((0.25, 0, 1), (length, 0, 0.7)), ((-0.3, 0, 1), (-length, 0, 0.75)),
        *(((sx, sy, 0), (sx * (length - 0.3), sy * width, 0)) for sx in (-1, 1) for sy in (-1, 1)),
    )  # fmt: skip
    cabin = through(
        ((0, 0, 1), (0, 0, HEIGHT_M)), ((0, 0, -1), (0, 0, 0.85)),
        ((0.65, 0, 0.75), (1.15, 0, 0.85)), ((-0.65, 0, 0.6), (-1.95, 0, 0.85)),
        ((0, 1, 0.3), (0, width - 0.02, 0.85)), ((0, -1, 0.3), (0, 0.02 - width, 0.85)),
        ((0, 0.6, 1), (0, 0.62, HEIGHT_M - 0.03)), ((0, -0.6, 1), (0, -0.62, HEIGHT_M - 0.03)),
        ((0.35, 0, 1), (0.3, 0, HEIGHT_M - 0.02)), ((-0.35, 0, 1), (-1.1, 0, HEIGHT_M - 0.02)),
    )  # fmt: skip
    return body, cabin


def cast_car(car: VirtualCar, origin: Float64, rays: Float64) -> CarHits:
    """Meet a car by rays.

    Args:
        origin: (3,) world; rays: (M, 3) world directions, whose unit is that of the depths.
    """
    start = car.axes @ (origin - car.centre)
    direction = rays @ car.axes.T
    depth = np.full(len(rays), np.inf)
    normal = np.zeros((len(rays), 3))
    cabin = np.zeros(len(rays), dtype=bool)
    for kind, (normals, offsets) in enumerate(_planes()):
        slope = direction @ normals.T
        room = offsets - normals @ start
        with np.errstate(divide="ignore", invalid="ignore"):
            at = room / slope
        enters = np.where(slope < 0, at, -np.inf)
        leaves = np.where(slope > 0, at, np.where((slope == 0) & (room < 0), -np.inf, np.inf))
        face = enters.argmax(axis=1)
        enter = enters[np.arange(len(rays)), face]
        hit = (enter > 0) & (enter <= leaves.min(axis=1)) & (enter < depth)
        depth[hit], normal[hit], cabin[hit] = enter[hit], normals[face[hit]], bool(kind)
    return CarHits(depth, normal, cabin)


def paint_car(car: VirtualCar, origin: Float64, rays: Float64, hits: CarHits) -> NDArray[np.uint8]:
    """(M, 3) sRGB of what rays show of a car, black where they miss: paint, glass and tyres under one light."""
    met = np.isfinite(hits.depth)
    local = (origin + np.where(met, hits.depth, 0.0)[:, None] * rays - car.centre) @ car.axes.T
    color = np.broadcast_to(PAINTS[(car.number - 1) % len(PAINTS)], local.shape).copy()
    # A little dirt, the same from everywhere, so that plain sheet metal has something to be found by.
    dirt = np.sin(9.1 * local[:, 0] + 4 * local[:, 2]) * np.sin(7.3 * local[:, 1] - 5.7 * local[:, 2])
    color *= (1 + 0.12 * dirt + 0.08 * np.sin(31 * local[:, 0]) * np.sin(27 * local[:, 2] + 11 * local[:, 1]))[:, None]
    window = hits.cabin & (local[:, 2] > 0.95) & (local[:, 2] < 1.38) & (hits.normal[:, 2] < 0.8)
    window &= np.abs(local[:, 0] + 0.35) > 0.06  # the post between the doors
    color[window] = GLASS
    for middle in (-1.35, 1.35):
        wheel = (local[:, 0] - middle) ** 2 + (local[:, 2] - 0.32) ** 2
        color[(wheel < 0.32**2) & (wheel > 0.15**2) & (np.abs(hits.normal[:, 1]) > 0.9)] = TYRE
    shade = 0.45 + 0.55 * np.clip(hits.normal @ (LIGHT / np.linalg.norm(LIGHT)), 0, 1)
    painted = np.where(met[:, None], color * shade[:, None], 0.0)
    return np.clip(np.round(painted * 255), 0, 255).astype(np.uint8)
