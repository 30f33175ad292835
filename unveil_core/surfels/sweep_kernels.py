"""The compiled loop of the plane sweep: one band of rows against all neighbours and all depths."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import FAST

__all__ = ["NOTHING", "sweep_bands"]

STRICT = {**FAST, "fastmath": False}
"""Sums in the order that is written: free to change it, the compiler rounds differently when it compiles a called kernel alone
and when it compiles it into its caller, and a cached program would find other depths than a fresh one."""
f32, u32, u64 = np.float32, np.uint32, np.uint64
ONE = u64(1)
NOTHING = f32(-1)
"""The correlation where nothing could be compared."""
BAND = 16
"""Rows that are swept together. How sums round depends on the columns asked for within a band."""
LEAST_VARIANCE = f32(4)
"""Of grey values, squared levels of 255: below it a window has no texture to compare."""


@njit(**STRICT)
def _warp(picture, turn, shift, inverse, row, first, last, warped, seen):
    """A row of the neighbour's picture as the plane brings it here, columns ``first`` to ``last``; 0 and unseen outside."""
    right, bottom = f32(picture.shape[1] - 1), f32(picture.shape[0] - 1)
    last_left, last_top = u32(picture.shape[1] - 2), u32(picture.shape[0] - 2)
    x0 = turn[0, 1] * f32(row) + turn[0, 2] + shift[0] * inverse
    y0 = turn[1, 1] * f32(row) + turn[1, 2] + shift[1] * inverse
    z0 = turn[2, 1] * f32(row) + turn[2, 2] + shift[2] * inverse
    dx, dy, dz = turn[0, 0], turn[1, 0], turn[2, 0]
    for column in range(u64(first), u64(last)):
        c = f32(np.int32(column))
        z = z0 + dz * c
        r = f32(1) / (z if z > f32(0) else f32(1))
        x, y = (x0 + dx * c) * r, (y0 + dy * c) * r
        inside = (z > f32(0)) & (x >= f32(0)) & (x <= right) & (y >= f32(0)) & (y <= bottom)
        x, y = x if inside else f32(0), y if inside else f32(0)
        left, top = min(u32(x), last_left), min(u32(y), last_top)
        fx, fy = x - f32(left), y - f32(top)
        i, j = u64(top), u64(left)
        above = picture[i, j] + (picture[i, j + ONE] - picture[i, j]) * fx
        below = picture[i + ONE, j] + (picture[i + ONE, j + ONE] - picture[i + ONE, j]) * fx
        warped[column] = above + (below - above) * fy if inside else f32(0)
        seen[column] = inside


@njit(**STRICT)
def _window_sums(values, others, row, half, first, last, down, sums):
    """Sums of the products of two bands over the window around each pixel of a row, columns ``first`` to ``last``."""
    low, high = u64(first - half), u64(last + half)
    for column in range(low, high):
        down[column] = f32(0)
    for r in range(u64(row - half), u64(row + half + 1)):
        for column in range(low, high):
            down[column] += values[r, column] * others[r, column]
    for column in range(u64(first), u64(last)):
        sums[column] = f32(0)
    for step in range(u64(2 * half + 1)):
        for column in range(u64(first), u64(last)):
            sums[column] += down[column + step - u64(half)]


@njit(**STRICT)
def _sweep_rows(start, stop, gray, pictures, turns, shifts, inverse, usable, half, rung, score, before, after):
    """Rows ``start`` to ``stop`` of one frame.

    Args:
        gray: (H, W); pictures: (V, H', W') of the neighbours.
        turns: (V, 3, 3), shifts: (V, 3): a pixel (column, row, 1) at inverse depth i lies in neighbour v at
            ``turns[v] p + i shifts[v]``, homogeneous.
        inverse: (D,) inverse depths, from near to far; usable: (H, W) uint8, pixels that are asked for.
        half: half of the window's side.
        rung, score, before, after: (H, W) results: index of the best depth, its correlation, and those of the depths next
            to it; ``NOTHING`` where there is none.
    """
    height, width = gray.shape
    count = len(pictures)
    low, high = max(start, half), min(stop, height - half)
    first, last = width, 0
    for row in range(low, high):
        for column in range(half, width - half):
            if usable[row, column]:
                first, last = min(first, column), max(last, column + 1)
    score[start:stop] = before[start:stop] = after[start:stop] = NOTHING
    rung[start:stop] = 0
    if first >= last:
        return
    rows = high - low
    band = gray[low - half : high + half]
    ones = np.ones_like(band)
    warped, seen = np.zeros_like(band), np.zeros(band.shape, np.bool_)
    down = np.empty(width, np.float32)
    mean, spread = np.empty((rows, width), np.float32), np.empty((rows, width), np.float32)
    best, second = np.empty((rows, width), np.float32), np.empty((rows, width), np.float32)
    previous = np.full((rows, width), NOTHING, np.float32)
    plain, square, product = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    share = f32(1) / f32((2 * half + 1) ** 2)
    for r in range(rows):
        _window_sums(band, ones, r + half, half, first, last, down, plain)
        _window_sums(band, band, r + half, half, first, last, down, square)
        for column in range(first, last):
            mean[r, column] = plain[column] * share
            spread[r, column] = square[column] * share - mean[r, column] * mean[r, column]
    for k in range(len(inverse)):
        best[:] = NOTHING
        second[:] = NOTHING
        for v in range(count):
            for r in range(len(band)):
                row = low - half + r
                _warp(pictures[v], turns[v], shifts[v], inverse[k], row, first - half, last + half, warped[r], seen[r])
            for r in range(rows):
                _window_sums(warped, ones, r + half, half, first, last, down, plain)
                _window_sums(warped, warped, r + half, half, first, last, down, square)
                _window_sums(warped, band, r + half, half, first, last, down, product)
                for column in range(u64(first), u64(last)):
                    m = plain[column] * share
                    variance = square[column] * share - m * m
                    together = product[column] * share - mean[r, column] * m
                    c = together / np.sqrt(max(spread[r, column] * variance, LEAST_VARIANCE * LEAST_VARIANCE))
                    c = c if seen[r + half, column] else NOTHING
                    leader = best[r, column]
                    second[r, column] = max(second[r, column], min(leader, c))
                    best[r, column] = max(leader, c)
        for r in range(rows):
            row = low + r
            for column in range(first, last):
                # The two best of the neighbours: what one does not see, the others may.
                c = (best[r, column] + second[r, column]) * f32(0.5) if count > 2 else best[r, column]
                if rung[row, column] == k - 1:
                    after[row, column] = c
                if c > score[row, column]:
                    score[row, column], rung[row, column] = c, k
                    before[row, column], after[row, column] = previous[r, column], NOTHING
                previous[r, column] = c
    for r in range(rows):
        for column in range(first, last):
            if spread[r, column] <= LEAST_VARIANCE or not usable[low + r, column]:
                score[low + r, column] = NOTHING


@njit(**STRICT)
def sweep_bands(start, stop, gray, *arguments):
    """Bands ``start`` to ``stop`` of ``BAND`` rows, each alone: how many a thread takes must not change what is found."""
    for band in range(start, stop):
        _sweep_rows(band * BAND, min((band + 1) * BAND, len(gray)), gray, *arguments)
