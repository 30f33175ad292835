"""Facade charts: the texture of the houses along one side of the street, read from the frames and completed.

Rows run along the street (arc length s), columns upwards from the ground. A facade repeats itself along the street, windows and
plinth included, and what lies above a hole says which part of it lies below.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px, grow, sample_at
from unveil_core.ground.street import Ground
from unveil_core.inpaint.facade.facade_fill import fill_facade
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels

__all__ = ["FacadeChart", "FacadeView", "facade_offsets", "invented_facades", "read_facade"]

BIN_M, AROUND_M, LEAST = 0.25, 0.75, 12
"""Spacing along s at which the facade's offset is found, half length of the stretch whose surfels count for it, metres, and
how many there must be. Chosen on the two sample streets."""
LOW_M, HIGH_M = 0.3, 8.0
"""Heights over the ground between which a wall's surfels give the facade's offset, metres: over kerbs and shrubs, under roofs."""
FACING = 0.7
"""Cosine of the angle by which a wall may be turned from the street: 45 degrees."""
STEP_M, GAP_M = 0.5, 6.0
"""Difference of offset under which two stretches are one facade, over a gap up to the second, metres: the projection of a bay,
and a van's length. Chosen on the two sample streets."""
LONG_M = 2.5
"""Shortest facade along s, metres: shorter things that are labelled as building are posts and pillars."""
TOP_M = 6.0
"""Height of the charts, metres: what a car or a van hides. A lorry close by hides more, which is left to the single-image
inpainter."""
NEAREST_M = 0.3
"""Depth in front of which a camera shows no facade, metres."""
AGREE_M, AGREE = 0.3, 0.04
"""Difference between the scene's depth and the facade's up to which a pixel shows the facade, metres plus a share of the depth:
its relief, and the error of rendered depth. Chosen on the two sample streets."""


