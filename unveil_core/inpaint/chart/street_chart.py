"""The chart: the ground's texture in street coordinates (s, t), read from the frames.

Rows run along the street (arc length s), columns across it (lateral offset t, to the left). It is relit and filled once for the
whole drive; frames then sample it, so that what is invented is the same in all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.parallel import each
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float32, Float64, Levels, Mask
from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.surface import shown_places
from unveil_core.inpaint.chart.texels import NearestLooks, Texels
from unveil_core.semantics.classes import GROUND_CLASSES, LabelSet

__all__ = [
    "INVENTED",
    "OBSERVED",
    "OUTSIDE",
    "READ_M",
    "RELIT",
    "RELIT_GAIN",
    "TEXEL_M",
    "StreetChart",
    "arc_lengths",
    "read_chart",
    "rows_of",
    "usable_pixels",
]

OUTSIDE, OBSERVED, RELIT, INVENTED = 0, 1, 2, 3
"""Where a texel's colour comes from: nowhere (off the ground), the frames, the frames with a shadow taken away, the filling."""
RELIT_GAIN = 1.045
"""Gain above which ground counts as relit: two per cent of a code, five levels of 255 in bright asphalt, are not seen."""
TEXEL_M = 0.04
"""Size of a texel, metres: joints of paving are 1 to 2 cm wide, kerbs and paint 10."""
READ_M = 45.0
"""How far a view is read, metres: farther off a pixel of 384 across covers metres of street."""


PLANES = ("color", "label", "source", "gain", "nearest", "replaced")


ALIKE = 0.08
"""Of its depth, by which the scene may lie before the ground and be it all the same."""


@dataclass(frozen=True, eq=False)
class StreetChart:
    """The ground's texture in street coordinates.

    Attributes:
        ground: what it lies on.
        texel: size of a texel in metres.
        s_start, t_start: street coordinates of the first texel's centre.
        color: (A, B, 3) float32 sRGB in [0, 1]; meaningless where ``source`` is OUTSIDE.
        label: (A, B) int16 compact labels, -1 unknown.
        source: (A, B) uint8: OUTSIDE, OBSERVED, RELIT or INVENTED.
        gain: (A, B, 3) float32 factor of linear light that takes a removed object's shadow away; 1 elsewhere.
        nearest: (A, B) float32, how far the nearest view of a texel is, metres; inf where none is.
        replaced: (A, B) bool, texels that were seen, but so dark under the object that they were invented all the same.
    """

    ground: Ground
    texel: float
    s_start: float
    t_start: float
    color: Float32
    label: NDArray[np.int16]
    source: NDArray[np.uint8]
    gain: Float32
    nearest: Float32
    replaced: NDArray[np.bool_]

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """The planes by name, and ``place``: arc length and lateral offset of the first texel, and its size."""
        planes = {name: getattr(self, name) for name in PLANES}
        return {**planes, "place": np.array([self.s_start, self.t_start, self.texel])}

    @staticmethod
    def from_arrays(ground: Ground, arrays: Mapping[str, NDArray[Any]]) -> StreetChart:
        """Inverse of :meth:`arrays`."""
        s_start, t_start, texel = (float(v) for v in arrays["place"])
        return StreetChart(ground, texel, s_start, t_start, **{name: arrays[name] for name in PLANES})

    def part(self, first: int, end: int) -> StreetChart:
        """Rows from ``first`` up to ``end``."""
        planes = {name: getattr(self, name)[first:end] for name in PLANES}
        return replace(self, s_start=self.s_start + self.texel * first, **planes)

    def coordinates(self) -> tuple[Float64, Float64]:
        """Arc length (A,) of the rows and lateral offset (B,) of the columns."""
        rows, columns = self.source.shape
        return self.s_start + self.texel * np.arange(rows), self.t_start + self.texel * np.arange(columns)  # type: ignore[return-value]

    def world(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Float64:
        """(N, 3) world positions of texel centres."""
        s, t = self.s_start + self.texel * rows, self.t_start + self.texel * columns
        return self.ground.path.to_world(np.stack([s, t, self.ground.height_at(s, t)], axis=1))  # type: ignore[arg-type, list-item]

    def normal(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Float64:
        """(N, 3) unit normals there: up."""
        return np.repeat(UP[None], len(rows), axis=0)

    def index_of(self, street: Float64) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.bool_]]:
        """Nearest rows and columns of street coordinates (N, 2+), and whether they lie on the chart."""
        row = np.round((street[:, 0] - self.s_start) / self.texel).astype(np.int64)
        column = np.round((street[:, 1] - self.t_start) / self.texel).astype(np.int64)
        rows, columns = self.source.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1), inside


