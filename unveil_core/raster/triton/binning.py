"""Tile lists on the GPU: each surfel is listed in the tiles that it reaches, not in all of its bounding box.

Reach is found row of tiles by row, where an ellipse or a circle covers an interval. Two kernels compute it, one to count and
one to list; they must agree to the last bit, so both are compiled without fused multiply-adds.
"""

# mypy: ignore-errors
from __future__ import annotations

from dataclasses import dataclass

import torch
import triton
import triton.language as tl
from torch import Tensor

from unveil_core.raster import records as rec
from unveil_core.raster.passes import TILE as TILE_SIDE
from unveil_core.raster.triton.memory import SHORT_KEYS

__all__ = ["Lists", "bin_surfels", "longest_first"]

SIZE, LOW_RANGE = tl.constexpr(rec.SIZE), tl.constexpr(rec.LOW_RANGE)
TILE = tl.constexpr(float(TILE_SIDE))
MARGIN, RELATIVE = tl.constexpr(0.01), tl.constexpr(1e-6)
"""Pixels, and of the lean, by which an interval is widened: a needle's ends are differences of large numbers in float32."""
BLOCK = 32
"""Surfels of a program: one warp, so that none waits for a large surfel of another."""


@dataclass(eq=False)
class Lists:
    """Surfels by tile.

    Attributes:
        start, count: (N,) int32, where the gradient rows of a surfel begin, and how many tiles it reaches; rows lie in
            order of depth.
        offsets: (T + 1,) int32, entries before each tile, row after row of tiles.
        tiles, ids, place: (E,) tile (int16 or int32), surfel and gradient row (int32) of each entry, in order of depth in
            a tile.
        turn: (T,) int32, tiles by the length of their lists, the longest first.
    """

    start: Tensor
    count: Tensor
    offsets: Tensor
    tiles: Tensor
    ids: Tensor
    place: Tensor
    turn: Tensor


@triton.jit
def _shape(records, boxes, n, mask):
    """What a surfel can reach, and its box of tiles; the box of one that is not to be seen is empty."""
    at = records + n * SIZE
    cx, cy = tl.load(at, mask, 0.0), tl.load(at + 1, mask, 0.0)
    low = tl.load(at + 17, mask, 0.0)
    low = low - tl.floor(low / LOW_RANGE) * LOW_RANGE
    ex, ey = tl.load(at + 18, mask, 0.0), tl.load(at + 19, mask, 0.0)
    e0, e1, e2 = tl.load(at + 20, mask, 1.0), tl.load(at + 21, mask, 0.0), tl.load(at + 22, mask, 1.0)
    x0, x1 = tl.load(boxes + 4 * n, mask, 0).to(tl.int32), tl.load(boxes + 4 * n + 1, mask, -1).to(tl.int32)
    y0, y1 = tl.load(boxes + 4 * n + 2, mask, 0).to(tl.int32), tl.load(boxes + 4 * n + 3, mask, -1).to(tl.int32)
    return cx, cy, low, ex, ey, e0, e1, e2, x0, x1, y0, y1


@triton.jit
def _interval(y, cx, cy, low, ex, ey, e0, e1, e2, x0, x1, y1):
    """First and last column of tiles that are reached in a row of tiles; the last is before the first where none is."""
    above = y.to(tl.float32) * TILE + 0.5
    below = above + (TILE - 1.0)
    # The ellipse's part between the row's first and last pixel centres: its sides are concave, so each is farthest out at
    # the point nearest to where the whole ellipse's is.
    reach = tl.div_rn(1.0 + 0.0 * e2, e2)
    top, bottom = tl.maximum(above - ey, -reach), tl.minimum(below - ey, reach)
    met = top <= bottom
    turn = tl.div_rn(tl.div_rn(e1, tl.sqrt_rn(e1 * e1 + e2 * e2)), e2)
    right = tl.minimum(tl.maximum(-turn, top), bottom)
    left = tl.minimum(tl.maximum(turn, top), bottom)
    s, t = e2 * right, e2 * left
    lean_right, lean_left = tl.div_rn(e1 * right, e0), tl.div_rn(e1 * left, e0)
    high = tl.div_rn(tl.sqrt_rn(tl.maximum(1.0 - s * s, 0.0)), e0) - lean_right + RELATIVE * tl.abs(lean_right)
    least = -tl.div_rn(tl.sqrt_rn(tl.maximum(1.0 - t * t, 0.0)), e0) - lean_left - RELATIVE * tl.abs(lean_left)
    high, least = tl.where(met, ex + high, -1e30), tl.where(met, ex + least, 1e30)
    # The low-pass filter's circle about the projected mean.
    away = tl.minimum(tl.maximum(0.0 * cy, above - cy), below - cy)
    inside = low - away * away
    half = tl.sqrt_rn(tl.maximum(inside, 0.0))
    high = tl.maximum(high, tl.where(inside >= 0.0, cx + half, -1e30)) + MARGIN
    least = tl.minimum(least, tl.where(inside >= 0.0, cx - half, 1e30)) - MARGIN
    # Within the box before it becomes an integer.
    first = tl.ceil(tl.div_rn(least - (TILE - 0.5), 0.0 * least + TILE))
    last = tl.floor(tl.div_rn(high - 0.5, 0.0 * high + TILE))
    first = tl.minimum(tl.maximum(first, x0.to(tl.float32)), x1.to(tl.float32) + 1.0).to(tl.int32)
    last = tl.minimum(tl.maximum(last, x0.to(tl.float32) - 1.0), x1.to(tl.float32)).to(tl.int32)
    return first, tl.where(y <= y1, last, first - 1)


