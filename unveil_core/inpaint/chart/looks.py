"""Where in the pictures the same ground is seen, and how bright: what the light by view is fitted to."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.parallel import each
from unveil_core.base.types import Levels, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.street_chart import READ_M, TEXEL_M, arc_lengths
from unveil_core.inpaint.chart.surface import NEAREST_M
from unveil_core.inpaint.light.view_light import GroundLooks, light_of

__all__ = ["read_looks"]

STEP = 4
"""Texels from one that is looked at to the next, 0.16 m: what is sought is smooth, and a look is read from a blurred picture."""
CELL_M = 2.0
"""Side of the patches of ground that are held out as a whole, metres."""
BLUR_PX = 1.0
"""Standard deviation of the blur, pixels: less hangs on the last pixel of a pose."""


def read_looks(
    ground: Ground,
    cameras: Sequence[Camera],
    which: Sequence[int],
    images: Sequence[Levels],
    usable: Sequence[Mask],
    rows: tuple[int, int],
) -> GroundLooks:
    """What the views show of the ground.

    Args:
        cameras, images, usable: the views, see :func:`unveil_core.inpaint.chart.street_chart.read_chart`.
        which: index of the camera that took each.
        rows: first and last but one row of the drive's chart.
    """
    t = np.arange(float(ground.t_min.min()), float(ground.t_max.max()), STEP * TEXEL_M)
    begin = -(-rows[0] // STEP)  # stretches that meet look at one grid of the drive
    s = arc_lengths(ground, (STEP * begin, rows[1]))[::STEP]
    grid_s, grid_t = np.repeat(s, len(t)), np.tile(t, len(s))
    inside = ground.inside(grid_s, grid_t)
    grid_s, grid_t = grid_s[inside], grid_t[inside]
    world = ground.path.to_world(np.stack([grid_s, grid_t, ground.height_at(grid_s, grid_t)], axis=1))
    across = int(np.ceil((t[-1] - t[0]) / CELL_M)) + 1 if len(t) else 1
    cell = ((grid_s - ground.s_start) / CELL_M).astype(np.int64) * across + ((grid_t - t[0]) / CELL_M).astype(np.int64)
    first = begin * len(t) + np.flatnonzero(inside)

    def look(v: int) -> tuple[NDArray[np.generic], ...]:
        shown, pixel, depth = cameras[v].shown(world, nearest=NEAREST_M, furthest=READ_M)
        if not len(shown):
            return ()
        column, row = pixel.astype(np.int64).T
        good = usable[v][row, column]
        shown, pixel, depth, column, row = (a[good] for a in (shown, pixel, depth, column, row))
        picture = cv2.GaussianBlur(images[v], (0, 0), BLUR_PX)
        seen = light_of(picture[row, column]).astype(np.float64)
        return np.full(len(shown), which[v]), first[shown], cell[shown], pixel, seen, depth

    found = [view for view in each(look, range(len(cameras))) if view]
    if not found:
        nothing = np.zeros(0, np.int64)
        return GroundLooks(nothing, nothing, nothing, np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0))
    return GroundLooks(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))
