"""Colours and labels of places on a surface as the views show them: what all charts are read into."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64
from unveil_core.geometry.fields.robust import MAD_TO_DEVIATION
from unveil_core.geometry.images import sample_at

__all__ = ["Texels"]

NEARNESS_POWER = 4
"""A view weighs as its depth to the power of minus this: at a grazing angle its resolution along the street falls with the
square of the depth, and the variance of what it shows of a texel with the fourth power."""


OUTLIER = 1.5
"""Multiple of the usual difference from a texel's mean, as a standard deviation, at which a look weighs half (Cauchy)."""
LEAST_SPREAD = 3.0
"""Least standard deviation of these differences, levels."""


@dataclass(frozen=True, eq=False)
class Texels:
    """What the views that were read so far show of T texels; the arrays are added to in place.

    Attributes:
        total: (T, 3) weighted sum of colours, 0 to 255; weight: (T,) sum of the weights.
        nearest: (T,) depth of the texel in its nearest view, metres, inf where none shows it.
        label: (T,) the label that most of the weight names, -1 unknown; votes: (T,) by how much it leads.
        expected: (T, 3) colour by a first reading, from which looks must not be far; None = none was made.
        spread: usual difference from it, levels.
    """

    total: Float64
    weight: Float64
    nearest: Float64
    label: NDArray[np.int16]
    votes: Float64
    expected: Float32 | None = None
    spread: float = 0.0

    @staticmethod
    def unseen(count: int) -> Texels:
        nothing = np.zeros(count)
        label = np.full(count, -1, dtype=np.int16)
        return Texels(np.zeros((count, 3)), nothing.copy(), np.full(count, np.inf), label, nothing)

    def again(self, differences: Float32) -> Texels:
        """None of them seen, for a second reading, in which looks that are far from the first count little: a car that passed, its
        shadow, a pole that no label names.

        Args:
            differences: (M,) of looks from what their texels showed, see :meth:`add`.
        """
        spread = MAD_TO_DEVIATION * float(np.median(differences)) if len(differences) else 0.0
        second = Texels.unseen(len(self.weight))
        return replace(second, expected=255 * self.color(), spread=max(spread, LEAST_SPREAD))

    def add(
        self,
        index: NDArray[np.int64],
        pixel: Float64,
        depth: Float64,
        image: NDArray[Any],
        label: NDArray[np.int64],
        usable: NDArray[np.bool_],
    ) -> Float32:
        """Add one view.

        Args:
            index: (N,) texels that lie in the picture; pixel: (N, 2) where; depth: (N,) metres.
            image: (H, W, 3), levels of 255; label: (H, W); usable: (H, W) bool.
        Returns:
            (M,) by how much what it shows differs from what was seen of the same texels before, in the channel that differs most.
        """
        column, row = pixel.astype(np.int64).T
        good = usable[row, column]
        index, depth = index[good], depth[good]
        closer = depth < self.nearest[index]
        self.nearest[index[closer]] = depth[closer]
        w = (1.0 / depth) ** NEARNESS_POWER
        return self.take(index, pixel[good], w, image, label[row[good], column[good]])

    def take(
        self,
        index: NDArray[np.int64],
        pixel: Float64,
        w: Float64,
        image: NDArray[Any],
        label: NDArray[np.int64] | None = None,
    ) -> Float32:
        """Take the looks of one view, see :meth:`add`, each with a weight (N,) and perhaps a label (N,)."""
        if not len(index):
            return np.zeros(0, np.float32)
        found = sample_at(image, pixel)
        seen = self.weight[index] > 0
        before = self.total[index[seen]] / self.weight[index[seen], None]
        difference = np.abs(found[seen] - before).max(axis=1).astype(np.float32)
        if self.expected is not None:
            far = np.abs(found - self.expected[index]).max(axis=1)
            w = w / (1 + np.square(far / (OUTLIER * self.spread)))
        self.total[index] += found * w[:, None]
        self.weight[index] += w
        if label is not None:
            self._vote(index, label, w)
        return difference

    def _vote(self, index: NDArray[np.int64], label: NDArray[np.int64], weight: Float64) -> None:
        """Majority by weight in one pass (Boyer and Moore, *MJRTY*, 1991): another label takes away from the lead of the first."""
        same = self.label[index] == label
        lead = self.votes[index] + np.where(same, weight, -weight)
        self.label[index] = np.where(lead < 0, label, self.label[index])
        self.votes[index] = np.abs(lead)

    def color(self) -> Float32:
        """(T, 3) mean colours in [0, 1], black where nothing was seen."""
        mean = self.total / np.maximum(self.weight, 1e-300)[:, None] / 255
        return np.where((self.weight > 0)[:, None], mean, 0).astype(np.float32)
