"""Projected surfels sorted by depth, and listed tile by tile.

Both are counting sorts, cut into parts: each part counts, the counts of all say where the entries of each part go, and each part
moves its own there. The result is the same for any number of parts, so as many are made as there are threads.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.array_pool import Buffers
from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import FAST, in_parallel, thread_count

__all__ = ["Bins", "bin_surfels"]

u64, i64 = np.uint64, np.int64
DIGIT_BITS, TURNS = 11, 3
"""Depths are the bits of positive floats, sorted by three digits of 11 bits, the lowest first (radix sort)."""
DIGITS = 1 << DIGIT_BITS
LEAST_SORTED, LEAST_LISTED = 50_000, 2_000
"""Fewest surfels of a part when they are sorted, and when they are listed by tile: handing out a part takes as long as that."""


@dataclass(frozen=True, eq=False)
class Bins:
    """Surfels by tile.

    Attributes:
        surfel_start: (N + 1,) intersections of tiles before each surfel.
        offsets: (T + 1,) entries before each tile, row after row of tiles.
        ids, place: (E,) surfel of each entry, in order of depth, and the place of its gradient row, rows lying surfel after surfel:
            scattered stores in backward wait for nobody, scattered loads in the reduction would.
    """

    surfel_start: NDArray[np.int64]
    offsets: NDArray[np.int64]
    ids: NDArray[np.int32]
    place: NDArray[np.int32]


def bin_surfels(
    depth_bits: NDArray[np.uint32],
    visible: NDArray[np.uint8],
    boxes: NDArray[Any],
    tiles: tuple[int, int],
    buffers: Buffers,
) -> Bins:
    """List the visible surfels of each tile by depth, ties by index.

    Args:
        depth_bits: (N,) of positive floats; visible: (N,); boxes: (N, 4) first and last column and row of tiles.
        tiles: columns and rows.
        buffers: for the arrays.
    Raises:
        ValueError: more entries than 32 bits count.
    """
    count, (tiles_x, tiles_y) = len(visible), tiles
    surfel_start = buffers.array("surfel_start", (count + 1,), np.int64)
    order = _sorted(depth_bits, visible, boxes, surfel_start, buffers)
    step, parts = _parts(len(order), LEAST_LISTED)
    cursors = buffers.array("cursors", (parts, tiles_x * tiles_y), np.int64)
    cursors[:] = 0
    in_parallel(count_tiles, len(order), step, step, order, boxes, tiles_x, cursors)
    offsets = buffers.array("offsets", (tiles_x * tiles_y + 1,), np.int64)
    tile_offsets(cursors, offsets)
    total = int(offsets[-1])
    if total > np.iinfo(np.int32).max:
        raise ValueError(
            f"{total} surfel-tile intersections in one view; the surfels are too large for this image size"
        )
    ids, place = (buffers.array(name, (total,), np.int32) for name in ("ids", "place"))
    in_parallel(fill_tiles, len(order), step, step, order, boxes, tiles_x, surfel_start, cursors, ids, place)
    return Bins(surfel_start, offsets, ids, place)


def _sorted(
    depth_bits: NDArray[np.uint32],
    visible: NDArray[np.uint8],
    boxes: NDArray[Any],
    surfel_start: NDArray[np.int64],
    buffers: Buffers,
) -> NDArray[np.int32]:
    """Indices of the visible surfels by depth; ``surfel_start`` is filled on the way."""
    count = len(visible)
    step, parts = _parts(count, LEAST_SORTED)
    counts, areas = np.zeros((parts, DIGITS), np.int64), np.zeros(parts, np.int64)
    in_parallel(count_visible, count, step, step, depth_bits, visible, boxes, counts, areas)
    before = np.cumsum(areas) - areas
    keys, spare = (buffers.array(name, (count,), np.uint64) for name in ("keys", "spare"))
    seen = int(counts.sum())
    starts = _starts(counts)
    in_parallel(scatter_visible, count, step, step, depth_bits, visible, boxes, starts, before, keys, surfel_start)
    surfel_start[count] = areas.sum()
    step, parts = _parts(seen, LEAST_SORTED)
    for turn in range(1, TURNS):
        shift = 32 + DIGIT_BITS * turn
        counts = np.zeros((parts, DIGITS), np.int64)
        in_parallel(count_digits, seen, step, step, keys, shift, counts)
        in_parallel(scatter_keys, seen, step, step, keys, shift, _starts(counts), spare)
        keys, spare = spare, keys
    order = buffers.array("order", (count,), np.int32)[:seen]
    order[:] = keys[:seen] & np.uint64(0xFFFFFFFF)
    return order


def _parts(count: int, least: int) -> tuple[int, int]:
    """Size of a part, and how many there are."""
    step = max(least, -(-count // thread_count()), 1)
    return step, max(1, -(-count // step))


def _starts(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """(P, D) where the entries of each part go, digit by digit, from how many it has."""
    by_digit = counts.T.ravel()
    return np.ascontiguousarray((np.cumsum(by_digit) - by_digit).reshape(counts.T.shape).T)


@njit(**FAST)
def area_of(boxes, n):  # type: ignore[no-untyped-def]
    """Tiles that a surfel's box covers."""
    return (i64(boxes[n, 1]) - i64(boxes[n, 0]) + 1) * (i64(boxes[n, 3]) - i64(boxes[n, 2]) + 1)


