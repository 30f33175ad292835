"""The ground of a street: its height over street coordinates, and how far it reaches to both sides."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.ground.height_field import Grid, first_met
from unveil_core.ground.path import StreetPath

__all__ = ["Ground"]

NEAR_M, FAR_M = 0.3, 300.0
"""Depths between which rays meet the ground."""
MISS_M = 0.1
"""Where the path folds over itself a place has two pairs of street coordinates, and the walk may mean the other one: what is
farther from the ground than this by the pair that it gets is not met."""
RIM_M = 0.5
"""So far beyond its limits the ground is known to rays, or those to its rim would step over it."""


@dataclass(frozen=True, eq=False)
class Ground:
    """Height of the ground over street coordinates.

    Attributes:
        path: the street coordinates.
        s_start, t_start: of the grid's first cell centres; s_cell, t_cell: cell sizes, metres.
        height: (A, B) heights at cell centres.
        t_max, t_min: (A,) largest and smallest lateral offset that is still ground, per cell of arc length.
    """

    path: StreetPath
    s_start: float
    t_start: float
    s_cell: float
    t_cell: float
    height: Float64
    t_max: Float64
    t_min: Float64

    def height_at(self, s: Float64, t: Float64) -> Float64:
        """Bilinear height at street coordinates, clamped at the grid's border."""
        a = np.clip((s - self.s_start) / self.s_cell, 0, self.height.shape[0] - 1.001)
        b = np.clip((t - self.t_start) / self.t_cell, 0, self.height.shape[1] - 1.001)
        i, j = a.astype(int), b.astype(int)
        u, v = a - i, b - j
        h = self.height
        return (h[i, j] * (1 - u) + h[i + 1, j] * u) * (1 - v) + (h[i, j + 1] * (1 - u) + h[i + 1, j + 1] * u) * v

    def slope_at(self, s: Float64, t: Float64) -> tuple[Float64, Float64]:
        """How the ground rises along the street and to its left, each (N,), over two metres along it and half a metre across."""
        a, b = self.s_cell, 5 * self.t_cell
        along = (self.height_at(s + a, t) - self.height_at(s - a, t)) / (2 * a)
        return along, (self.height_at(s, t + b) - self.height_at(s, t - b)) / (2 * b)

    def over(self, street: Float64) -> Float64:
        """(N,) height of street coordinates (N, 3) over the ground."""
        height: Float64 = street[:, 2] - self.height_at(street[:, 0], street[:, 1])
        return height

    def inside(self, s: Float64, t: Float64) -> Mask:
        """Whether street coordinates lie on ground as far as anyone saw it."""
        a = np.clip(np.round((s - self.s_start) / self.s_cell).astype(int), 0, len(self.t_max) - 1)
        s_end = self.s_start + self.s_cell * (len(self.t_max) - 1)
        return (t <= self.t_max[a]) & (t >= self.t_min[a]) & (s >= self.s_start) & (s <= s_end)

    @cached_property
    def _grid(self) -> Grid:
        path, rim = self.path, 2 * round(RIM_M / self.s_cell) + 1
        return Grid(
            path.axes,
            path.nodes,
            path.travel,
            path.step,
            self.height,
            np.array([self.s_start - path.start, self.t_start]),
            np.array([self.s_cell, self.t_cell]),
            minimum_filter1d(self.t_min, rim) - RIM_M,
            maximum_filter1d(self.t_max, rim) + RIM_M,
        )

    def intersect(self, camera: Camera, rays: Float64) -> tuple[Float64, Float64]:
        """Where rays first meet the ground.

        Args:
            rays: (N, 3) world directions with unit component along the optical axis.
        Returns:
            depth (N,), inf where there is no ground; street coordinates (N, 3), zero there.
        """
        depth = first_met(self._grid, camera.centre, rays, near=NEAR_M, far=FAR_M)
        street = np.zeros((len(rays), 3))
        met = np.flatnonzero(np.isfinite(depth))
        street[met] = self.path.to_street(camera.centre + depth[met, None] * rays[met])
        good = self.inside(street[met, 0], street[met, 1]) & (np.abs(self.over(street[met])) < MISS_M)
        outside = met[~good]
        depth[outside], street[outside] = np.inf, 0.0
        return depth, street