@triton.jit(do_not_specialize=["surfels"])
def count_tiles(records, boxes, visible, surfels, count_rows, BLOCK: tl.constexpr):
    """How many tiles each surfel reaches."""
    n = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = n < surfels
    seen = here & (tl.load(visible + n, here, 0) != 0)
    cx, cy, low, ex, ey, e0, e1, e2, x0, x1, y0, y1 = _shape(records, boxes, n, seen)
    total = tl.zeros([BLOCK], tl.int32)
    for k in tl.range(0, tl.max(y1 - y0, axis=0) + 1):
        first, last = _interval(y0 + k, cx, cy, low, ex, ey, e0, e1, e2, x0, x1, y1)
        total += tl.maximum(last - first + 1, 0)
    tl.store(count_rows + n, total, here)


@triton.jit(do_not_specialize=["surfels"])
def list_tiles(records, boxes, start, count_rows, surfels, tiles_x, tiles, owners, BLOCK: tl.constexpr):
    """The tiles that each surfel reaches, surfel by surfel from where its rows begin."""
    n = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = n < surfels
    some = here & (tl.load(count_rows + n, here, 0) > 0)
    cx, cy, low, ex, ey, e0, e1, e2, x0, x1, y0, y1 = _shape(records, boxes, n, some)
    at = tl.load(start + n, some, 0).to(tl.int64)
    for k in tl.range(0, tl.max(y1 - y0, axis=0) + 1):
        y = y0 + k
        first, last = _interval(y, cx, cy, low, ex, ey, e0, e1, e2, x0, x1, y1)
        width = tl.where(some, tl.maximum(last - first + 1, 0), 0)
        for c in tl.range(0, tl.max(width, axis=0)):
            tl.store(tiles + at + c, (y * tiles_x + first + c).to(tiles.dtype.element_ty), c < width)
            tl.store(owners + at + c, n.to(tl.int32), c < width)
        at += width


def bin_surfels(records: Tensor, boxes: Tensor, depths: Tensor, visible: Tensor, tiles_x: int, tiles_y: int) -> Lists:
    """List the visible surfels of each tile by depth, ties by index.

    The one place of a pass where the host waits for the GPU: it must know how many entries there are to make room.

    Args:
        records: (N, 24) see ``raster.records``. boxes: (N, 4) int16, first and last column and row of tiles. depths: (N,),
            infinite where not visible. visible: (N,) uint8.
    Raises:
        ValueError: more entries than 32 bits count.
    """
    device, surfels, tile_count = boxes.device, len(boxes), tiles_x * tiles_y
    count = torch.empty(surfels, dtype=torch.int32, device=device)
    blocks = (-(-surfels // BLOCK),)
    if surfels:
        count_tiles[blocks](records, boxes, visible, surfels, count, BLOCK=BLOCK, num_warps=1, enable_fp_fusion=False)
    # Ties by index: the sort is stable.
    order = torch.sort(depths, stable=True).indices
    behind = torch.cumsum(count[order], 0)
    total = int(behind[-1]) if surfels else 0
    if total > torch.iinfo(torch.int32).max:
        raise ValueError(
            f"{total} surfel-tile intersections in one view; the surfels are too large for this image size"
        )
    start = torch.empty_like(count)
    start[order] = (behind - count[order]).to(torch.int32)
    del order, behind
    kind = torch.int16 if tile_count < SHORT_KEYS else torch.int32
    tiles = torch.empty(total, dtype=kind, device=device)
    owners = torch.empty(total, dtype=torch.int32, device=device)
    if total:
        list_tiles[blocks](
            records,
            boxes,
            start,
            count,
            surfels,
            tiles_x,
            tiles,
            owners,
            BLOCK=BLOCK,
            num_warps=1,
            enable_fp_fusion=False,
        )
    tiles, by_tile = torch.sort(tiles, stable=True)
    offsets = torch.searchsorted(tiles, torch.arange(tile_count + 1, dtype=kind, device=device), out_int32=True)
    return Lists(
        start,
        count,
        offsets,
        tiles,
        owners[by_tile],
        by_tile.to(torch.int32),
        longest_first(offsets[1:] - offsets[:-1]),
    )


def longest_first(lengths: Tensor) -> Tensor:
    """(T,) int32 tiles by length, ties by number: programs start in this order, and a long one that starts last is waited for."""
    return torch.sort(lengths, descending=True, stable=True).indices.to(torch.int32)
