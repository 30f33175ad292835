"""What most of the nearest looks at a texel agree on: the centre from which outliers are told."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64
from unveil_core.geometry.fields.robust import MAD_TO_DEVIATION

__all__ = ["LOOKS", "NearestLooks"]

LOOKS = 7
"""Looks at a texel that are compared, the nearest ones: three of seven may show something else. At ten frames a second these are
0.7 seconds, in which a car that passes has passed; farther looks are blurred, and see more of the glare of the road."""
FEWEST_LOOKS = 3
"""Looks at a texel from which on one of them can be told to differ."""
LEAST_SPREAD = 3.0
"""Least standard deviation of looks at the same texel, levels of 255."""


class NearestLooks:
    """The nearest looks at each of T texels, kept while the views are read one by one.

    The centre of a texel is their median by channel. Each look counts the same, however near it is: the breakdown point is that of
    the median, (n - 1) // 2 of the n nearest looks, n <= :data:`LOOKS`. A mean weighted by nearness has none, for one look may have
    nearly all of the weight.
    """

    def __init__(self, count: int) -> None:
        self._depth = np.full((count, LOOKS), np.inf, np.float32)
        self._color = np.zeros((count, LOOKS, 3), np.float16)

    def add(self, index: NDArray[np.int64], depth: Float64, color: Float32) -> None:
        """Add one view's looks at texels ``index`` (N,), from so far (N,), metres, in colours (N, 3), levels of 255."""
        farthest = self._depth[index].argmax(axis=1)
        nearer = depth < self._depth[index, farthest]
        index, farthest = index[nearer], farthest[nearer]
        self._depth[index, farthest] = depth[nearer]
        self._color[index, farthest] = color[nearer]

    def centre(self) -> tuple[Float32, float]:
        """(T, 3) their medians, NaN where fewer than :data:`FEWEST_LOOKS` were taken; and the standard deviation of looks from
        them, levels, robust, one for all texels."""
        count = np.isfinite(self._depth).sum(axis=1)
        centre = np.full((len(count), 3), np.nan, np.float32)
        apart = []
        for n in range(FEWEST_LOOKS, LOOKS + 1):
            some = np.flatnonzero(count == n)
            if len(some):  # the places of looks that were not taken hold none: the finite ones come first
                looks = self._color[some, :n].astype(np.float32)
                centre[some] = np.median(looks, axis=1)
                apart.append(np.abs(looks - centre[some, None]).max(axis=2).ravel())
        spread = MAD_TO_DEVIATION * float(np.median(np.concatenate(apart))) if apart else 0.0
        return centre, max(spread, LEAST_SPREAD)
