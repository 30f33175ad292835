"""Who belongs to which of many numbers: found for all of them at once, not by comparing everyone with each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Members"]


class Members:
    """Indices by number.

    Attributes:
        numbers: (K,) that somebody belongs to, rising.

    Args:
        numbers: (N,) the number that each belongs to; 0 = none.
    """

    def __init__(self, numbers: NDArray[np.int64]) -> None:
        some = np.flatnonzero(numbers)
        self._order = some[np.argsort(numbers[some], kind="stable")]
        self.numbers, self._first = np.unique(numbers[self._order], return_index=True)
        self._ends = np.append(self._first, len(self._order))

    def __getitem__(self, number: int) -> NDArray[np.int64]:
        """Indices, rising, of those that belong to a number; none where nobody does."""
        k = int(np.searchsorted(self.numbers, number))
        if k == len(self.numbers) or self.numbers[k] != number:
            return np.zeros(0, dtype=np.int64)
        return self._order[self._ends[k] : self._ends[k + 1]]
