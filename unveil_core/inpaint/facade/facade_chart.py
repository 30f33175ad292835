"""Facade charts: the texture of the houses along one side of the street, read from the frames and completed.

Rows run along the street (arc length s), columns upwards from the ground. A facade repeats itself along the street, windows and
plinth included, and what lies above a hole says which part of it lies below. Behind a lorry, which hides a facade to its eaves, the
facades on either side of it go on, and so does the sky over them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from unveil_core.base.parallel import each
from unveil_core.base.types import Float32, Float64, Levels, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px, grow
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.surface import shown_places, surfels_on
from unveil_core.inpaint.chart.texels import Texels
from unveil_core.inpaint.facade.offsets import LOW_M, carried_on, facade_offsets, fanned_out
from unveil_core.inpaint.facade.wall_fill import fill_wall
from unveil_core.surfels.surfels import Surfels

__all__ = ["FacadeChart", "FacadeView", "InventedFacades", "invented_facades", "read_facade", "replaced_by"]

TOP_M, HIGHEST_M = 6.0, 16.0
"""Height of the charts, metres: what a car or a van hides; and up to where they reach if something close by hides more."""
COARSE_M = 0.25
"""Size of the texels by which it is found how high the chart must be, metres."""
EAVES_M, MOSTLY = 3.0, 0.8
"""Height up to which a facade of which nothing was seen must be hidden to be carried on from those beside it, metres, and how much
of it: a car hides half of that, and what is seen over it is no house."""
AGREE_M, AGREE = 0.3, 0.04
"""Difference between the scene's depth and the facade's up to which a pixel shows the facade, metres plus a share of the depth:
its relief, and the error of rendered depth. Chosen on the two sample streets."""
REPLACED_M = 0.5
"""Distance from the facade up to which surfels of a house are its own, metres: sills, recesses, and what was drawn out towards the
cameras."""
ROOF_M, ROOF_WEIGHT = 6.0, 1e-3
"""How far behind the facade a house's pixel still shows its roof, metres, and what that counts beside a view of the wall itself."""


