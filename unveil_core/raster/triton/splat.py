"""What the tile kernels share: a surfel at the pixels of a tile, and sums over a tile. See ``raster.spec``."""

# mypy: ignore-errors
from __future__ import annotations

import triton
import triton.language as tl

from unveil_core.raster import records as rec
from unveil_core.raster import spec
from unveil_core.raster.passes import TILE as TILE_SIDE

__all__ = [
    "ALPHA_MAX",
    "ALPHA_MIN",
    "LOW_RANGE",
    "PIXELS",
    "SIZE",
    "T_MIN",
    "four_sums",
    "pixels",
    "sixteen_sums",
    "splat",
]

ALPHA_MIN, ALPHA_MAX = tl.constexpr(spec.ALPHA_MIN), tl.constexpr(spec.ALPHA_MAX)
T_MIN = tl.constexpr(spec.TRANSMITTANCE_MIN)
Q_MIN = tl.constexpr(1e-10)
"""A ray in the disc's own plane has q = 0. Held away from it, masked pixels stay finite, and zero times them is zero."""
SIZE, LOW_RANGE = tl.constexpr(rec.SIZE), tl.constexpr(rec.LOW_RANGE)
REST_UNIT, REST_BASE = tl.constexpr(rec.REST_UNIT), tl.constexpr(rec.REST_BASE)
TILE = tl.constexpr(TILE_SIDE)
PIXELS = tl.constexpr(TILE_SIDE * TILE_SIDE)


@triton.jit
def splat(at, px, py, inv_near):
    """A surfel at the pixels of a tile: see ``cpu.block.Splat``."""
    # The first difference is exact, and what rounding took from the mean comes off it.
    rest = tl.load(at + 23)
    rest_x = tl.floor(rest / REST_BASE + 0.5)
    dx = (px - tl.load(at)) - rest_x * REST_UNIT
    dy = (py - tl.load(at + 1)) - (rest - rest_x * REST_BASE) * REST_UNIT
    iz = tl.load(at + 2)
    nu = tl.load(at + 3) * dx + tl.load(at + 4) * dy
    nv = tl.load(at + 5) * dx + tl.load(at + 6) * dy
    q = 1.0 + tl.load(at + 7) * dx + tl.load(at + 8) * dy
    q = tl.where(tl.abs(q) > Q_MIN, q, Q_MIN)
    r = 1.0 / q
    u, v = nu * r, nv * r
    exact, screen = u * u + v * v, 2.0 * (dx * dx + dy * dy)
    is_exact = exact <= screen
    square = tl.minimum(exact, screen)
    raw = tl.exp(-0.5 * square) * tl.load(at + 9)
    inv = tl.where(is_exact, q, 1.0) * iz
    in_front = (inv > 0.0) & (inv <= inv_near)
    depth = tl.where(is_exact, r, 1.0) * tl.load(at + 16)
    return dx, dy, iz, q, r, u, v, square, is_exact, raw, tl.minimum(raw, ALPHA_MAX), inv, in_front, depth


@triton.jit
def pixels(t, tiles_x, width, height):
    """Of a tile's pixels: number in the tile, number in the image, whether they are in it, centre."""
    p = tl.arange(0, PIXELS)
    x, y = (t % tiles_x) * TILE + p % TILE, (t // tiles_x) * TILE + p // TILE
    image = y.to(tl.int64) * width + x
    return p, image, (x < width) & (y < height), x.to(tl.float32) + 0.5, y.to(tl.float32) + 0.5


@triton.jit
def four_sums(a, b, c, d):
    """(4,) sums over the pixels, in one reduction."""
    return tl.sum(tl.reshape(tl.join(tl.join(a, c), tl.join(b, d)), (PIXELS, 4)), axis=0)


@triton.jit
def sixteen_sums(v0, v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13, v14, v15):
    """(16,) sums over the pixels, in one reduction: a barrier for sixteen, not for each."""
    even = tl.join(tl.join(tl.join(v0, v8), tl.join(v4, v12)), tl.join(tl.join(v2, v10), tl.join(v6, v14)))
    odd = tl.join(tl.join(tl.join(v1, v9), tl.join(v5, v13)), tl.join(tl.join(v3, v11), tl.join(v7, v15)))
    return tl.sum(tl.reshape(tl.join(even, odd), (PIXELS, 16)), axis=0)
