"""Colours and labels of places on the ground as the views show them, nearer ones counting more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64
from unveil_core.geometry.images import sample_at

__all__ = ["Texels"]

NEARNESS_POWER = 4
"""A view weighs as its depth to the power of minus this: at a grazing angle its resolution along the street falls with the
square of the depth, and the variance of what it shows of a texel with the fourth power."""


@dataclass(frozen=True, eq=False)
class Texels:
    """What the views that were read so far show of T texels; the arrays are added to in place.

    Attributes:
        total: (T, 3) weighted sum of colours, 0 to 255; weight: (T,) sum of the weights.
        nearest: (T,) depth of the texel in its nearest view, metres, inf where none shows it; label: (T,) there, -1 unknown.
    """

    total: Float64
    weight: Float64
    nearest: Float64
    label: NDArray[np.int16]

    @staticmethod
    def unseen(count: int) -> Texels:
        return Texels(np.zeros((count, 3)), np.zeros(count), np.full(count, np.inf), np.full(count, -1, dtype=np.int16))

    def add(
        self,
        index: NDArray[np.int64],
        pixel: Float64,
        depth: Float64,
        image: NDArray[np.uint8],
        label: NDArray[np.int64],
        usable: NDArray[np.bool_],
    ) -> None:
        """Add one view.

        Args:
            index: (N,) texels that lie in the picture; pixel: (N, 2) where; depth: (N,) metres.
            image: (H, W, 3); label: (H, W); usable: (H, W) bool.
        """
        column, row = pixel[:, 0].astype(np.int64), pixel[:, 1].astype(np.int64)
        good = usable[row, column]
        index, pixel, depth, column, row = index[good], pixel[good], depth[good], column[good], row[good]
        if not len(index):
            return
        found = sample_at(image, pixel)
        w = (1.0 / depth) ** NEARNESS_POWER
        self.total[index] += found * w[:, None]
        self.weight[index] += w
        closer = depth < self.nearest[index]
        self.label[index[closer]] = label[row[closer], column[closer]]
        self.nearest[index[closer]] = depth[closer]

    def color(self) -> Float32:
        """(T, 3) mean colours in [0, 1], black where nothing was seen."""
        mean = self.total / np.maximum(self.weight, 1e-300)[:, None] / 255
        return np.where((self.weight > 0)[:, None], mean, 0).astype(np.float32)
