"""Height grids of the ground, and the ray march that intersects them.

The grid lies over the horizontal plane, or along a path, in street coordinates: the plane is the case of a path with a single
node. So the street, the terrain around it and the ground that points alone tell of are met by rays in the same way.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import map_coordinates

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import in_parallel
from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.camera import Camera

__all__ = ["Grid", "HeightField", "first_met"]

STEPS, HALVINGS = 100, 6
"""A ray looks for the ground at no more than so many depths, each at least a constant factor beyond the last (7 % from 0.3 to
300 m); between the two about the ground it halves the way so often and then goes straight: to a thousandth of the depth."""
DOWN = 0.78
"""Share of the way to the highest ground that a ray is not looked at: on level ground that is met where it is highest, and a place
over it has to be seen first. With this share two steps lie about level ground evenly, so that of rays that meet it near its rim as
few as can be step over it (3 % more were lost with 0.75)."""
STEEP = 1.5
"""The ground rises by no more than this a metre: a ray high over it need not look for it sooner. Kerbs are steeper, but low."""
CHUNK = 4096
"""Rays that a thread takes at a time."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Heights on a grid along a way.

    Attributes:
        axes: (3, 3) rows east, north, up.
        nodes: (S, 2) east and north of the way's nodes; travel: (S, 2) cosine and sine of its heading there; step: between nodes.
            With one node it is a straight line without ends.
        height: (A, B) along up, at places along the way and aside of it (left), NaN where nobody knows.
        first: (2,) of the first height, along from the first node and aside; cell: (2,) between heights.
        low, high: (A,) how far aside the ground reaches; beyond the grid it is as high as at its border.
    """

    axes: Float64
    nodes: Float64
    travel: Float64
    step: float
    height: Float64
    first: Float64
    cell: Float64
    low: Float64
    high: Float64

    @cached_property
    def top(self) -> float:
        """The highest place."""
        return float(np.nanmax(self.height, initial=-np.inf))


def first_met(grid: Grid, centre: Float64, rays: Float64, *, near: float, far: float) -> Float64:
    """(N,) how far along each ray it first comes from above to below the ground; inf if never.

    Args:
        centre: (3,) where the rays (N, 3) start.
        near, far: multiples of a ray between which it is looked at.
    """
    found = np.full(len(rays), np.inf)
    start = grid.axes @ centre
    node = int(np.linalg.norm(grid.nodes - start[:2], axis=1).argmin())
    in_parallel(
        _walk,
        len(rays),
        CHUNK,
        found,
        np.ascontiguousarray(rays @ grid.axes.T),
        start,
        node,
        *(np.ascontiguousarray(part, dtype=np.float64) for part in (grid.nodes, grid.travel)),
        float(grid.step),
        *(
            np.ascontiguousarray(part, dtype=np.float64)
            for part in (grid.height, grid.first, grid.cell, grid.low, grid.high)
        ),
        grid.top,
        float(near),
        float(far),
    )
    return found


@dataclass(frozen=True, eq=False)
class HeightField:
    """Heights over the horizontal plane.

    Attributes:
        axes: (3, 3) rows east, north, up.
        corner: (2,) east and north of the first cell's centre; cell: side of a cell; metres.
        height: (A, B) along up at the cells' centres, NaN where nobody knows.
    """

    axes: Float64
    corner: Float64
    cell: float
    height: Float64

    @cached_property
    def _grid(self) -> Grid:
        rows, columns = self.height.shape
        return Grid(
            self.axes,
            self.corner[None],
            np.array([[1.0, 0.0]]),
            1.0,
            self.height,
            np.zeros(2),
            np.full(2, self.cell),
            np.zeros(rows),
            np.full(rows, (columns - 1) * self.cell),
        )

    def height_at(self, horizontal: Float64) -> Float64:
        """(N,) bilinear height at east, north (N, 2); NaN where nobody knows."""
        where = ((horizontal - self.corner) / self.cell).T
        found: Float64 = map_coordinates(self.height, where, order=1, mode="constant", cval=np.nan)
        return found

    def over(self, points: Float64) -> Float64:
        """(N,) height of world points (N, 3) over the ground below them; NaN where nobody knows it."""
        local = points @ self.axes.T
        over: Float64 = local[:, 2] - self.height_at(local[:, :2])
        return over

    def first_met(self, centre: Float64, rays: Float64, *, near: float, far: float) -> Float64:
        """(N,) how far along each ray (N, 3) from ``centre`` (3,) it first comes from above to below the field; inf if never.

        Args:
            near, far: multiples of a ray between which it is looked at.
        """
        return first_met(self._grid, centre, rays, near=near, far=far)

    def depth(self, camera: Camera, pixels: Mask, *, near: float, far: float) -> Float64:
        """Where a camera's rays first meet the field from above.

        Args:
            pixels: (H, W), whose rays are asked.
            near, far: depths between which they are, metres.
        Returns:
            (H, W) depth along the optical axis, inf where there is none or was not asked.
        """
        out = np.full(pixels.shape, np.inf)
        out[pixels] = self.first_met(camera.centre, camera.rays()[pixels], near=near, far=far)
        return out


@njit(cache=True, nogil=True, inline="always")
def _foot(nodes, travel, step, node, x, y):
    """The node beside a place, sought from another one near it."""
    last = len(nodes) - 1
    for _ in range(4):
        along = (x - nodes[node, 0]) * travel[node, 0] + (y - nodes[node, 1]) * travel[node, 1]
        there = min(max(node + int(np.floor(along / step + 0.5)), 0), last)
        if there == node:
            break
        node = there
    return node


@njit(cache=True, nogil=True, inline="always")
def _over(nodes, travel, step, height, first, cell, low, high, node, x, y, z):
    """How high a place is over the ground, NaN where nobody knows."""
    east, north = x - nodes[node, 0], y - nodes[node, 1]
    along = node * step + east * travel[node, 0] + north * travel[node, 1]
    aside = north * travel[node, 0] - east * travel[node, 1]
    rows, columns = height.shape
    a = (along - first[0]) / cell[0]
    if not -0.5 <= a <= rows - 0.5:
        return np.nan
    a = min(max(a, 0.0), rows - 1.0)
    row = int(a + 0.5)
    if not low[row] <= aside <= high[row]:
        return np.nan
    b = min(max((aside - first[1]) / cell[1], 0.0), columns - 1.0)
    i, j = min(int(a), rows - 2), min(int(b), columns - 2)
    u, v = a - i, b - j
    lower = height[i, j] * (1 - v) + height[i, j + 1] * v
    upper = height[i + 1, j] * (1 - v) + height[i + 1, j + 1] * v
    return z - (lower * (1 - u) + upper * u)


@njit(cache=True, nogil=True)
def _walk(
    begin, stop, found, rays, start, first_node, nodes, travel, step, height, first, cell, low, high, top, near, far
):
    factor = (far / near) ** (1.0 / (STEPS - 1))
    for k in range(begin, stop):
        east, north, rise = rays[k, 0], rays[k, 1], rays[k, 2]
        closing = max(STEEP * np.sqrt(east * east + north * north) - min(rise, 0.0), 1e-9)
        # Nothing is met over the highest ground: a ray comes down most of the way to it at once.
        now = max(near, DOWN * (start[2] - top) / -rise) if rise < 0 else near
        over, last, node = np.nan, now, first_node
        while now <= far:
            z = start[2] + now * rise
            if rise >= 0 and z > top:
                break
            x, y = start[0] + now * east, start[1] + now * north
            node = _foot(nodes, travel, step, node, x, y)
            here = _over(nodes, travel, step, height, first, cell, low, high, node, x, y, z)
            if here <= 0 and over > 0:
                for _ in range(HALVINGS):
                    middle = 0.5 * (last + now)
                    x, y = start[0] + middle * east, start[1] + middle * north
                    node = _foot(nodes, travel, step, node, x, y)
                    between = _over(
                        nodes, travel, step, height, first, cell, low, high, node, x, y, start[2] + middle * rise
                    )
                    if between > 0:
                        last, over = middle, between
                    elif between <= 0:
                        now, here = middle, between
                    else:  # unknown in between: nothing says on which side of it the ground is met
                        break
                found[k] = last + (now - last) * over / (over - here)
                break
            over, last = here, now
            now = max(now * factor, now + here / closing) if here > 0 else now * factor
