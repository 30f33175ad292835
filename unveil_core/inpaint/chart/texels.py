"""Colours and labels of places on a surface as the views show them: what all charts are read into."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64
from unveil_core.geometry.fields.robust import MAD_TO_DEVIATION
from unveil_core.geometry.images import sample_at

__all__ = ["NearestLooks", "Texels"]

NEARNESS_POWER = 4
"""A view weighs as its depth to the power of minus this: at a grazing angle its resolution along the street falls with the
square of the depth, and the variance of what it shows of a texel with the fourth power."""
OUTLIER = 4.685
"""Standard deviations from a texel's centre from which on a look weighs nothing: Tukey's biweight at 95 % efficiency (Huber and
Ronchetti, *Robust Statistics*, 2009, section 4.8). Weights that only fall would not do: the nearest of a few looks may count a
hundred times as much as the others."""
TRACE = 1e-6
"""Weight of the centre in place of a look that differs."""
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

    def add(
        self,
        index: NDArray[np.int64],
        pixel: Float64,
        depth: Float64,
        image: NDArray[Any],
        label: NDArray[np.int64],
        usable: NDArray[np.bool_],
    ) -> None:
        """Add one view, see :meth:`Texels.add`; labels are not looked at."""
        good = _at(pixel, usable)
        index, pixel, depth = index[good], pixel[good], depth[good]
        farthest = self._depth[index].argmax(axis=1)
        nearer = depth < self._depth[index, farthest]
        index, farthest = index[nearer], farthest[nearer]
        self._depth[index, farthest] = depth[nearer]
        self._color[index, farthest] = sample_at(image, pixel[nearer])

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


@dataclass(frozen=True, eq=False)
class Texels:
    """What the views that were read so far show of T texels; the arrays are added to in place.

    Attributes:
        total: (T, 3) weighted sum of colours, 0 to 255; weight: (T,) sum of the weights.
        nearest: (T,) depth of the texel in its nearest view, metres, inf where none shows it.
        label: (T,) the label that most of the weight names, -1 unknown; votes: (T,) by how much it leads.
        centre: (T, 3) what most of the nearest looks show, levels of 255, NaN where nothing is known; looks far from it count for
            nothing. None = all looks count.
        spread: standard deviation of looks from it, levels.
    """

    total: Float64
    weight: Float64
    nearest: Float64
    label: NDArray[np.int16]
    votes: Float64
    centre: Float32 | None = None
    spread: float = 0.0

    @staticmethod
    def unseen(count: int) -> Texels:
        nothing = np.zeros(count)
        label = np.full(count, -1, dtype=np.int16)
        return Texels(np.zeros((count, 3)), nothing.copy(), np.full(count, np.inf), label, nothing)

    @staticmethod
    def around(looks: NearestLooks) -> Texels:
        """None of them seen, for a reading in which what differs from most of the nearest looks does not count: a car that passed,
        its shadow, a pole that no label names. Where all that is read differs, the centre itself is the colour."""
        centre, spread = looks.centre()
        return replace(Texels.unseen(len(centre)), centre=centre, spread=spread)

    def add(
        self,
        index: NDArray[np.int64],
        pixel: Float64,
        depth: Float64,
        image: NDArray[Any],
        label: NDArray[np.int64],
        usable: NDArray[np.bool_],
    ) -> None:
        """Add one view.

        Args:
            index: (N,) texels that lie in the picture; pixel: (N, 2) where; depth: (N,) metres.
            image: (H, W, 3), levels of 255; label: (H, W); usable: (H, W) bool.
        """
        good = _at(pixel, usable)
        index, pixel, depth = index[good], pixel[good], depth[good]
        closer = depth < self.nearest[index]
        self.nearest[index[closer]] = depth[closer]
        w = (1.0 / depth) ** NEARNESS_POWER
        self.take(index, pixel, w, image, _at(pixel, label))

    def take(
        self,
        index: NDArray[np.int64],
        pixel: Float64,
        w: Float64,
        image: NDArray[Any],
        label: NDArray[np.int64] | None = None,
    ) -> None:
        """Take the looks of one view, see :meth:`add`, each with a weight (N,) and perhaps a label (N,)."""
        if not len(index):
            return
        found = sample_at(image, pixel)
        if self.centre is not None:
            far = np.abs(found - self.centre[index]).max(axis=1) / (OUTLIER * self.spread)
            # A look that counts for nothing leaves the centre a trace, so that what is only seen so has a colour and a label.
            agrees = np.where(np.isnan(far), 1.0, np.square(np.maximum(1 - np.square(far), 0)))
            found = np.where((agrees < TRACE)[:, None], self.centre[index], found)
            w = w * np.maximum(agrees, TRACE)
        self.total[index] += found * w[:, None]
        self.weight[index] += w
        if label is not None:
            self._vote(index, label, w)

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


def _at(pixel: Float64, plane: NDArray[Any]) -> NDArray[Any]:
    """(N,) what a plane (H, W) has at positions (N, 2)."""
    column, row = pixel.astype(np.int64).T
    return plane[row, column]
