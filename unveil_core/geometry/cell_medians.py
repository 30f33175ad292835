"""Medians of what lies in cells, such as heights at lateral offsets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64

__all__ = ["cell_medians", "groups"]


def groups(keys: NDArray[np.int64], values: Float64) -> tuple[NDArray[np.int64], list[Float64]]:
    """Split sorted keys into runs."""
    if not len(keys):
        return keys, []
    unique, first = np.unique(keys, return_index=True)
    return unique, np.split(values, first[1:])


def cell_medians(
    cells: NDArray[np.int64], values: Float64, *, fewest: int = 1, together: float = np.inf
) -> tuple[NDArray[np.int64], Float64]:
    """Cells (C,), ascending, and the median of the values in each (C,).

    Args:
        cells: (N,) of the values (N,).
        fewest: values that tell of a cell; together: the middle half of them must lie closer together than this.
    """
    if not len(cells):
        return cells, np.zeros(0)
    order = np.argsort(values)
    order = order[np.argsort(_narrow(cells)[order], kind="stable")]
    ranked, sorted_cells = values[order], cells[order]
    first = np.flatnonzero(np.concatenate([[True], sorted_cells[1:] > sorted_cells[:-1]]))
    every, count = sorted_cells[first], np.diff(first, append=len(cells))
    told = count >= fewest
    if together != np.inf:
        told &= _at_share(ranked, first, count, 0.75) - _at_share(ranked, first, count, 0.25) < together
    first, count = first[told], count[told]
    medians = (ranked[first + (count - 1) // 2] + ranked[first + count // 2]) / 2
    return every[told], np.where(np.isnan(ranked[first + count - 1]), np.nan, medians)


def _narrow(cells: NDArray[np.int64]) -> NDArray[np.integer]:
    """Cells (N,) as numbers of 16 bits from 0 on, which are sorted several times as fast, where that is possible."""
    lowest = cells.min()
    return (cells - lowest).astype(np.uint16) if cells.max() - lowest < 1 << 16 else cells


def _at_share(ranked: Float64, first: NDArray[np.int64], count: NDArray[np.int64], share: float) -> Float64:
    """(C,) linear quantiles of cells whose values lie in rising order from ``first`` (C,) on, ``count`` (C,) of them."""
    place = share * (count - 1)
    below = np.floor(place).astype(np.int64)
    low, high = ranked[first + below], ranked[first + np.minimum(below + 1, count - 1)]
    found: Float64 = low + (high - low) * (place - below)
    return found
