"""Pictures of the house fronts along a street: what the drive saw of them, and what they must look like where nobody saw it.

Rows run along the street (arc length), columns upwards from the ground. A front repeats itself along the street, windows, plinth
and all, and what stands above a hole tells which part of it stands below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px, grow
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.street_chart import read_bilinear
from unveil_core.inpaint.facade.facade_fill import fill_facade
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels

__all__ = ["FacadeChart", "find_fronts", "invented_fronts", "read_facade"]

BIN_M, AROUND_M, LEAST = 0.25, 0.75, 12
"""Stretches whose front is found together, how far around each surfels count, metres, and how many there must be."""
LOW_M, HIGH_M = 0.3, 8.0
"""Heights over the ground between which a wall tells where its front is, metres."""
FACING, STEP_M, GAP_M = 0.7, 0.5, 6.0
"""Cosine of how far a wall may be turned from the street; fronts that differ by less are one, over gaps up to that long,
metres."""
LONG_M = 2.5
"""What is shorter is no front: a lamp's post, a pillar, metres."""
TOP_M = 6.0
"""Height of the charts, metres."""
AGREE_M, AGREE = 0.3, 0.04
"""How far the scene's depth may be from the front's, metres and as a share of it."""


@dataclass(frozen=True, eq=False)
class FacadeChart:
    """The front of the houses on one side.

    Attributes:
        ground: whose street coordinates these are.
        texel: size of a texel in metres; per_m: texels per metre.
        s_start: arc length of the first row's centre.
        front: (A,) lateral offset of the front, NaN where no house stands.
        color: (A, B, 3) float32 sRGB in [0, 1]; meaningless where nothing is known.
        known: (A, B) bool, texels that some frame shows.
        asked: (A, B) bool, texels that lie behind something removed in some frame.
    """

    ground: Ground
    texel: float
    per_m: float
    s_start: float
    front: Float64
    color: Float32
    known: Mask
    asked: Mask

    def world(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Float64:
        """(N, 3) world positions of texel centres."""
        s, t = self.s_start + self.texel * rows, self.front[rows]
        height = self.ground.height_at(s, t) + self.texel * (columns + 0.5)
        return self.ground.path.to_world(np.stack([s, t, height], axis=1))


def find_fronts(walls: Surfels, ground: Ground, s: Float64, *, left: bool) -> Float64:
    """(A,) lateral offset of the house front at arc lengths ``s`` (A,) increasing, NaN where none stands.

    Args:
        walls: surfels of houses; left: which side of the street.
    """
    path = ground.path
    means = walls.means.detach().double().numpy()
    street = path.to_street(means)
    height = ground.over(street)
    heading = path.heading[path.node_of((means @ path.axes.T)[:, :2])]
    normal = walls.normals().detach().double().numpy() @ path.axes.T
    across = np.abs(-normal[:, 0] * np.sin(heading) + normal[:, 1] * np.cos(heading))
    own = (street[:, 1] > 0) == left
    own &= (across > FACING) & (height > LOW_M) & (height < HIGH_M)
    along, aside = street[own, 0], street[own, 1]
    order = np.argsort(along)
    along, aside = along[order], aside[order]
    at = np.arange(s[0], s[-1] + BIN_M, BIN_M)
    front = np.full(len(at), np.nan)
    for k, (low, high) in enumerate(zip(*(np.searchsorted(along, at + d * AROUND_M) for d in (-1, 1)), strict=True)):
        if high - low >= LEAST:
            front[k] = np.median(aside[low:high])
    known = np.flatnonzero(np.isfinite(front))
    for a, b in zip(known, known[1:], strict=False):
        if 1 < b - a <= GAP_M / BIN_M and abs(front[b] - front[a]) < STEP_M:
            front[a : b + 1] = np.linspace(front[a], front[b], b - a + 1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.isfinite(front), [0]]).astype(np.int8)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if (last - first) * BIN_M < LONG_M:
            front[first:last] = np.nan
    place, stands = (s - at[0]) / BIN_M, np.isfinite(front)
    below, above = (np.clip(part(place).astype(int), 0, len(at) - 1) for part in (np.floor, np.ceil))
    smooth = np.interp(s, at, np.nan_to_num(front))
    return np.where(stands[below] & stands[above], smooth, np.nan)


