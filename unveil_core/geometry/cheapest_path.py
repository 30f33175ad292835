"""The cheapest path through a table of costs: the Viterbi algorithm, as for seams and for stereo scanlines."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64

__all__ = ["cheapest_path"]

Step = Callable[[Float64], tuple[NDArray[np.int64], Float64]]
"""From the cost (D,) of reaching each choice of a row: for each choice of the next row the best one to come from (D,), and the
cost (D,) of having come from there."""


def cheapest_path(cost: NDArray[np.floating], step: Step) -> NDArray[np.int64]:
    """The choice in each row that makes the sum of costs and steps least.

    Args:
        cost: (A, D) of each choice in each row.
        step: what a change of choice from one row to the next costs, see :data:`Step`.
    Returns:
        (A,) indices of columns.
    """
    total = cost[0].astype(np.float64)
    came_from = np.zeros(cost.shape, dtype=np.int64)
    for row in range(1, len(cost)):
        came_from[row], reached = step(total)
        total = reached + cost[row]
    path = np.zeros(len(cost), dtype=np.int64)
    path[-1] = int(total.argmin())
    for row in range(len(cost) - 1, 0, -1):
        path[row - 1] = came_from[row, path[row]]
    return path
