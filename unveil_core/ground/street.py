"""The ground of a street: its height over street coordinates, and how far it reaches to both sides and on ahead."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.reach import centres_of
from unveil_core.ground.height_field import Grid, first_met
from unveil_core.ground.path import StreetPath

__all__ = ["Ground", "as_far_as_shown"]

NEAR_M, FAR_M = 0.3, 300.0
"""Depths between which rays meet the ground."""
MISS_M = 0.1
"""Where the path folds over itself a place has two pairs of street coordinates, and the walk may mean the other one: what is
farther from the ground than this by the pair that it gets is not met."""
RIM_M = 0.5
"""So far beyond its limits the ground is known to rays, or those to its rim would step over it."""
GRADE_M = 20.0
"""Length of street of which the ground beyond its end has the grade, metres: over it a height wrong by a decimetre at the end leads
the ground a pixel or two astray."""
LANE = np.arange(-2.5, 2.51, 0.5)
"""Lateral offsets at which it is asked whether the street goes on, metres: the car's own lane."""


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

    def prolonged(self, cells: int) -> Ground:
        """The ground so many cells farther along the street: as steep as at its end, and as wide."""
        middle = self.height[-1 - round(GRADE_M / self.s_cell) :, self.height.shape[1] // 2]
        grade = np.polyfit(np.arange(len(middle)), middle, 1)[0] if len(middle) > 1 else 0.0
        more = self.height[-1] + grade * np.arange(1, cells + 1)[:, None]
        width = [np.append(limit, np.full(cells, limit[-1])) for limit in (self.t_max, self.t_min)]
        return replace(self, height=np.concatenate([self.height, more]), t_max=width[0], t_min=width[1])


def as_far_as_shown(
    ground: Ground,
    cameras: Sequence[Camera],
    labels: Sequence[NDArray[np.int64]],
    kinds: Sequence[int],
    passing: Sequence[int],
    reach: float,
) -> Ground:
    """The ground prolonged to where frames still show that the street goes on, by their labels: photographs tell no heights as far
    off as they show asphalt.

    Args:
        cameras, labels: of the frames, labels (H, W), negative = unknown.
        kinds: labels of ground; passing: of what could be removed, which tells neither way.
        reach: no farther from a camera, metres.
    """
    s_end = ground.s_start + ground.s_cell * (len(ground.t_max) - 1)
    s_of_camera = ground.path.to_street(centres_of(cameras))[:, 0]
    cells = int((s_of_camera.max() + reach - s_end) / ground.s_cell)
    if cells < 1 or not kinds:
        return ground
    longer = ground.prolonged(cells)
    s = np.repeat(s_end + ground.s_cell * np.arange(1, cells + 1), len(LANE))
    t = np.tile(LANE, cells)
    world = ground.path.to_world(np.stack([s, t, longer.height_at(s, t)], axis=1))
    looks = np.zeros((3, cells), dtype=np.int64)
    for v in np.flatnonzero(np.abs(s_of_camera - s_end) < 2 * reach).tolist():
        index, pixel, _ = cameras[v].shown(world, nearest=NEAR_M, furthest=reach)
        if not len(index):
            continue
        shown = labels[v][pixel[:, 1].astype(np.int64), pixel[:, 0].astype(np.int64)]
        for what, among in enumerate((np.isin(shown, kinds), np.isin(shown, passing), shown >= 0)):
            np.add.at(looks[what], index[among] // len(LANE), 1)
    street, hidden, known = looks
    on = np.cumsum((street + hidden <= known / 2) | (known == 0)) == 0
    last = np.flatnonzero(on & (street > (known - hidden) / 2))
    return ground.prolonged(int(last[-1]) + 1) if len(last) else ground
