"""The ground ahead of the way, seen from above: what each place is, and its paint and kerbs, on a grid that no path bends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Levels, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import luminance, masked_blur
from unveil_core.geometry.reach import cameras_near, centres_of
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.street_chart import READ_M
from unveil_core.inpaint.chart.surface import NEAREST_M
from unveil_core.inpaint.chart.texels import Texels

__all__ = ["CELL_M", "UNKNOWN", "PlanView", "read_plan"]

CELL_M = 0.1
"""Side of a cell, metres: the width of painted lines and kerbs, and of what a pixel of 384 shows 30 m away."""
UNKNOWN = -1
FINE_CELLS, BROAD_CELLS = 0.7, 4.0
"""Standard deviations of the two blurs whose difference is a line, cells: it keeps what is 0.1 to 0.3 m wide, and the borders of
sidewalks."""
CONTRAST = 0.15
"""Difference of log luminance that counts as a whole line; more is clipped, so that one strong edge does not outvote several."""
WALL_CELLS = 5
"""Width that the foot of a wall is given, cells: surfels are that far apart."""


@dataclass(frozen=True, eq=False)
class PlanView:
    """The ground from above.

    Attributes:
        corner: (2,) east and north of the first cell's centre, metres.
        kind: (P, Q) int8, what a place is, :data:`UNKNOWN` where nobody knows; count: of kinds, the last of which are walls.
        line: (P, Q) how much a place is lighter than its surroundings, -1 to 1.
    """

    corner: Float64
    kind: NDArray[np.int8]
    count: int
    line: Float32

    def at(self, places: Float64) -> tuple[NDArray[np.int8], Float32]:
        """Kinds (...) and lines (...) of places (..., 2), east and north; unknown and 0 beside the view."""
        cells = np.rint((places - self.corner) / CELL_M).astype(np.int32)
        i, j = cells[..., 0], cells[..., 1]
        rows, columns = self.kind.shape
        off = (i < 0) | (i >= rows) | (j < 0) | (j >= columns)
        i[off], j[off] = 0, 0
        kind, line = self.kind[i, j], self.line[i, j]
        kind[off], line[off] = UNKNOWN, 0
        return kind, line


def read_plan(
    ground: Ground,
    low: Float64,
    high: Float64,
    cameras: Sequence[Camera],
    images: Sequence[Levels],
    labels: Sequence[NDArray[np.int64]],
    usable: Sequence[Mask],
    *,
    kinds: Sequence[int],
    walls: Float64,
) -> PlanView:
    """The ground between two corners (2,) and (2,), east and north.

    Args:
        images, labels, usable: (H, W…) per camera, see :func:`unveil_core.inpaint.chart.street_chart.read_chart`.
        kinds: labels of ground that are told apart; all others are one kind.
        walls: (W, 3) world places at the foot of what bounds the ground.
    """
    axes = ground.path.axes
    shape = np.ceil((high - low) / CELL_M).astype(int) + 1
    cells = np.stack(np.meshgrid(*(np.arange(n) * CELL_M for n in shape), indexing="ij"), axis=-1).reshape(-1, 2) + low
    street = ground.path.to_street(np.column_stack([cells, np.zeros(len(cells))]) @ axes)
    s, t = street[:, :2].T
    at = np.flatnonzero(ground.inside(s, t))
    world = np.column_stack([cells[at], ground.height_at(s[at], t[at])]) @ axes
    texels = Texels.unseen(len(at))
    for v in cameras_near(centres_of(cameras), world, READ_M):
        shown, pixel, depth = cameras[v].shown(world, nearest=NEAREST_M, furthest=READ_M)
        if len(shown):  # else the view need not even be loaded
            texels.add(shown, pixel, depth, images[v], labels[v], usable[v])
    known = texels.weight > 0
    color = np.zeros((len(cells), 3), dtype=np.float32)
    color[at] = texels.color()
    kind = np.full(len(cells), UNKNOWN, dtype=np.int8)
    kind[at[known]] = len(kinds)
    for number, label in enumerate(kinds):
        kind[at[known & (texels.label == label)]] = number
    kind, color = kind.reshape(shape), color.reshape(*shape, 3)
    line = _lines(color, kind != UNKNOWN)
    foot = np.rint(((walls @ axes.T)[:, :2] - low) / CELL_M).astype(int)
    foot = foot[((foot >= 0) & (foot < shape)).all(axis=1)]
    wall = np.zeros(tuple(shape), dtype=np.uint8)
    wall[foot[:, 0], foot[:, 1]] = 1
    wall = cv2.dilate(wall, np.ones((WALL_CELLS, WALL_CELLS), np.uint8))
    kind[(wall > 0) & (kind == UNKNOWN)] = len(kinds) + 1
    return PlanView(low, kind, len(kinds) + 2, line)


def _lines(color: Float32, known: Mask) -> Float32:
    """(P, Q) paint and kerbs."""
    log = np.log(np.maximum(luminance(color), 0.02)).astype(np.float32)
    fine, broad = (masked_blur(log, known, sigma) for sigma in (FINE_CELLS, BROAD_CELLS))
    return np.where(known, np.clip((fine - broad) / CONTRAST, -1, 1), 0).astype(np.float32)
