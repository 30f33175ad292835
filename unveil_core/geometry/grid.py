"""Points in the cells of a grid, to find those near a place without looking at all of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.kernels.hashing import slot_of
from unveil_core.base.types import Float64

__all__ = ["PointGrid", "rising"]

FIRST_SLOTS = 1024
"""Of the table of cells, which grows with them: a power of two."""


class PointGrid:
    """Points in the cells of a grid on the horizontal plane. Made in linear time; 4 bytes a point are held.

    Attributes:
        cell: side of the cells, metres.
        order: (N,) indices of the points, cell after cell; first: (C,) where in it each cell begins.

    Args:
        points: (N, 3), z up; cell: side of the cells, metres.
    """

    def __init__(self, points: Float64, cell: float = 20.0) -> None:
        self.cell = cell
        places = np.asarray(points, dtype=np.float64)
        of_point = np.empty(len(places), dtype=np.int32 if len(places) < 1 << 31 else np.int64)
        cells = _number_cells(places, float(cell), of_point, FIRST_SLOTS)
        by_place = np.lexsort((cells[:, 1], cells[:, 0]))
        self._cells = cells[by_place]
        rank = np.empty(len(cells), dtype=np.int64)
        rank[by_place] = np.arange(len(cells))
        self._ends = np.zeros(len(cells) + 1, dtype=np.int64)
        self.order = np.empty_like(of_point)
        _sort_by_cell(of_point, rank, self._ends, self.order)
        self.first = self._ends[:-1]

    @property
    def middles(self) -> Float64:
        """(C, 2) of the cells that hold points."""
        return (self._cells + 0.5) * self.cell

    def of_cells(self, cells: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Indices, rising, of the points in some of the cells (C,)."""
        parts = [self.order[self._ends[k] : self._ends[k + 1]] for k in np.flatnonzero(cells)]
        return rising(np.concatenate(parts)) if parts else np.zeros(0, dtype=np.int64)

    def near(self, place: Float64, reach: float) -> NDArray[np.int64]:
        """Indices, rising, of all points within ``reach`` of a place (2 or 3,) as seen from above, and of some beyond."""
        gap = np.maximum(np.abs(self.middles - place[:2]) - self.cell / 2, 0.0)
        return self.of_cells((gap * gap).sum(axis=1) <= reach * reach)


def rising(index: NDArray[np.integer]) -> NDArray[np.int64]:
    """Different numbers (N,), one at least, in rising order; those that lie close together, as points of one place do, in linear
    time."""
    low = int(index.min())
    span = int(index.max()) - low + 1
    if span > 8 * len(index):
        return np.sort(index).astype(np.int64)
    there = np.zeros(span, dtype=bool)
    there[index - low] = True
    return np.flatnonzero(there) + low


@njit(cache=True)
def _slot(table, cells, x, y):  # type: ignore[no-untyped-def]
    """Where in a table of numbers of ``cells`` (C, 2) a cell is, or where it has to go."""
    slot = slot_of(x ^ (y << 32) ^ (y >> 32), table.size)
    while table[slot] >= 0 and (cells[table[slot], 0] != x or cells[table[slot], 1] != y):
        slot = (slot + 1) & (table.size - 1)
    return slot


@njit(cache=True)
def _number_cells(points, cell, of_point, slots):  # type: ignore[no-untyped-def]
    """(C, 2) the cells that hold points (N, 3), as they are met; ``of_point`` (N,) gets the number of each one's."""
    table, cells, count = np.full(slots, -1, dtype=np.int64), np.empty((slots // 2, 2), dtype=np.int64), 0
    for i in range(len(points)):
        x, y = np.int64(np.floor(points[i, 0] / cell)), np.int64(np.floor(points[i, 1] / cell))
        slot = _slot(table, cells, x, y)
        if table[slot] < 0:
            if count == len(cells):  # half full: a table twice as large
                table, smaller = np.full(2 * table.size, -1, dtype=np.int64), cells
                cells = np.empty((2 * count, 2), dtype=np.int64)
                # One by one: assigning the whole would compile numba's text routines, for its error.
                for k in range(count):
                    cells[k, 0], cells[k, 1] = smaller[k, 0], smaller[k, 1]
                    table[_slot(table, cells, cells[k, 0], cells[k, 1])] = k
                slot = _slot(table, cells, x, y)
            table[slot] = count
            cells[count, 0], cells[count, 1] = x, y
            count += 1
        of_point[i] = table[slot]
    return cells[:count].copy()


@njit(cache=True)
def _sort_by_cell(of_point, rank, ends, order):  # type: ignore[no-untyped-def]
    """Points (N,) by the ``rank`` (C,) of their cells, rising within each: a counting sort. ``ends`` (C + 1,) begins as zeros."""
    for i in range(len(of_point)):
        ends[rank[of_point[i]] + 1] += 1
    for k in range(1, len(ends)):
        ends[k] += ends[k - 1]
    place = ends.copy()
    for i in range(len(of_point)):
        k = rank[of_point[i]]
        order[place[k]] = i
        place[k] += 1
