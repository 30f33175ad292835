"""A height field over the horizontal plane, and where rays first meet it."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,untyped-decorator"
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit, prange
from scipy.ndimage import map_coordinates

from unveil_core.base.types import Float64

__all__ = ["HeightField"]

STEPS, HALVINGS = 100, 6
"""A ray looks for the ground at so many depths, each a constant factor beyond the last; between the two about the ground it
halves the way so often."""


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
    def _top(self) -> float:
        return float(np.nanmax(self.height, initial=-np.inf))

    def height_at(self, horizontal: Float64) -> Float64:
        """(N,) bilinear height at east, north (N, 2); NaN where nobody knows."""
        where = ((horizontal - self.corner) / self.cell).T
        found: Float64 = map_coordinates(self.height, where, order=1, mode="constant", cval=np.nan)
        return found

    def first_met(self, centre: Float64, rays: Float64, *, near: float, far: float) -> Float64:
        """(N,) how far along each ray (N, 3) from ``centre`` (3,) it first comes from above to below the field; inf if never.

        Args:
            near, far: multiples of a ray between which it is looked at.
        """
        return _first_met(
            np.ascontiguousarray(self.height), self._top, np.ascontiguousarray(self.corner), float(self.cell),
            self.axes @ centre, np.ascontiguousarray(rays @ self.axes.T), float(near), float(far),
        )  # fmt: skip


@njit(cache=True, inline="always")
def _over(height, corner, cell, x, y, z):
    """How high a place is over the field, NaN where nobody knows."""
    a, b = (x - corner[0]) / cell, (y - corner[1]) / cell
    rows, columns = height.shape
    if not (0 <= a <= rows - 1 and 0 <= b <= columns - 1):
        return np.nan
    i, j = min(int(a), rows - 2), min(int(b), columns - 2)
    u, v = a - i, b - j
    low = height[i, j] * (1 - v) + height[i, j + 1] * v
    high = height[i + 1, j] * (1 - v) + height[i + 1, j + 1] * v
    return z - (low * (1 - u) + high * u)


@njit(cache=True, parallel=True)
def _first_met(height, top, corner, cell, centre, rays, near, far):
    found = np.full(len(rays), np.inf)
    factor = (far / near) ** (1.0 / (STEPS - 1))
    for k in prange(len(rays)):
        east, north, rise = rays[k]
        over, last, now = np.nan, near, near
        for _ in range(STEPS):
            z = centre[2] + now * rise
            if rise >= 0 and z > top:
                break
            here = _over(height, corner, cell, centre[0] + now * east, centre[1] + now * north, z)
            if here <= 0 and over > 0:
                for _ in range(HALVINGS):
                    middle = 0.5 * (last + now)
                    between = _over(
                        height, corner, cell, centre[0] + middle * east, centre[1] + middle * north,
                        centre[2] + middle * rise,
                    )  # fmt: skip
                    if between > 0:
                        last = middle
                    else:
                        now = middle
                found[k] = 0.5 * (last + now)
                break
            over, last, now = here, now, now * factor
    return found