@dataclass(frozen=True, eq=False)
class FacadeChart:
    """The texture of the facades on one side of the street.

    Attributes:
        ground: whose street coordinates these are.
        texel: size of a texel in metres; per_m: texels per metre.
        s_start: arc length of the first row's centre.
        offset: (A,) lateral offset t of the facade, NaN where no house stands.
        color: (A, B, 3) float32 sRGB in [0, 1]; meaningless where nothing is known.
        known: (A, B) bool, texels that some frame shows.
        occluded: (A, B) bool, texels that lie behind something removed in some frame.
    """

    ground: Ground
    texel: float
    per_m: float
    s_start: float
    offset: Float64
    color: Float32
    known: Mask
    occluded: Mask

    def world(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Float64:
        """(N, 3) world positions of texel centres."""
        s, t = self.s_start + self.texel * rows, self.offset[rows]
        height = self.ground.height_at(s, t) + self.texel * (columns + 0.5)
        return self.ground.path.to_world(np.stack([s, t, height], axis=1))


@dataclass(frozen=True, eq=False)
class FacadeView:
    """What a frame shows of facades.

    Attributes:
        camera: of the frame; image: (H, W, 3) uint8.
        on_wall: (H, W) bool, pixels of houses.
        depth: (H, W) of the full scene, metres; removed: (H, W) bool, pixels of what is removed.
    """

    camera: Camera
    image: NDArray[np.uint8]
    on_wall: Mask
    depth: Float32
    removed: Mask


def facade_offsets(walls: Surfels, ground: Ground, s: Float64, *, left: bool) -> Float64:
    """(A,) lateral offset of the facade at arc lengths ``s`` (A,) increasing, NaN where no house stands.

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
    facing = (street[:, 1] > 0) == left
    facing &= (across > FACING) & (height > LOW_M) & (height < HIGH_M)
    along, aside = street[facing, 0], street[facing, 1]
    order = np.argsort(along)
    along, aside = along[order], aside[order]
    at = np.arange(s[0], s[-1] + BIN_M, BIN_M)
    offset = np.full(len(at), np.nan)
    for k, (low, high) in enumerate(zip(*(np.searchsorted(along, at + d * AROUND_M) for d in (-1, 1)), strict=True)):
        if high - low >= LEAST:
            offset[k] = np.median(aside[low:high])
    known = np.flatnonzero(np.isfinite(offset))
    for a, b in zip(known, known[1:], strict=False):
        if 1 < b - a <= GAP_M / BIN_M and abs(offset[b] - offset[a]) < STEP_M:
            offset[a : b + 1] = np.linspace(offset[a], offset[b], b - a + 1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.isfinite(offset), [0]]).astype(np.int8)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if (last - first) * BIN_M < LONG_M:
            offset[first:last] = np.nan
    place, stands = (s - at[0]) / BIN_M, np.isfinite(offset)
    below, above = (np.clip(part(place).astype(int), 0, len(at) - 1) for part in (np.floor, np.ceil))
    smooth = np.interp(s, at, np.nan_to_num(offset))
    return np.where(stands[below] & stands[above], smooth, np.nan)


def read_facade(
    ground: Ground,
    walls: Surfels,
    views: Sequence[FacadeView],
    *,
    left: bool,
    texel_m: float = 0.04,
    reach_m: float = 40.0,
) -> FacadeChart | None:
    """Read the facades of one side from the frames; nearer and more frontal views count more. None where no house stands.

    Args:
        walls: surfels of houses.
        left: which side of the street.
        texel_m: texel size, metres; reach_m: how far a view looks, metres.
    """
    end = ground.s_start + ground.s_cell * (len(ground.t_max) - 1)
    s = np.arange(ground.s_start, end, texel_m)
    offset = facade_offsets(walls, ground, s, left=left)
    shape = (len(s), int(TOP_M / texel_m))
    if not np.isfinite(offset).any():
        return None
    empty = np.zeros(shape, dtype=bool)
    chart = FacadeChart(
        ground, texel_m, 1.0 / texel_m, float(s[0]), offset, np.zeros((*shape, 3), np.float32), empty, empty
    )
    rows, columns = (p.ravel() for p in np.indices(shape))
    stands = np.isfinite(offset)[rows]
    rows, columns = rows[stands], columns[stands]
    world = chart.world(rows, columns)
    total, weight, occluded = np.zeros((len(rows), 3)), np.zeros(len(rows)), np.zeros(len(rows), dtype=bool)
    for view in views:
        here = float(ground.path.to_street(view.camera.centre[None])[0, 0])
        part = np.flatnonzero(np.abs(s[rows] - here) < reach_m)
        pixel, z = view.camera.project(world[part])
        inside = view.camera.in_picture(pixel, z, nearest=NEAREST_M)
        part, pixel, z = part[inside], pixel[inside], z[inside]
        x, y = pixel.astype(np.int64).T
        occluded[part[view.removed[y, x]]] = True
        # At the border of what is removed pixels are mixed.
        clear = ~grow(view.removed, border_px(view.camera.width, 1))[y, x]
        seen = view.on_wall[y, x] & clear & (np.abs(view.depth[y, x] - z) < AGREE_M + AGREE * z)
        part, pixel, z = part[seen], pixel[seen], z[seen]
        # Seen from along the street a facade is foreshortened.
        distance = np.maximum(np.linalg.norm(world[part] - view.camera.centre, axis=1), 1e-9)
        straight = np.abs(offset[rows[part]]) / distance
        w = (straight / z) ** 3
        total[part] += sample_at(view.image, pixel) * w[:, None]
        weight[part] += w
    known, color, hidden = empty.copy(), chart.color.copy(), empty.copy()
    seen = weight > 0
    known[rows[seen], columns[seen]] = True
    color[rows[seen], columns[seen]] = total[seen] / weight[seen, None] / 255
    hidden[rows[occluded], columns[occluded]] = True
    return replace(chart, color=color, known=known, occluded=hidden)


def invented_facades(chart: FacadeChart, *, label: int, sh_degree: int) -> Surfels | None:
    """Surfels for the parts of facades behind removed objects that nobody saw; None where none are missing.

    Args:
        label: of the surfels.
    """
    # Below its observed part a facade goes on; where no part was observed, nothing says so.
    stands = np.isfinite(chart.offset) & chart.known.any(axis=1)
    color, filled = fill_facade(
        chart.color, chart.known, chart.occluded & ~chart.known & stands[:, None], texels_per_m=chart.per_m
    )
    rows, columns = np.nonzero(filled)
    if not len(rows):
        return None
    street = np.stack([chart.s_start + chart.texel * rows, chart.offset[rows]], axis=1)
    ends = [
        chart.ground.path.to_world(np.column_stack([street[:, 0], street[:, 1] * share, np.zeros(len(rows))]))
        for share in (0.5, 1.0)
    ]
    normal = ends[0] - ends[1]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # A little behind the facade: at the gap's border its observed surfels cover them.
    places = chart.world(rows, columns) - chart.texel * normal
    return surfels_from_points(
        places,
        np.clip(np.round(color[rows, columns] * 255), 0, 255).astype(np.uint8),
        np.full(len(rows), label, dtype=np.int64),
        normal,
        np.full(len(rows), chart.texel),
        sh_degree=sh_degree,
        opacity=0.95,
        scale_factor=0.7,
    )
