"""Street coordinates: arc length along the drive, lateral offset, and the height of the ground there.

A street is a surface swept along a path. In these coordinates paint, kerb and walk are nearly constant along the first
axis, curves and slopes included, which makes what is hidden predictable.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_filter1d, maximum_filter1d, median_filter, minimum_filter1d
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64
from unveil_core.geometry.axes import up_frame
from unveil_core.geometry.camera import Camera
from unveil_core.ground.height_field import HeightField

__all__ = ["Ground", "StreetPath", "fit_ground", "fit_path", "straighten_path"]

RELIEF_M, MOST_CELLS = 0.5, 8_000_000
"""Side of a cell of the relief, metres; large drives get larger ones, to have no more cells than these."""
NEAREST_M, FARTHEST_M = 0.3, 300.0
"""Depths between which rays meet the ground, metres."""
SECANTS, MISS_M = 4, 0.08
"""Steps from the relief to the surface, and how far off what they find may be, metres."""


@dataclass(frozen=True, eq=False)
class StreetPath:
    """The drive's path on the horizontal plane, extended at both ends.

    Attributes:
        axes: (3, 3) rows east, north, up.
        nodes: (S, 2) east/north of the path's nodes, one every ``step``.
        heading: (S,) radians.
        start: arc length of the first node; the first camera is at 0.
        step: metres.
        corner: (2,) east/north of the look-up's first cell centre; cell: its cell size.
        nearest: (P, Q) index of the node nearest to each cell's centre.
    """

    axes: Float64
    nodes: Float64
    heading: Float64
    start: float
    step: float
    corner: Float64
    cell: float
    nearest: NDArray[np.int64]

    @cached_property
    def _travel(self) -> tuple[Float64, Float64]:
        """Cosine and sine (S,) of the heading: there are far fewer nodes than points that ask for them."""
        return np.cos(self.heading), np.sin(self.heading)

    def node_of(self, horizontal: Float64) -> NDArray[np.int64]:
        """Index (N,) of the node nearest to points (N, 2): the cell's node, walked along the path to the point's foot."""
        grid = np.round((horizontal - self.corner) / self.cell).astype(np.int64)
        index = self.nearest[
            np.clip(grid[:, 0], 0, self.nearest.shape[0] - 1), np.clip(grid[:, 1], 0, self.nearest.shape[1] - 1)
        ]
        last = len(self.nodes) - 1
        cos, sin = self._travel
        for _ in range(3):
            gap = horizontal - self.nodes[index]
            along = gap[:, 0] * cos[index] + gap[:, 1] * sin[index]
            index = np.clip(index + np.round(along / self.step).astype(np.int64), 0, last)
        return index

    def to_street(self, points: Float64) -> Float64:
        """(N, 3) of arc length, lateral offset (left positive) and height, for world points (N, 3)."""
        local = points @ self.axes.T
        index = self.node_of(local[:, :2])
        gap = local[:, :2] - self.nodes[index]
        cos, sin = (part[index] for part in self._travel)
        along, left = gap[:, 0] * cos + gap[:, 1] * sin, -gap[:, 0] * sin + gap[:, 1] * cos
        return np.stack([self.start + index * self.step + along, left, local[:, 2]], axis=1)

    def along_street(self, s: Float64, vectors: Float64) -> Float64:
        """World vectors (N, 3) as components along the street, to its left and up, at arc lengths (N,)."""
        local = vectors @ self.axes.T
        index = np.clip(np.round((s - self.start) / self.step).astype(int), 0, len(self.nodes) - 1)
        cos, sin = (part[index] for part in self._travel)
        east, north, up = local.T
        return np.stack([east * cos + north * sin, north * cos - east * sin, up], axis=1)

    def to_world(self, street: Float64) -> Float64:
        """Inverse of :meth:`to_street`."""
        index = np.clip(np.round((street[:, 0] - self.start) / self.step).astype(int), 0, len(self.nodes) - 1)
        along = street[:, 0] - self.start - index * self.step
        cos, sin = (part[index] for part in self._travel)
        east = self.nodes[index, 0] + along * cos - street[:, 1] * sin
        north = self.nodes[index, 1] + along * sin + street[:, 1] * cos
        return np.stack([east, north, street[:, 2]], axis=1) @ self.axes


def fit_path(cameras: list[Camera], up: Float64, *, extension_m: float = 60.0) -> StreetPath:
    """Smooth the camera centres of one track into a path and prolong it with its curvature at the ends.

    Args:
        cameras: of one track, in order of travel.
        up: (3,) of the drive; extension_m: how far it is prolonged, metres.
    """
    axes = up_frame(up)
    centres = np.stack([c.centre for c in cameras]) @ axes.T
    step = 0.25
    legs = np.linalg.norm(np.diff(centres[:, :2], axis=0), axis=1) if len(centres) > 1 else np.zeros(0)
    travelled = np.concatenate([[0.0], np.cumsum(legs)])
    if travelled[-1] < 2.0:  # a standing camera looks along the street
        forward = axes @ cameras[-1].forward
        heading0 = float(np.arctan2(forward[1], forward[0]))
        nodes, heading = centres[:1, :2], np.array([heading0])
    else:
        distinct = np.concatenate([[True], legs > 1e-6])
        s = np.arange(0.0, travelled[-1], step)
        sigma = max(1.0, 2.0 / step)
        raw = [np.interp(s, travelled[distinct], centres[distinct, k]) for k in (0, 1)]
        slope = np.stack([gaussian_filter1d(np.gradient(r, step), sigma, mode="nearest") for r in raw], axis=1)
        heading = np.unwrap(np.arctan2(slope[:, 1], slope[:, 0]))
        nodes = np.stack([gaussian_filter1d(r, sigma, mode="nearest") for r in raw], axis=1)
        # Smoothing shortens the ends; walking from the middle along the headings undoes that.
        middle = len(s) // 2
        travel = np.stack([np.cos(heading), np.sin(heading)], axis=1) * step
        walked = np.cumsum(np.vstack([np.zeros((1, 2)), travel[:-1]]), axis=0)
        nodes = nodes[middle] + walked - walked[middle]
    count = int(extension_m / step)
    limit = 1.0 / 40.0

    def bend(part: Float64) -> float:
        if len(part) < 8:
            return 0.0
        slope = np.polyfit(np.arange(len(part)) * step, part, 1)[0]
        return float(np.clip(slope, -limit, limit))

    half = max(8, len(heading) // 2)
    after = heading[-1] + bend(heading[-half:]) * step * np.arange(1, count + 1)
    before = heading[0] - bend(heading[:half]) * step * np.arange(count, 0, -1)
    ahead = nodes[-1] + np.cumsum(np.stack([np.cos(after), np.sin(after)], 1) * step, axis=0)
    behind = nodes[0] - np.cumsum(np.stack([np.cos(before), np.sin(before)], 1)[::-1] * step, axis=0)[::-1]
    nodes = np.concatenate([behind, nodes, ahead])
    return _path(axes, nodes, np.concatenate([before, heading, after]), -count * step, step)


def _path(axes: Float64, nodes: Float64, heading: Float64, start: float, step: float) -> StreetPath:
    """The path with its look-up, see :class:`StreetPath`."""
    cell, margin = 1.0, 30.0
    corner = nodes.min(axis=0) - margin
    extent = np.ceil((nodes.max(axis=0) + margin - corner) / cell).astype(int) + 1
    centres = np.stack(np.meshgrid(*(np.arange(n) * cell for n in extent), indexing="ij"), axis=-1) + corner
    nearest = cKDTree(nodes).query(centres.reshape(-1, 2))[1].reshape(extent)
    return StreetPath(axes, nodes, heading, start, step, corner, cell, nearest)


def straighten_path(path: StreetPath, s: Float64, aside: Float64) -> StreetPath:
    """The path moved sideways, so that it keeps its distance from the kerb even where the car did not.

    Args:
        s: (M,) arc lengths, increasing; aside: (M,) how far to the left the path is to lie there, metres; it stays so
            beyond both ends.
    Returns:
        a path whose arc length starts where the other's does.
    """
    at = path.start + path.step * np.arange(len(path.nodes))
    # A heading must not follow each texel by which something was found beside its place.
    offset = gaussian_filter1d(np.interp(at, s, aside), 1.0 / path.step, mode="nearest")
    nodes = path.nodes + offset[:, None] * np.stack([-np.sin(path.heading), np.cos(path.heading)], axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(nodes, axis=0), axis=1))])
    even = np.arange(0.0, travelled[-1], path.step)
    nodes = np.stack([np.interp(even, travelled, nodes[:, k]) for k in (0, 1)], axis=1)
    slope = np.gradient(nodes, path.step, axis=0)
    return _path(path.axes, nodes, np.unwrap(np.arctan2(slope[:, 1], slope[:, 0])), path.start, path.step)


@dataclass(frozen=True, eq=False)
class Ground:
    """Height of the ground over street coordinates.

    Attributes:
        path: the street coordinates.
        s_start, l_start: of the grid's first cell centres; s_cell, l_cell: cell sizes, metres.
        height: (A, B) heights at cell centres.
        left, right: (A,) largest and smallest lateral offset that is still ground, per cell of arc length.
    """

    path: StreetPath
    s_start: float
    l_start: float
    s_cell: float
    l_cell: float
    height: Float64
    left: Float64
    right: Float64

    def height_at(self, s: Float64, l: Float64) -> Float64:  # noqa: E741
        """Bilinear height at street coordinates, clamped at the grid's border."""
        a = np.clip((s - self.s_start) / self.s_cell, 0, self.height.shape[0] - 1.001)
        b = np.clip((l - self.l_start) / self.l_cell, 0, self.height.shape[1] - 1.001)
        i, j = a.astype(int), b.astype(int)
        u, v = a - i, b - j
        h = self.height
        return (h[i, j] * (1 - u) + h[i + 1, j] * u) * (1 - v) + (h[i, j + 1] * (1 - u) + h[i + 1, j + 1] * u) * v

    def slope_at(self, s: Float64, l: Float64) -> tuple[Float64, Float64]:  # noqa: E741
        """How the ground rises along the street and to its left, each (N,), over a metre or two."""
        a, b = self.s_cell, 5 * self.l_cell
        along = (self.height_at(s + a, l) - self.height_at(s - a, l)) / (2 * a)
        return along, (self.height_at(s, l + b) - self.height_at(s, l - b)) / (2 * b)

    def over(self, street: Float64) -> Float64:
        """(N,) height of street coordinates (N, 3) over the ground."""
        height: Float64 = street[:, 2] - self.height_at(street[:, 0], street[:, 1])
        return height

    def inside(self, s: Float64, l: Float64) -> NDArray[np.bool_]:  # noqa: E741
        """Whether street coordinates lie on ground as far as anyone saw it."""
        a = np.clip(np.round((s - self.s_start) / self.s_cell).astype(int), 0, len(self.left) - 1)
        s_end = self.s_start + self.s_cell * (len(self.left) - 1)
        return (l <= self.left[a]) & (l >= self.right[a]) & (s >= self.s_start) & (s <= s_end)

    @cached_property
    def _relief(self) -> HeightField:
        """The ground over the horizontal plane, coarsely, NaN beside it: it leads rays over hills and crests."""
        path = self.path
        extent = (np.asarray(path.nearest.shape) - 1) * path.cell
        cell = max(RELIEF_M, float(np.sqrt(np.prod(extent) / MOST_CELLS)))
        east, north = np.meshgrid(*(np.arange(0.0, side, cell) for side in extent), indexing="ij")
        level = np.stack([east.ravel() + path.corner[0], north.ravel() + path.corner[1], np.zeros(east.size)], axis=1)
        s, l, _ = path.to_street(level @ path.axes).T  # noqa: E741
        # A cell more on each side, so that rays to the rim find it.
        beside = (
            self.inside(s, l + cell) | self.inside(s, l - cell) | self.inside(s + cell, l) | self.inside(s - cell, l)
        )
        height = np.where(beside, self.height_at(s, l), np.nan)
        return HeightField(path.axes, path.corner, cell, height.reshape(east.shape))

    def intersect(self, camera: Camera, rays: Float64) -> tuple[Float64, Float64]:
        """Where rays first meet the ground.

        Args:
            rays: (N, 3) world directions with unit component along the optical axis.
        Returns:
            depth (N,), inf where there is no ground; street coordinates (N, 3), zero there.
        """
        found = self._relief.first_met(camera.centre, rays, near=NEAREST_M, far=FARTHEST_M)
        met = np.flatnonzero(np.isfinite(found))
        street = np.zeros((len(rays), 3))
        depth = np.full(len(rays), np.inf)
        if not len(met):
            return depth, street
        start, rays = found[met], rays[met]

        def over(at: Float64) -> tuple[Float64, Float64]:
            place = self.path.to_street(camera.centre + at[:, None] * rays)
            return place, self.over(place)

        # By secants from the relief to the surface itself, kerbs included; never far from where the relief has it.
        last, now = 0.97 * start, start
        before, (place, miss) = over(last)[1], over(now)
        for _ in range(SECANTS):
            slope = miss - before
            step = np.where(np.abs(slope) > 1e-12, miss * (now - last) / np.where(slope == 0, 1.0, slope), 0.0)
            last, before = now, miss
            now = np.clip(now - np.clip(step, -0.1 * start, 0.1 * start), 0.8 * start, 1.25 * start)
            place, miss = over(now)
        good = (np.abs(miss) < MISS_M) & self.inside(place[:, 0], place[:, 1])
        depth[met] = np.where(good, now, np.inf)
        street[met] = place
        return depth, street


