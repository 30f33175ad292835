"""Projected surfels sorted by depth, and listed tile by tile."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

from unveil_core.base.parallel import FAST

__all__ = ["arrange", "fill_tiles"]

u64, i64 = np.uint64, np.int64
INLINED = {**FAST, "forceinline": True}


@njit(**INLINED)
def depth_order(depth_bits, visible, keys, spare, order):
    """Indices of the visible surfels by depth into ``order``, ties by index, and how many there are: a radix sort of
    the bits of positive floats."""
    count = 0
    for i in range(len(visible)):
        if visible[i]:
            keys[count] = (u64(depth_bits[i]) << u64(32)) | u64(i)
            count += 1
    for turn in range(3):
        shift = u64(32 + 11 * turn)
        start = np.zeros(2049, np.int64)
        for i in range(count):
            start[i64((keys[i] >> shift) & u64(2047)) + 1] += 1
        for i in range(2048):
            start[i + 1] += start[i]
        for i in range(count):
            digit = i64((keys[i] >> shift) & u64(2047))
            spare[start[digit]] = keys[i]
            start[digit] += 1
        keys, spare = spare, keys
    for i in range(count):
        order[i] = np.int32(keys[i] & u64(0xFFFFFFFF))
    return count


@njit(**INLINED)
def count_tiles(boxes, visible, tiles_x, tiles_y, surfel_start, offsets):
    """Intersections before each surfel (N + 1,) and before each tile (T + 1,)."""
    per_tile = np.zeros(tiles_x * tiles_y, np.int64)
    total = 0
    for n in range(len(visible)):
        surfel_start[n] = total
        if visible[n]:
            x0, x1, y0, y1 = i64(boxes[n, 0]), i64(boxes[n, 1]), i64(boxes[n, 2]), i64(boxes[n, 3])
            for y in range(y0, y1 + 1):
                for x in range(x0, x1 + 1):
                    per_tile[y * tiles_x + x] += 1
            total += (x1 - x0 + 1) * (y1 - y0 + 1)
    surfel_start[len(visible)] = total
    offsets[0] = 0
    for t in range(tiles_x * tiles_y):
        offsets[t + 1] = offsets[t] + per_tile[t]


@njit(**FAST)
def arrange(first, end, depth_bits, visible, keys, spare, order, found, boxes, tiles_x, tiles_y, surfel_start, offsets):
    """Two tasks that need nothing of each other: number 0 sorts (``found[0]`` surfels), number 1 counts."""
    for task in range(first, end):
        if task == 0:
            found[0] = depth_order(depth_bits, visible, keys, spare, order)
        else:
            count_tiles(boxes, visible, tiles_x, tiles_y, surfel_start, offsets)


@njit(**FAST)
def fill_tiles(low, high, order, boxes, tiles_x, surfel_start, offsets, ids, place):
    """Tile lists of surfels in depth order for a band of tile rows, and for each entry the place of its gradient row.

    Rows lie surfel after surfel: scattered stores in backward wait for nobody, scattered loads in the reduction would.
    """
    cursor = offsets[low * tiles_x : high * tiles_x].copy()
    for n in order:
        y0, y1 = i64(boxes[n, 2]), i64(boxes[n, 3])
        if y1 < low or y0 >= high:
            continue
        x0, x1 = i64(boxes[n, 0]), i64(boxes[n, 1])
        across = x1 - x0 + 1
        for y in range(max(y0, low), min(y1, high - 1) + 1):
            for x in range(x0, x1 + 1):
                k = (y - low) * tiles_x + x
                entry = cursor[k]
                cursor[k] = entry + 1
                ids[entry] = n
                place[entry] = surfel_start[n] + (y - y0) * across + (x - x0)
