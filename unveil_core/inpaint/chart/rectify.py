"""Rectification of the path: how far the street drifts sideways from it, because a car does not keep its distance from the
kerb.

Paint and kerbs show it. For every row the shift is found that puts them where the street around has them, all rows together by
dynamic programming (Ohta and Kanade, *Stereo by intra- and inter-scanline search using dynamic programming*, 1985).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.cheapest_path import cheapest_path
from unveil_core.geometry.images import luminance
from unveil_core.ground.path import StreetPath, shift_path
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.street_chart import OBSERVED, read_chart

__all__ = ["find_drift", "rectified_path"]

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
ROUNDS = 3
"""Times that shifts and the reference they are compared with are found in turn. Chosen on the two sample streets."""


def find_drift(color: Float32, usable: Mask, *, texels_per_m: float) -> Float32:
    """(A,) how far the street lies beside the columns of a chart, per row, positive to the left, texels.

    Args:
        color: (A, B, 3); usable: (A, B) texels that count.
    """
    rows, columns = usable.shape
    size = max(1, round(BIN_M * texels_per_m))
    bins = -(-rows // size)
    log = np.log(np.maximum(luminance(color), 0.02)).astype(np.float32)
    fine, broad = (_across(log, usable, sigma * texels_per_m) for sigma in (FINE_M, BROAD_M))
    contrast = np.where(usable, np.clip(fine - broad, -CONTRAST, CONTRAST), 0).astype(np.float32)
    first = np.arange(0, rows, size)
    count = np.add.reduceat(usable.astype(np.float32), first, axis=0)
    lines = np.add.reduceat(contrast, first, axis=0) / np.maximum(count, 1)
    weight = np.where(count >= size / 2, 1.0, 0.0).astype(np.float32)
    reach = round(REACH_M * texels_per_m)
    shifts = np.arange(-reach, reach + 1)
    shift = np.zeros(bins, dtype=np.int64)
    around = max(1, int(AROUND_M / BIN_M))
    for _ in range(ROUNDS):
        rectified, counted = _shifted(lines, shift), _shifted(weight, shift)
        total, many = (
            cv2.boxFilter(p, -1, (1, 2 * around + 1), normalize=False, borderType=cv2.BORDER_CONSTANT)
            for p in (rectified * counted, counted)
        )
        reference = total / np.maximum(many, 1e-3)
        trusted = (many >= FEWEST_BINS).astype(np.float32)
        cost = np.zeros((bins, len(shifts)))
        for k, d in enumerate(shifts):
            whole = np.full(bins, d)
            both = _shifted(weight, whole) * trusted
            gap = (_shifted(lines, whole) - reference) ** 2 * both
            cost[:, k] = gap.sum(axis=1) / (both.sum(axis=1) + FLAT_M * texels_per_m)
        shift = shifts[_smoothest(cost)]
        shift = shift - int(np.median(shift))
    at = (first + (size - 1) / 2).astype(np.float64)
    smooth = cv2.GaussianBlur(shift.astype(np.float32)[:, None], (1, 7), 0, sigmaY=1.5)[:, 0]
    return np.interp(np.arange(rows), at, smooth).astype(np.float32)


def rectified_path(
    ground: Ground,
    cameras: Sequence[Camera],
    images: Sequence[NDArray[np.uint8]],
    labels: Sequence[NDArray[np.int64]],
    usable: Sequence[Mask],
) -> tuple[StreetPath, float]:
    """The ground's path, moved so that paint and kerbs keep their lateral offset: the car does not keep its distance from them.

    Args:
        images, labels, usable: (H, W…) per camera, see :func:`unveil_core.inpaint.chart.street_chart.read_chart`.
    Returns:
        the path, and how far it was moved at most, metres.
    """
    chart = read_chart(ground, cameras, images, labels, usable)
    aside = find_drift(chart.color, chart.source == OBSERVED, texels_per_m=1 / chart.texel) * chart.texel
    return shift_path(ground.path, chart.coordinates()[0], aside), float(np.abs(aside).max(initial=0.0))


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