def fit_ground(path: StreetPath, points: Float64, *, walls: Float64 | None = None) -> Ground:
    """Height field and lateral limits from ground points.

    The height is a base along the path, plus one cross profile for the whole street (which continues kerbs under parked
    cars), plus a smooth remainder where points say so.

    Args:
        points: (P, 3) world points on the ground.
        walls: (W, 3) world points on what ends the street at its sides (facades, fences); None = the ground ends where
            nobody saw any.
    """
    s_cell, l_cell = 1.0, 0.1
    street = path.to_street(points)
    reach = min(25.0, float(np.percentile(np.abs(street[:, 1]), 99.5)) + l_cell)
    street = street[np.abs(street[:, 1]) <= reach]
    s_low, s_high = _supported(street[:, 0], s_cell)
    rows = max(2, int(np.ceil((s_high - s_low) / s_cell)) + 1)
    columns = max(3, int(np.ceil(2 * reach / l_cell)) + 1)
    a = np.clip(np.round((street[:, 0] - s_low) / s_cell).astype(int), 0, rows - 1)
    b = np.clip(np.round((street[:, 1] + reach) / l_cell).astype(int), 0, columns - 1)

    middle = np.abs(street[:, 1]) < 2.5
    base = _running_median(a[middle], street[middle, 2], rows)
    base = gaussian_filter1d(base, 1.5, mode="nearest")
    rest = street[:, 2] - base[a]
    profile = median_filter(_running_median(b, rest, columns), 3, mode="nearest")
    rest = rest - profile[b]
    # The remainder on coarser cells (1 m x 0.5 m), smoothed with its own support.
    coarse = 5
    cells = -(-columns // coarse)
    steady = np.abs(rest) < 0.4
    total, weight = np.zeros((rows, cells)), np.zeros((rows, cells))
    np.add.at(total, (a[steady], b[steady] // coarse), rest[steady])
    np.add.at(weight, (a[steady], b[steady] // coarse), 1.0)
    smooth = gaussian_filter(total, 1.2) / (gaussian_filter(weight, 1.2) + 0.3)
    centres = (np.arange(columns) - (coarse - 1) / 2) / coarse
    remainder = np.stack([np.interp(centres, np.arange(cells), row) for row in smooth])
    height = base[:, None] + profile[None, :] + remainder

    left, right = _limits(street, a, rows, reach)
    if walls is not None and len(walls) > 50:
        side = path.to_street(walls)
        over = side[:, 2] - (base[np.clip(np.round((side[:, 0] - s_low) / s_cell).astype(int), 0, rows - 1)])
        upright = (over > 0.4) & (over < 6.0) & (np.abs(side[:, 1]) < 25.0)
        left = _wall_limit(side[upright & (side[:, 1] > 0)], s_low, s_cell, left)
        right = -_wall_limit(side[upright & (side[:, 1] < 0)] * (1, -1, 1), s_low, s_cell, -right)
    return Ground(path, float(s_low), -reach, s_cell, l_cell, height, left, right)


def _supported(s: Float64, cell: float) -> tuple[float, float]:
    """First and last arc length with at least three points in a cell."""
    low = float(s.min())
    counts = np.bincount(((s - low) / cell).astype(int))
    full = np.flatnonzero(counts >= 3)
    if not len(full):
        return low, float(s.max())
    return low + cell * float(full[0]), low + cell * float(full[-1] + 1)


def _limits(street: Float64, a: NDArray[np.int64], rows: int, reach: float) -> tuple[Float64, Float64]:
    """Largest and smallest lateral offset with ground, per row; as wide behind parked rows as before and after them."""
    left, right = np.full(rows, np.nan), np.full(rows, np.nan)
    order = np.argsort(a, kind="stable")
    for row, part in zip(*_groups(a[order], street[order, 1]), strict=True):
        if len(part) >= 12:
            right[row], left[row] = np.percentile(part, [1, 99])
    known = np.isfinite(left)
    if not known.any():
        return np.full(rows, reach), np.full(rows, -reach)
    index = np.arange(rows)
    left, right = np.interp(index, index[known], left[known]), np.interp(index, index[known], right[known])
    left = gaussian_filter1d(minimum_filter1d(maximum_filter1d(left, 13), 7), 1.0)
    right = gaussian_filter1d(maximum_filter1d(minimum_filter1d(right, 13), 7), 1.0)
    return left, right


def _wall_limit(side: Float64, s_low: float, s_cell: float, fallback: Float64) -> Float64:
    """Lateral offset (positive) of the walls' foot per row, from a sliding stretch; the fallback where there is none."""
    rows = len(fallback)
    limit = np.full(rows, np.nan)
    row = np.round((side[:, 0] - s_low) / s_cell).astype(int)
    for r in range(rows):
        near = np.abs(row - r) <= 3
        if near.sum() >= 15:
            limit[r] = max(fallback[r], float(np.percentile(side[near, 1], 15)))
    known = np.flatnonzero(np.isfinite(limit))
    if not len(known):
        return fallback
    # Where no wall was seen the street is as wide as at the nearest place where one was.
    limit = limit[known[np.abs(np.arange(rows)[:, None] - known[None]).argmin(axis=1)]]
    return median_filter(np.maximum(limit, fallback), 5, mode="nearest")


def _groups(keys: NDArray[np.int64], values: Float64) -> tuple[NDArray[np.int64], list[Float64]]:
    """Split sorted keys into runs."""
    if not len(keys):
        return keys, []
    unique, first = np.unique(keys, return_index=True)
    return unique, np.split(values, first[1:])


def _running_median(index: NDArray[np.int64], values: Float64, count: int) -> Float64:
    """Median per bin (count,), gaps interpolated."""
    order = np.argsort(index, kind="stable")
    bins, parts = _groups(index[order], values[order])
    if not len(bins):
        return np.zeros(count)
    return np.interp(np.arange(count), bins, [float(np.median(p)) for p in parts])
