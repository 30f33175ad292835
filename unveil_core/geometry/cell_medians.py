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
    order = np.argsort(cells, kind="stable")
    every, parts = groups(cells[order], values[order])
    told = [
        k
        for k, part in enumerate(parts)
        if len(part) >= fewest and (together == np.inf or np.subtract(*np.percentile(part, [75, 25])) < together)
    ]
    return every[told], np.array([np.median(parts[k]) for k in told])