@njit(**FAST)
def count_visible(first, end, step, depth_bits, visible, boxes, counts, areas):  # type: ignore[no-untyped-def]
    """Visible surfels by their lowest digit (P, D), and the tiles they cover (P,)."""
    part = first // step
    area = i64(0)
    for i in range(first, end):
        if visible[i]:
            counts[part, i64(depth_bits[i]) & i64(DIGITS - 1)] += 1
            area += area_of(boxes, i)
    areas[part] = area


@njit(**FAST)
def scatter_visible(  # type: ignore[no-untyped-def]
    first, end, step, depth_bits, visible, boxes, starts, before, keys, surfel_start
):
    """Keys of the visible surfels by their lowest digit, and the intersections before each surfel."""
    part = first // step
    total = before[part]
    for i in range(first, end):
        surfel_start[i] = total
        if visible[i]:
            digit = i64(depth_bits[i]) & i64(DIGITS - 1)
            keys[starts[part, digit]] = (u64(depth_bits[i]) << u64(32)) | u64(i)
            starts[part, digit] += 1
            total += area_of(boxes, i)


@njit(**FAST)
def count_digits(first, end, step, keys, shift, counts):  # type: ignore[no-untyped-def]
    """Keys by a digit (P, D)."""
    part = first // step
    for i in range(first, end):
        counts[part, i64((keys[i] >> u64(shift)) & u64(DIGITS - 1))] += 1


@njit(**FAST)
def scatter_keys(first, end, step, keys, shift, starts, moved):  # type: ignore[no-untyped-def]
    """Keys in order of a digit, otherwise as they were."""
    part = first // step
    for i in range(first, end):
        digit = i64((keys[i] >> u64(shift)) & u64(DIGITS - 1))
        moved[starts[part, digit]] = keys[i]
        starts[part, digit] += 1


@njit(**FAST)
def count_tiles(first, end, step, order, boxes, tiles_x, counts):  # type: ignore[no-untyped-def]
    """Entries of each tile (P, T)."""
    part = first // step
    for k in range(first, end):
        n = order[k]
        for y in range(i64(boxes[n, 2]), i64(boxes[n, 3]) + 1):
            for x in range(i64(boxes[n, 0]), i64(boxes[n, 1]) + 1):
                counts[part, y * tiles_x + x] += 1


@njit(**FAST)
def tile_offsets(counts, offsets):  # type: ignore[no-untyped-def]
    """Entries before each tile (T + 1,); ``counts`` (P, T) becomes where each part's entries of a tile begin."""
    total = i64(0)
    for t in range(counts.shape[1]):
        offsets[t] = total
        for part in range(counts.shape[0]):
            here = counts[part, t]
            counts[part, t] = total
            total += here
    offsets[counts.shape[1]] = total


@njit(**FAST)
def fill_tiles(first, end, step, order, boxes, tiles_x, surfel_start, cursors, ids, place):  # type: ignore[no-untyped-def]
    """Entries of the tiles."""
    part = first // step
    for k in range(first, end):
        n = order[k]
        x0, x1, y0, y1 = i64(boxes[n, 0]), i64(boxes[n, 1]), i64(boxes[n, 2]), i64(boxes[n, 3])
        row = surfel_start[n]
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                tile = y * tiles_x + x
                entry = cursors[part, tile]
                cursors[part, tile] = entry + 1
                ids[entry] = n
                place[entry] = row
                row += 1
