"""Rectification of the path: how far the street drifts sideways from it, because a car does not keep its distance from the
kerb.

Paint and kerbs show it. For every row the shift is found that puts them where the street around has them, all rows together by
dynamic programming (Ohta and Kanade, *Stereo by intra- and inter-scanline search using dynamic programming*, 1985).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.frame_cache import subset
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.resume.checkpoint import Kept
from unveil_core.base.types import Float32, Levels, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.cheapest_path import cheapest_path
from unveil_core.geometry.images import luminance
from unveil_core.geometry.reach import centres_of
from unveil_core.ground.path import StreetPath, shift_path
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.street_chart import OBSERVED, READ_M, TEXEL_M, arc_lengths, read_chart, rows_of

__all__ = ["LEAST_AGREEMENT", "Drift", "Rectified", "RowBins", "find_drift", "rectified_path"]

BIN_M = 0.5
"""Length of street that is given one shift, metres: at a drift of a few per cent a line stays within a texel over it."""
REACH_M = 0.8
"""Largest shift to either side, metres: a driver's wandering within a lane. Chosen on the two sample streets."""
AROUND_M = 25.0
"""Half length of the street that a bin is compared with, metres: long beside a parked row, short beside a bend. Chosen on the
two sample streets."""
FINE_M, BROAD_M = 0.04, 0.25
"""Standard deviations across the street of the two blurs whose difference is compared, metres: it keeps what is as wide as
painted lines (0.1 to 0.3 m) and kerbs, and drops grain and shading."""
CONTRAST = 0.15
"""Difference of log luminance at which the contrast is clipped, so that one strong edge does not outvote several lines. Chosen
on the two sample streets."""
STEP_COST = 0.0003
"""Cost of a change of the shift by one texel from bin to bin, in mean squared contrast. Chosen on the two sample streets."""
FEWEST_BINS = 4
"""Bins around that must show an offset for it to be compared: 2 m of street."""
FLAT_M = 2.0
"""Width in metres of compared street that counts as one more match without difference: where little is compared, no shift wins."""
PIECE_M = 100.0
"""Length of street that is read at once, metres: 200 MB of texels, and twice as much street as a view is read beyond its ends."""
ROUNDS = 3
"""Times that shifts and the reference they are compared with are found in turn. Chosen on the two sample streets."""
LEAST_AGREEMENT = 0.05
"""Share of the contrast across the street that must keep its lateral offset for shifts to be believed. Of drawn and real streets it
is 0.08 to 0.65; of grain, which shifts follow by chance, up to 0.03, from 6 m of street on."""


@dataclass(frozen=True, eq=False)
class RowBins:
    """Paint and kerbs of a chart, in bins of :data:`BIN_M` along the street.

    Attributes:
        lines: (A, B) contrast across the street, the mean over a bin's rows; shown: (A, B) 1 where enough of them are seen, else 0.
    """

    lines: Float32
    shown: Float32

    @staticmethod
    def of_chart(color: Float32, usable: Mask, *, texels_per_m: float) -> RowBins:
        """Bins of a chart; only the last one may lack rows.

        Args:
            color: (A, B, 3); usable: (A, B) texels that count.
        """
        size = bin_rows(texels_per_m)
        log = np.log(np.maximum(luminance(color), 0.02)).astype(np.float32)
        fine, broad = (_across(log, usable, sigma * texels_per_m) for sigma in (FINE_M, BROAD_M))
        contrast = np.where(usable, np.clip(fine - broad, -CONTRAST, CONTRAST), 0).astype(np.float32)
        first = np.arange(0, len(color), size)
        count = np.add.reduceat(usable.astype(np.float32), first, axis=0)
        lines = np.add.reduceat(contrast, first, axis=0) / np.maximum(count, 1)
        return RowBins(lines, np.where(count >= size / 2, 1.0, 0.0).astype(np.float32))  # type: ignore[arg-type]

    @staticmethod
    def joined(pieces: Sequence[RowBins]) -> RowBins:
        """The bins of pieces of one street that follow each other."""
        return RowBins(np.concatenate([p.lines for p in pieces]), np.concatenate([p.shown for p in pieces]))


@dataclass(frozen=True, eq=False)
class Drift:
    """How far a street lies beside the columns of a chart.

    Attributes:
        aside: (A,) per row, positive to the left, texels; 0 where no shift is believed.
        agreement: share of the contrast across the street that keeps its lateral offset once its rows are shifted, 0 to 1.
    """

    aside: Float32
    agreement: float


@dataclass(frozen=True, eq=False)
class Rectified:
    """A path along which paint and kerbs keep their lateral offset.

    Attributes:
        path: the path; moved_m: how far it was moved at most, metres; agreement: see :class:`Drift`.
    """

    path: StreetPath
    moved_m: float
    agreement: float


def bin_rows(texels_per_m: float) -> int:
    """Rows of a chart in a bin."""
    return max(1, round(BIN_M * texels_per_m))


