"""The compiled loop that compares a photograph with others as planes would carry them over."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.surfels.sweep_kernels import NOTHING, STRICT

__all__ = ["BAND", "NOTHING", "compare_bands"]

f32 = np.float32
BAND = 24
"""Rows that are compared together."""
LEAST_VARIANCE = 4.0
"""Of grey values, squared levels of 255: noise of less contrast correlates with nothing."""
LEAST_SHARE = 0.5
"""Of a window that must be in both pictures."""


@njit(**STRICT)
def _level(area, steps):
    """How coarse a picture must be taken of which one pixel holds so many pixels' ``area`` of the other's."""
    level = 0
    while level < len(steps) and area >= steps[level]:
        level += 1
    return level


@njit(**STRICT)
def _carried(own, other, turn, steps, row, values, others, valid):
    """A row of the photograph (L, H, W), and what a homography brings there of another (L, H', W'), each as coarse as the other."""
    bottom, right = f32(other.shape[1] - 1), f32(other.shape[2] - 1)
    size = (
        turn[0, 0] * (turn[1, 1] * turn[2, 2] - turn[1, 2] * turn[2, 1])
        - turn[0, 1] * (turn[1, 0] * turn[2, 2] - turn[1, 2] * turn[2, 0])
        + turn[0, 2] * (turn[1, 0] * turn[2, 1] - turn[1, 1] * turn[2, 0])
    )
    for column in range(own.shape[2]):
        z = turn[2, 0] * column + turn[2, 1] * row + turn[2, 2]
        values[column] = others[column] = valid[column] = 0.0
        if z <= 1e-9:
            continue
        x = f32((turn[0, 0] * column + turn[0, 1] * row + turn[0, 2]) / z)
        y = f32((turn[1, 0] * column + turn[1, 1] * row + turn[1, 2]) / z)
        if not (x >= 0 and y >= 0 and x < right and y < bottom):
            continue
        area = abs(size) / (z * z * z)
        there = other[_level(area, steps)]
        i, j = int(y), int(x)
        v, u = y - f32(i), x - f32(j)
        above = there[i, j] + (there[i, j + 1] - there[i, j]) * u
        below = there[i + 1, j] + (there[i + 1, j + 1] - there[i + 1, j]) * u
        values[column] = own[_level(1.0 / area if area > 0 else 1e9, steps), row, column]
        others[column] = above + (below - above) * v
        valid[column] = 1.0


@njit(**STRICT)
def _add(sums, a, b, valid, sign):
    """Add to the columns' sums (6, W), or take away, a row of both pictures."""
    for column in range(len(a)):
        if valid[column] > 0:
            p, q = float(a[column]), float(b[column])
            sums[0, column] += sign
            sums[1, column] += sign * p
            sums[2, column] += sign * q
            sums[3, column] += sign * p * p
            sums[4, column] += sign * q * q
            sums[5, column] += sign * p * q


@njit(**STRICT)
def _correlate(sums, half, full, result):
    """Raise a row of the result (W,) to the correlation of both pictures over the windows of which ``sums`` are the columns."""
    width = sums.shape[1]
    total = np.zeros(6)
    for column in range(min(half, width)):
        for k in range(6):
            total[k] += sums[k, column]
    for column in range(width):
        if column + half < width:
            for k in range(6):
                total[k] += sums[k, column + half]
        if column - half - 1 >= 0:
            for k in range(6):
                total[k] -= sums[k, column - half - 1]
        count = total[0]
        if count < LEAST_SHARE * full:
            continue
        p, q = total[1] / count, total[2] / count
        both = (total[3] / count - p * p) * (total[4] / count - q * q)
        c = (total[5] / count - p * q) / np.sqrt(max(both, LEAST_VARIANCE))
        result[column] = max(result[column], f32(c))


@njit(**STRICT)
def compare_bands(start, stop, own, others, turns, steps, half, result):
    """Bands ``start`` to ``stop`` of ``BAND`` rows.

    Args:
        own: (L, H, W) a photograph, ever coarser; others: (V, L, H', W').
        turns: (D, V, 3, 3) homographies from it to the others, by each plane.
        steps: (L - 1,) rising: areas of the one's pixel in the other from which on the other is taken one level coarser.
        half: of the window's side.
        result: (H, W) the best correlation with any of the others by any plane, ``NOTHING`` where there is none.
    """
    height, width = own.shape[1:]
    rows = BAND + 2 * half
    a, b = np.zeros((rows, width), np.float32), np.zeros((rows, width), np.float32)
    valid = np.zeros((rows, width), np.float32)
    full = float((2 * half + 1) ** 2)
    for band in range(start, stop):
        low, high = band * BAND, min((band + 1) * BAND, height)
        first, last = max(0, low - half), min(height, high + half)
        result[low:high] = NOTHING
        for d in range(len(turns)):
            for v in range(len(others)):
                for row in range(first, last):
                    k = row - first
                    _carried(own, others[v], turns[d, v], steps, row, a[k], b[k], valid[k])
                sums = np.zeros((6, width))
                for row in range(first, min(last, low + half)):
                    _add(sums, a[row - first], b[row - first], valid[row - first], 1.0)
                for row in range(low, high):
                    if row + half < last:
                        k = row + half - first
                        _add(sums, a[k], b[k], valid[k], 1.0)
                    if row - half - 1 >= first:
                        k = row - half - 1 - first
                        _add(sums, a[k], b[k], valid[k], -1.0)
                    _correlate(sums, half, full, result[row])