@dataclass(frozen=True, eq=False)
class FacadeChart:
    """The texture of the facades on one side of the street.

    Attributes:
        ground: whose street coordinates these are.
        texel: size of a texel in metres; per_m: texels per metre.
        s_start: arc length of the first row's centre.
        offset: (A,) lateral offset t of the facade, NaN where no house stands.
        color: (A, B, 3) float32 sRGB in [0, 1]; meaningless where nothing is known.
        known: (A, B) bool, texels of a house that some frame shows.
        open: (A, B) bool, texels through which some frame shows the sky.
        passed: (A, B) bool, texels through which some frame shows what lies far behind: no house stands there.
        occluded: (A, B) bool, texels that lie behind something removed in some frame.
    """

    ground: Ground
    texel: float
    per_m: float
    s_start: float
    offset: Float64
    color: Float32
    known: Mask
    open: Mask
    passed: Mask
    occluded: Mask

    @property
    def unseen(self) -> Mask:
        """(A, B) texels behind something removed, of which no frame tells what is there."""
        return self.occluded & ~self.known & ~self.open & ~self.passed

    def world(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Float64:
        """(N, 3) world positions of texel centres; where no facade stands it is taken to go on from the nearest that does."""
        s, t = self.s_start + self.texel * rows, self._nearest_offset[np.clip(rows, 0, len(self.offset) - 1)]
        height = self.ground.height_at(s, t) + self.texel * (columns + 0.5)  # type: ignore[arg-type]
        return self.ground.path.to_world(np.stack([s, t, height], axis=1))

    @cached_property
    def _nearest_offset(self) -> Float64:
        stands = np.isfinite(self.offset)
        if not stands.any():
            return np.zeros_like(self.offset)
        nearest = distance_transform_edt(~stands, return_distances=False, return_indices=True)[0]
        return self.offset[nearest]

    def normal(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Float64:
        """(N, 3) unit normals there: to the street, level."""
        s, t = self.s_start + self.texel * rows, self.offset[rows]
        ends = [self.ground.path.to_world(np.column_stack([s, t * share, np.zeros(len(rows))])) for share in (0.5, 1.0)]
        normal: Float64 = ends[0] - ends[1]
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)

    def index_of(self, street: Float64) -> tuple[NDArray[np.int64], NDArray[np.int64], Mask]:
        """Nearest rows and columns of street coordinates (N, 3), and whether they lie on the facade, or close to it."""
        row = np.round((street[:, 0] - self.s_start) * self.per_m).astype(np.int64)
        column = np.floor(self.ground.over(street) * self.per_m).astype(np.int64)
        rows, columns = self.known.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        row, column = np.where(inside, row, 0), np.where(inside, column, 0)
        with np.errstate(invalid="ignore"):
            near = np.abs(street[:, 1] - self.offset[row]) < REPLACED_M
        return row, column, inside & near


@dataclass(frozen=True, eq=False)
class FacadeView:
    """What a frame shows of facades.

    Attributes:
        camera: of the frame; image: (H, W, 3) levels of 255.
        on_wall: (H, W) bool, pixels of houses; sky: (H, W) bool, of the sky.
        depth: (H, W) of the full scene, metres; removed: (H, W) bool, pixels of what is removed.
    """

    camera: Camera
    image: Levels
    on_wall: Mask
    sky: Mask
    depth: Float32
    removed: Mask


@dataclass(frozen=True, eq=False)
class InventedFacades:
    """What completes a facade.

    Attributes:
        walls: surfels of houses, None where none are missing.
        open: surfels in the facade's plane through which the sky is to be seen, None where there are none.
        filled: (A, B) bool, texels of the chart that the walls fill.
    """

    walls: Surfels | None
    open: Surfels | None
    filled: Mask


def read_facade(
    ground: Ground,
    walls: Surfels,
    views: Sequence[FacadeView],
    *,
    left: bool,
    along: tuple[float, float] = (-np.inf, np.inf),
    texel_m: float = 0.04,
    reach_m: float = 40.0,
) -> FacadeChart | None:
    """Read the facades of one side from the frames; nearer and more frontal views count more. None where no house stands.

    Args:
        walls: surfels of houses.
        left: which side of the street; along: arc lengths between which it is read.
        texel_m: texel size, metres; reach_m: how far a view looks, metres.
    """
    s = rows_between(ground, along, texel_m)
    if len(s) < 2:
        return None
    offset = facade_offsets(walls, ground, s, left=left)
    offset[fanned_out(ground, s, offset)] = np.nan
    if not np.isfinite(offset).any():
        return None
    coarse, hidden = where_hidden(ground, s, offset, views, reach_m)
    offset = carried_on(offset, hidden, texel_m)
    offset[fanned_out(ground, s, offset)] = np.nan
    lacks = coarse.unseen[np.isfinite(offset[:: _coarser(texel_m)])].any(axis=0)
    top = max(TOP_M, coarse.texel * (lacks.size - int(lacks[::-1].argmax()))) if lacks.any() else TOP_M  # type: ignore[index]
    return read_views(empty_chart(ground, s, offset, top), views, reach_m)


def rows_between(ground: Ground, along: tuple[float, float], texel_m: float) -> Float64:
    """(A,) arc lengths of a chart's rows, ``texel_m`` apart, between the ends of the street and those of ``along``."""
    end = ground.s_start + ground.s_cell * (len(ground.t_max) - 1)
    s = np.arange(ground.s_start, end, texel_m)
    return s[(s >= along[0]) & (s < along[1])]


def where_hidden(
    ground: Ground,
    s: Float64,
    offset: Float64,
    views: Sequence[FacadeView],
    reach_m: float,
) -> tuple[FacadeChart, Mask]:
    """What the views show as if something stood everywhere, in coarse texels; and (A,) where something removed hides that so far up
    that nothing tells whether it stands there.

    Args:
        s, offset: (A,) of what stands somewhere, NaN elsewhere.
    """
    known, factor = np.flatnonzero(np.isfinite(offset)), _coarser(float(s[1] - s[0]))
    everywhere = np.interp(np.arange(len(s)), known, offset[known])
    coarse = read_views(empty_chart(ground, s[::factor], everywhere[::factor], HIGHEST_M), views, reach_m)
    low, high = (int(h * coarse.per_m) for h in (LOW_M, EAVES_M))
    hidden = coarse.unseen[:, low:high].mean(axis=1) >= MOSTLY
    return coarse, np.repeat(hidden, factor)[: len(s)]


def _coarser(texel_m: float) -> int:
    """How many texels of a chart are a coarse one."""
    return max(1, round(COARSE_M / texel_m))


def empty_chart(ground: Ground, s: Float64, offset: Float64, top: float) -> FacadeChart:
    """A chart of which nothing is known, for arc lengths ``s`` (A,)."""
    texel = float(s[1] - s[0])
    shape = (len(s), int(top / texel))
    no, color = np.zeros(shape, dtype=bool), np.zeros((*shape, 3), np.float32)
    return FacadeChart(ground, texel, 1.0 / texel, float(s[0]), offset, color, no, no, no, no)


def read_views(chart: FacadeChart, views: Sequence[FacadeView], reach_m: float) -> FacadeChart:
    """The chart with what the views show of it."""
    rows, columns = (p.ravel() for p in np.indices(chart.known.shape))
    stands = np.isfinite(chart.offset)[rows]
    rows, columns = rows[stands], columns[stands]
    world = chart.world(rows, columns)
    along: Float64 = chart.s_start + chart.texel * rows.astype(np.float64)
    texels, (sky, beyond) = Texels.unseen(len(rows)), np.zeros((2, len(rows)))
    occluded = np.zeros(len(rows), dtype=bool)

    def look(i: int) -> tuple[FacadeView, NDArray[np.int64], Float64, Float64, Mask]:
        view = views[i]
        part, pixel, z = shown_places(world, along, chart.ground.path, view.camera, reach_m)
        # At the border of what is removed pixels are mixed.
        return view, part, pixel, z, ~grow(view.removed, border_px(view.camera.width, 1))

    for view, part, pixel, z, sound in each(look, range(len(views))):
        if not len(part):
            continue
        x, y = pixel.astype(np.int64).T
        occluded[part[view.removed[y, x]]] = True
        clear = sound[y, x]
        behind, agree = view.depth[y, x] - z, AGREE_M + AGREE * z
        seen = view.on_wall[y, x] & clear & (behind > -agree) & (behind < agree + ROOF_M)
        # Seen from along the street a facade is foreshortened.
        distance = np.maximum(np.linalg.norm(world[part] - view.camera.centre, axis=1), 1e-9)
        straight = np.abs(chart.offset[rows[part]]) / distance
        w = (straight / z) ** 3
        through = clear & view.sky[y, x]
        sky[part[through]] += w[through]
        past = clear & ~view.sky[y, x] & (behind > agree + ROOF_M)
        beyond[part[past]] += w[past]
        w = np.where(behind < agree, w, ROOF_WEIGHT * w)
        texels.take(part[seen], pixel[seen], w[seen], view.image)
    weight = texels.weight
    known, color = chart.known.copy(), chart.color.copy()
    open_, passed, hidden = (np.zeros_like(known) for _ in range(3))
    seen = (weight > 0) & (weight >= np.maximum(sky, beyond))
    known[rows[seen], columns[seen]] = True
    color[rows[seen], columns[seen]] = texels.color()[seen]
    open_[rows, columns] = (sky > weight) & (sky >= beyond)
    passed[rows, columns] = beyond > np.maximum(weight, sky)
    hidden[rows, columns] = occluded
    return replace(chart, color=color, known=known, open=open_, passed=passed, occluded=hidden)


def invented_facades(chart: FacadeChart, *, label: int, sh_degree: int) -> InventedFacades:
    """What completes the facades behind removed objects where nobody saw them.

    Args:
        label: of the surfels.
    """
    stands = np.isfinite(chart.offset)
    wanted = chart.unseen & stands[:, None]
    fill = fill_wall(chart.color, chart.known, wanted, chart.open, texel=chart.texel)
    walls, opened = (
        wall_surfels(chart, fill.color, part, label=label, sh_degree=sh_degree) for part in (fill.filled, fill.opened)
    )
    return InventedFacades(walls, opened, fill.filled)


def replaced_by(chart: FacadeChart, filled: Mask, walls: Surfels) -> Mask:
    """(N,) which surfels of houses lie where nobody saw the facade and it was completed: what the optimization left there, mixed
    from what hid it, would cover the completed wall.

    Args:
        filled: (A, B) texels that were completed; walls: N surfels of houses.
    """
    row, column, on_wall = chart.index_of(chart.ground.path.to_street(walls.means.double().numpy()))
    replaced: Mask = on_wall & filled[row, column]
    return replaced


def wall_surfels(chart: FacadeChart, color: Float32, part: Mask, *, label: int, sh_degree: int) -> Surfels | None:
    """Surfels for a part (A, B) of the facade, in the colours (A, B, 3); None for no part."""
    rows, columns = np.nonzero(part)
    if not len(rows):
        return None
    labels, colors = np.full(len(rows), label, dtype=np.int64), color[rows, columns]
    # A little behind the facade: at the gap's border its observed surfels cover them.
    behind = chart.texel
    return surfels_on(chart, rows, columns, colors, labels, spacing=chart.texel, sh_degree=sh_degree, behind=behind)