def usable_pixels(
    ground: Ground,
    camera: Camera,
    label: NDArray[np.int64],
    labels: LabelSet,
    hidden: Mask,
    depth: NDArray[np.floating] | None = None,
) -> Mask:
    """(H, W) pixels that show nothing but ground.

    Args:
        label: (H, W) compact labels; hidden: (H, W) pixels that show something that goes, with their borders.
        depth: (H, W) of the full scene; only asked where ``labels`` know no ground. What lies before the ground hides it. Nothing
            lies behind it: where few points hold the scene, the road itself is reconstructed metres too deep.
    """
    possible = ~hidden
    wanted = labels.indices(GROUND_CLASSES)
    if wanted:
        # The border mixes two things.
        side = 2 * border_px(camera.width, 1) + 1
        shown = cv2.erode(np.isin(label, wanted).astype(np.uint8), np.ones((side, side), np.uint8))
        possible &= shown.astype(bool)
    usable = np.zeros_like(possible)
    met = ground.intersect(camera, camera.rays()[possible])[0]
    usable[possible] = np.isfinite(met)
    if wanted:  # labels say it; depth only has to be no contradiction
        return usable
    assert depth is not None
    with np.errstate(invalid="ignore"):
        usable[possible] &= ~(depth[possible] < (1 - ALIKE) * met)
    return usable


def rows_of(ground: Ground) -> int:
    """Number of rows of the chart of a whole street."""
    return int(ground.s_cell * (len(ground.t_max) - 1) / TEXEL_M) + 1


def arc_lengths(ground: Ground, rows: tuple[int, int]) -> Float64:
    """(A,) of a street's rows, first and last but one, metres."""
    return ground.s_start + TEXEL_M * np.arange(*rows)  # type: ignore[return-value]


def read_chart(
    ground: Ground,
    cameras: Sequence[Camera],
    images: Sequence[Levels],
    labels: Sequence[NDArray[np.int64]],
    usable: Sequence[NDArray[np.bool_]],
    *,
    rows: tuple[int, int] | None = None,
    robust: bool = False,
    progress: Progress = no_progress,
) -> StreetChart:
    """Read the ground from the frames; nearer views count more.

    Args:
        ground: the surface.
        cameras, images: the views, images (H, W, 3) levels of 255.
        labels: (H, W) compact labels per view.
        usable: (H, W) bool per view, True where a pixel shows the ground and nothing else.
        rows: first and last but one of the rows that are read; None = all.
        robust: read twice, so that looks that differ from most of the nearest count for nothing (:class:`NearestLooks`).
    """
    t_low, t_high = float(ground.t_min.min()), float(ground.t_max.max())
    first_row, end_row = rows or (0, rows_of(ground))
    height, width = end_row - first_row, int((t_high - t_low) / TEXEL_M) + 1
    s = arc_lengths(ground, (first_row, end_row))
    t = t_low + TEXEL_M * np.arange(width)
    grid_s, grid_t = np.repeat(s, width), np.tile(t, height)
    inside = ground.inside(grid_s, grid_t)
    world = ground.path.to_world(np.stack([grid_s, grid_t, ground.height_at(grid_s, grid_t)], axis=1))

    def look(v: int) -> tuple[NDArray[Any], ...]:
        index, pixel, depth = shown_places(world, grid_s, ground.path, cameras[v], READ_M, furthest_m=READ_M)
        there = inside[index]
        index, pixel, depth = index[there], pixel[there], depth[there]
        # Where nothing is shown the view need not even be loaded.
        return (index, pixel, depth, images[v], labels[v], usable[v]) if len(index) else ()

    rounds = 2 if robust else 1

    def read(into: NearestLooks | Texels, turn: int) -> None:
        for v, view in enumerate(each(look, range(len(cameras)))):
            if view:
                into.add(*view)
            progress(turn * len(cameras) + v + 1, rounds * len(cameras), "reading the street")

    texels = Texels.unseen(height * width)
    if robust:
        looks = NearestLooks(height * width)
        read(looks, 0)
        texels = Texels.around(looks)
    read(texels, rounds - 1)
    known = texels.weight > 0
    return StreetChart(
        ground=ground,
        texel=TEXEL_M,
        s_start=float(s[0]),
        t_start=t_low,
        color=texels.color().reshape(height, width, 3),
        label=texels.label.reshape(height, width),
        source=np.where(known, OBSERVED, OUTSIDE).astype(np.uint8).reshape(height, width),
        gain=np.ones((height, width, 3), dtype=np.float32),
        nearest=texels.nearest.astype(np.float32).reshape(height, width),
        replaced=np.zeros((height, width), dtype=bool),
    )