def find_drift(bins: RowBins, rows: int, *, texels_per_m: float) -> Drift:
    """How far the street lies beside the columns of a chart: nowhere, unless paint and kerbs run along it.

    Args:
        bins: of a chart of so many rows.
    """
    lines, weight = bins.lines, bins.shown
    reach = round(REACH_M * texels_per_m)
    shifts = np.arange(-reach, reach + 1)
    shift = np.zeros(len(lines), dtype=np.int64)
    for _ in range(ROUNDS):
        total, many = _around(_shifted(lines, shift), _shifted(weight, shift))
        reference = total / np.maximum(many, 1e-3)
        trusted = (many >= FEWEST_BINS).astype(np.float32)
        cost = np.zeros((len(lines), len(shifts)))
        for k, d in enumerate(shifts):
            whole = np.full(len(lines), d)
            both = _shifted(weight, whole) * trusted
            gap = (_shifted(lines, whole) - reference) ** 2 * both
            cost[:, k] = gap.sum(axis=1) / (both.sum(axis=1) + FLAT_M * texels_per_m)
        shift = shifts[_smoothest(cost)]
        shift = shift - int(np.median(shift))
    agreement = _agreement(_shifted(lines, shift), _shifted(weight, shift))
    if agreement < LEAST_AGREEMENT:
        return Drift(np.zeros(rows, np.float32), agreement)
    size = bin_rows(texels_per_m)
    at = (size * np.arange(len(lines)) + (size - 1) / 2).astype(np.float64)
    smooth = cv2.GaussianBlur(shift.astype(np.float32)[:, None], (1, 7), 0, sigmaY=1.5)[:, 0]
    return Drift(np.interp(np.arange(rows), at, smooth).astype(np.float32), agreement)


def _around(lines: Float32, weight: Float32) -> tuple[Float32, Float32]:
    """Sum of the lines (A, B) of the bins around each one, itself among them, at each offset, and how many of these are shown."""
    around = max(1, int(AROUND_M / BIN_M))
    total, many = (
        cv2.boxFilter(p, -1, (1, 2 * around + 1), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for p in (lines * weight, weight)
    )
    return total, many


def _agreement(lines: Float32, weight: Float32) -> float:
    """Share, 0 to 1, of the contrast of bins that the others around them have, too; 0 where there is none to compare."""
    total, many = _around(lines, weight)
    weight = weight * (many >= FEWEST_BINS)
    # Without itself: of few bins the mean is like each of them.
    others = (total - lines) / np.maximum(many - 1, 1)
    shared, whole = (float((lines * p * weight).sum()) for p in (others, lines))
    return max(0.0, shared / whole) if whole > 0 else 0.0


def rectified_path(
    ground: Ground,
    cameras: Sequence[Camera],
    images: Sequence[Levels],
    labels: Sequence[NDArray[np.int64]],
    usable: Sequence[Mask],
    kept: Kept | None = None,
    progress: Progress = no_progress,
) -> Rectified:
    """The ground's path, moved so that paint and kerbs keep their lateral offset: the car does not keep its distance from them.

    The street is read in pieces, of which only the bins are kept.

    Args:
        images, labels, usable: (H, W…) per camera, see :func:`unveil_core.inpaint.chart.street_chart.read_chart`.
        kept: where an interrupted call leaves the pieces that it has read.
    """
    per_m, count, kept = 1 / TEXEL_M, rows_of(ground), kept or Kept()
    s_of_camera = ground.path.to_street(centres_of(cameras))[:, 0]
    length = bin_rows(per_m) * round(PIECE_M / BIN_M)

    def read(first: int, end: int) -> dict[str, NDArray[Any]]:
        low, high = (ground.s_start + TEXEL_M * row for row in (first, end))
        near = np.flatnonzero((s_of_camera >= low - READ_M) & (s_of_camera <= high + READ_M)).tolist()
        chart = read_chart(
            ground,
            [cameras[i] for i in near],
            subset(images, near),
            subset(labels, near),
            subset(usable, near),
            rows=(first, end),
        )
        bins = RowBins.of_chart(chart.color, chart.source == OBSERVED, texels_per_m=per_m)
        return {"lines": bins.lines, "shown": bins.shown}

    pieces = []
    for first in range(0, count, length):
        piece = partial(read, first, min(first + length, count))
        pieces.append(RowBins(**kept.once(f"lines-{first}", piece)))
        progress(min(first + length, count), count, "following lines and kerbs")
    drift = find_drift(RowBins.joined(pieces), count, texels_per_m=per_m)
    aside = drift.aside * TEXEL_M
    path = shift_path(ground.path, arc_lengths(ground, (0, count)), aside)  # type: ignore[arg-type]
    return Rectified(path, float(np.abs(aside).max(initial=0.0)), drift.agreement)


def _across(plane: Float32, usable: Mask, sigma: float) -> Float32:
    """Blur across the street only, over what is usable."""
    m = usable.astype(np.float32)
    width = 2 * int(3 * sigma) + 3
    value = cv2.GaussianBlur(plane * m, (width, 1), sigma)
    return np.asarray(value / np.maximum(cv2.GaussianBlur(m, (width, 1), sigma), 1e-3), dtype=np.float32)


def _shifted(plane: Float32, shift: NDArray[np.int64]) -> Float32:
    """Rows (A, B) read at their column plus their shift (A,), whole texels, clamped at the ends."""
    columns = plane.shape[1]
    index = np.clip(np.arange(columns)[None] + shift[:, None], 0, columns - 1)
    return np.take_along_axis(plane, index, axis=1)


def _smoothest(cost: NDArray[np.float64]) -> NDArray[np.int64]:
    """(A,) columns of the cheapest path through ``cost`` (A, D), each step aside costing ``STEP_COST``."""
    choices = np.arange(cost.shape[1])
    change = np.abs(choices[:, None] - choices[None]) * STEP_COST

    def step(total: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        options = total[None] + change
        best = options.argmin(axis=1)
        return best, np.take_along_axis(options, best[:, None], axis=1)[:, 0]

    return cheapest_path(cost, step)
