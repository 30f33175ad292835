"""Holes planted in a chart where the street was seen: what a way of filling is worth on this very drive.

The footprints of the drive's own removed objects are moved along and across the street to where nothing stood. What is filled
there is compared with what was seen. So a choice that is made for a whole drive follows from the drive, not from a threshold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.images import grow, luminance, masked_blur
from unveil_core.inpaint.chart.street_chart import OBSERVED, OUTSIDE, StreetChart

__all__ = ["MOVED_M", "PlantedHoles", "by_block", "crossed_errors", "plant_holes"]

T = TypeVar("T")

MOVED_M = tuple(
    (along, across)
    for along in (0.0, -6.0, 6.0, -12.0, 12.0, -18.0, 18.0)
    for across in (0.0, -2.0, 2.0, -4.0, 4.0, -6.0, 6.0)
)
"""Ways, along and across the street, metres, by which footprints are moved to where nothing stood, the nearest first."""
LEAST_M2 = 1.0
"""Area of the smallest footprint that is moved, square metres: a bicycle."""
MARGIN_M, AWAY_M = 0.25, 1.0
"""Width around a footprint that no frame shows either: the border of the masks; and distance from what really stands there."""
SEEN = 0.95
"""Share of a hole that must have been seen."""
MOST_SHARE = 0.12
"""Share of the seen street that the holes may hide: what a row of parked cars hides."""
COARSE_M = 0.2
"""Standard deviation of the blur under which colours are compared, metres: light, not grain."""
FLOOR = 0.02
BLOCK_M = 15.0
"""Length of the blocks of the street whose holes count as one measurement, metres: what holes in the shadow of one house, or on one
patch of asphalt, tell is the same. Longer than such a shadow is along the street."""


@dataclass(frozen=True, eq=False)
class PlantedHoles:
    """Holes in a chart.

    Attributes:
        chart: without what lies in the holes; footprint: (A, B) of what is removed, with what was planted.
        number: (A, B) of the hole, 0 outside; count: of the holes.
    """

    chart: StreetChart
    footprint: Mask
    number: NDArray[np.int32]
    count: int

    def errors(self, truth: StreetChart, filled: StreetChart) -> Float64:
        """(count,) by hole, mean difference of the logarithm of luma between what was seen and what was filled, coarsely."""
        level, wanted = (
            np.log(np.maximum(luminance(masked_blur(c.color, known, COARSE_M / c.texel)), FLOOR))
            for c, known in ((filled, filled.source != OUTSIDE), (truth, truth.source == OBSERVED))
        )
        difference = np.abs(level - wanted)
        known = truth.source == OBSERVED
        found: Float64 = ndimage.mean(difference, np.where(known, self.number, 0), np.arange(1, self.count + 1))
        return np.asarray(found, dtype=np.float64)

    def blocks(self) -> NDArray[np.int64]:
        """(count,) number of the block of ``BLOCK_M`` that each hole lies in; -1 where it lies in two."""
        rows = np.array([(p[0].start, p[0].stop - 1) for p in ndimage.find_objects(self.number, self.count)])
        first, last = _block(rows.reshape(-1, 2), self.chart.texel).T
        return np.where(first == last, first, -1)


def crossed_errors(
    chart: StreetChart,
    footprint: Mask,
    find: Callable[[StreetChart], T | None],
    fill: Callable[[StreetChart, Mask, T | None], StreetChart],
) -> tuple[Float64, Float64]:
    """Errors by block of the street (M,) of planted holes, filled with what was found without their blocks, and with nothing found.

    Cross-validation in two folds, every other block (Stone, *Cross-validatory choice and assessment of statistical predictions*,
    1974): what was found where a hole is explains what was seen there, whether it is so or not.

    Args:
        chart: as read; footprint: (A, B) texels under removed objects.
        find: what is to be judged, of a chart without the blocks of a fold; None = nothing was found.
        fill: a chart with holes, and the footprint of what was planted in them, by what was found.
    """
    holes = plant_holes(chart, footprint)
    block = holes.blocks() if holes.count else np.zeros(0, np.int64)
    if not (block >= 0).any():
        return np.zeros(0), np.zeros(0)
    of_row = _block(np.arange(len(footprint)), chart.texel)
    without = holes.errors(chart, fill(holes.chart, holes.footprint, None))
    errors = without.copy()
    for fold in np.unique(block[block >= 0] % 2):
        unknown = (of_row % 2 == fold)[:, None]
        found = find(replace(chart, source=np.where(unknown, OUTSIDE, chart.source).astype(np.uint8)))
        if found is not None:
            own = block % 2 == fold
            errors[own] = holes.errors(chart, fill(holes.chart, holes.footprint, found))[own]
    return by_block(errors, block), by_block(without, block)


def by_block(errors: Float64, block: NDArray[np.int64]) -> Float64:
    """Means (M,) of the errors of holes (N,) by block (N,), without those of holes that lie in two."""
    whole = block >= 0
    _, number, count = np.unique(block[whole], return_inverse=True, return_counts=True)
    return np.bincount(number, errors[whole], len(count)) / count


def _block(rows: NDArray[np.int64], texel: float) -> NDArray[np.int64]:
    return (rows * texel / BLOCK_M).astype(np.int64)


def plant_holes(chart: StreetChart, footprint: Mask) -> PlantedHoles:
    """Holes where a chart's street was seen.

    Args:
        chart: as read; footprint: (A, B) texels under removed objects.
    """
    per_m = 1.0 / chart.texel
    seen = chart.source == OBSERVED
    free = seen & ~grow(footprint, AWAY_M * per_m)
    number = np.zeros(seen.shape, np.int32)
    planted = np.zeros_like(seen)
    count = hidden = 0
    for stamp, (row, column) in _stamps(footprint, chart.texel):
        hole = grow(np.pad(stamp, round(2 * MARGIN_M * per_m)), MARGIN_M * per_m)
        for along, across in MOVED_M:
            top = row + round(along * per_m) - round(2 * MARGIN_M * per_m)
            left = column + round(across * per_m) - round(2 * MARGIN_M * per_m)
            place = slice(top, top + hole.shape[0]), slice(left, left + hole.shape[1])
            if top < 0 or left < 0 or place[0].stop > len(seen) or place[1].stop > seen.shape[1]:
                continue
            if number[place][hole].any() or free[place][hole].mean() < SEEN:
                continue
            if hidden + hole.sum() > MOST_SHARE * free.sum():
                continue
            count += 1
            number[place][hole] = count
            planted[place] |= np.pad(stamp, round(2 * MARGIN_M * per_m))
            hidden += int(hole.sum())
            break
    holes = number > 0
    holed = replace(
        chart,
        color=np.where(holes[..., None], 0, chart.color).astype(np.float32),
        label=np.where(holes, -1, chart.label).astype(chart.label.dtype),
        source=np.where(holes, OUTSIDE, chart.source).astype(np.uint8),
        nearest=np.where(holes, np.inf, chart.nearest).astype(np.float32),
    )
    return PlantedHoles(holed, footprint | planted, number, count)


def _stamps(footprint: Mask, texel: float) -> Iterator[tuple[Mask, tuple[int, int]]]:
    """The objects' footprints, cropped, and the row and column where each begins."""
    _, part = cv2.connectedComponents(footprint.astype(np.uint8), connectivity=8)
    for k, place in enumerate(ndimage.find_objects(part), start=1):
        stamp = part[place] == k
        if stamp.sum() * texel**2 >= LEAST_M2:
            yield stamp, (place[0].start, place[1].start)