def read_facade(
    ground: Ground, walls: Surfels, cameras: Sequence[Camera], images: Sequence[NDArray[np.uint8]], on_wall: Sequence[Mask],
    depths: Sequence[Float32], removed: Sequence[Mask], *, left: bool, texel_m: float = 0.04, reach_m: float = 40.0,
) -> FacadeChart | None:  # fmt: skip
    """Look the fronts of one side up in the frames, the nearer and straighter view counting more; None where no house stands.

    Args:
        walls: surfels of houses.
        cameras, images: the views, images (H, W, 3) uint8.
        on_wall: (H, W) bool per view, pixels of houses; depths: (H, W) of the full scene; removed: (H, W) bool.
        texel_m: texel size, metres; reach_m: how far a view looks, metres.
    """
    texel = texel_m
    end = ground.s_start + ground.s_cell * (len(ground.left) - 1)
    s = np.arange(ground.s_start, end, texel)
    front = find_fronts(walls, ground, s, left=left)
    shape = (len(s), int(TOP_M / texel_m))
    if not np.isfinite(front).any():
        return None
    empty = np.zeros(shape, dtype=bool)
    chart = FacadeChart(ground, texel, 1.0 / texel, float(s[0]), front, np.zeros((*shape, 3), np.float32), empty, empty)
    rows, columns = (p.ravel() for p in np.indices(shape))
    stands = np.isfinite(front)[rows]
    rows, columns = rows[stands], columns[stands]
    world = chart.world(rows, columns)
    total, weight, asked = np.zeros((len(rows), 3)), np.zeros(len(rows)), np.zeros(len(rows), dtype=bool)
    for camera, image, wall, depth, gone in zip(cameras, images, on_wall, depths, removed, strict=True):
        here = float(ground.path.to_street(camera.centre[None])[0, 0])
        part = np.flatnonzero(np.abs(s[rows] - here) < reach_m)
        pixel, z = camera.project(world[part])
        inside = camera.in_picture(pixel, z, nearest=0.3)
        part, pixel, z = part[inside], pixel[inside], z[inside]
        x, y = pixel.astype(np.int64).T
        asked[part[gone[y, x]]] = True
        # At the border of what is removed pixels are mixed.
        clear = ~grow(gone, border_px(camera.width, 1))[y, x]
        seen = wall[y, x] & clear & (np.abs(depth[y, x] - z) < AGREE_M + AGREE * z)
        part, pixel, z = part[seen], pixel[seen], z[seen]
        # Seen from along the street a front is squeezed.
        straight = np.abs(front[rows[part]]) / np.maximum(np.linalg.norm(world[part] - camera.centre, axis=1), 1e-9)
        w = (straight / z) ** 3
        total[part] += read_bilinear(image, pixel) * w[:, None]
        weight[part] += w
    known, color, ask = empty.copy(), chart.color.copy(), empty.copy()
    seen = weight > 0
    known[rows[seen], columns[seen]] = True
    color[rows[seen], columns[seen]] = total[seen] / weight[seen, None] / 255
    ask[rows[asked], columns[asked]] = True
    return replace(chart, color=color, known=known, asked=ask)


def invented_fronts(chart: FacadeChart, *, label: int, sh_degree: int) -> Surfels | None:
    """Surfels of the fronts that nobody saw, behind what is removed; None where none are missing.

    Args:
        label: theirs.
    """
    # Below what was seen of a front it goes on; where nothing of it was seen, nothing says so.
    stands = np.isfinite(chart.front) & chart.known.any(axis=1)
    color, filled = fill_facade(
        chart.color, chart.known, chart.asked & ~chart.known & stands[:, None], texels_per_m=chart.per_m
    )
    rows, columns = np.nonzero(filled)
    if not len(rows):
        return None
    street = np.stack([chart.s_start + chart.texel * rows, chart.front[rows]], axis=1)
    ends = [
        chart.ground.path.to_world(np.column_stack([street[:, 0], street[:, 1] * share, np.zeros(len(rows))]))
        for share in (0.5, 1.0)
    ]
    normal = ends[0] - ends[1]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # A little behind the front: at the gap's border what was seen of it covers them.
    places = chart.world(rows, columns) - chart.texel * normal
    return surfels_from_points(
        places, np.clip(np.round(color[rows, columns] * 255), 0, 255).astype(np.uint8),
        np.full(len(rows), label, dtype=np.int64), normal, np.full(len(rows), chart.texel),
        sh_degree=sh_degree, opacity=0.95, scale_factor=0.7,
    )  # fmt: skip
