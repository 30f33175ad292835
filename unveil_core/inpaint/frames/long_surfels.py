"""How long along the street surfels of the ground may be: from afar many of them lie in one pixel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.chart.surface import NEAREST_M, Surface

__all__ = ["LONGEST", "longest_in_view", "together"]

LONGEST = 4
"""Cells along the street that one surfel takes the place of at most: of where nobody looks closely a mesh keeps some shape."""
APART_PX = 1.0
"""Distance of surfels along the street in the view that sees them largest, at most, pixels: nothing is seen between them."""


def longest_in_view(surface: Surface, cells: tuple[int, int], step: int, cameras: Sequence[Camera]) -> Float32:
    """(ceil(C / ``LONGEST``), D) how long so many cells in a row look in the view that sees them largest, pixels.

    Args:
        cells: C and D, how many lie along and across the surface; step: rows and columns of texels in a cell.
    """
    count, across = -(-cells[0] // LONGEST), cells[1]
    row, column = (index.ravel() for index in np.mgrid[:count, :across])
    begin, side = row * LONGEST * step, column * step + step // 2
    first, last = (surface.world(begin + more, side) for more in (0, LONGEST * step))
    longest = np.zeros(len(row), np.float32)
    for camera in cameras:
        # A row of cells whose middle lies beside the picture is not seen in it.
        shown, _, _ = camera.shown((first + last) / 2, nearest=NEAREST_M)
        (one, near), (other, far) = camera.project(first[shown]), camera.project(last[shown])
        length = np.where(np.minimum(near, far) > NEAREST_M, np.linalg.norm(one - other, axis=1), np.inf)
        longest[shown] = np.maximum(longest[shown], length)
    return longest.reshape(count, across)


def together(wanted: Mask, longest: Float32) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Which cells of a surface (C, D) get a surfel together with those after them: first rows (N,), columns (N,), and how many
    cells in a row (N,) each stands for, a power of two.

    Args:
        wanted: (C, D) cells; longest: as of :func:`longest_in_view`.
    """
    rows = np.pad(wanted, ((0, -len(wanted) % LONGEST), (0, 0)))
    found = []
    many = LONGEST
    while many:
        groups = rows.reshape(-1, many, rows.shape[1])
        may = np.repeat(longest, LONGEST // many, axis=0) * many / LONGEST <= APART_PX
        whole = groups.all(axis=1) & (may | (many == 1))
        groups[whole[:, None].repeat(many, 1)] = False  # a view of the rows
        first, column = np.nonzero(whole)
        found.append((first * many, column, np.full(len(first), many)))
        many //= 2
    row, column, count = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return row, column, count
