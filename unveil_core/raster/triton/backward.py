"""Backward on the GPU: one program per tile goes from its last surfel to its first, and writes a gradient row for each.

A row is summed over the pixels in one reduction, and belongs to one surfel in one tile: there are no atomics.
"""

# mypy: ignore-errors
from __future__ import annotations

import triton
import triton.language as tl

from unveil_core.raster.triton.splat import (
    ALPHA_MAX,
    ALPHA_MIN,
    LOW_RANGE,
    PIXELS,
    SIZE,
    four_sums,
    pixels,
    sixteen_sums,
    splat,
)

__all__ = ["backward", "put_row", "sum_rows"]


@triton.jit
def put_row(
    to, dx, dy, q, r, u, v, square, is_exact, raw, iz, by_alpha, by_inv, red, green, blue, ADD: tl.constexpr
):  # fmt: skip
    """The first 16 numbers of a gradient row from the gradients by alpha (times alpha), 1 / depth and colour at each pixel."""
    h = tl.where(raw <= ALPHA_MAX, by_alpha, 0.0)
    by_intersection, by_screen = tl.where(is_exact, h, 0.0), tl.where(is_exact, 0.0, h)
    scaled = by_intersection * r
    by_nu, by_nv = -scaled * u, -scaled * v
    by_q = scaled * square + tl.where(is_exact, by_inv, 0.0) * iz
    row = sixteen_sums(
        by_nu,
        by_nu * dx,
        by_nu * dy,
        by_nv,
        by_nv * dx,
        by_nv * dy,
        by_q,
        by_q * dx,
        by_q * dy,
        h,
        red,
        green,
        blue,
        by_screen * dx,
        by_screen * dy,
        tl.where(is_exact, q, 1.0) * by_inv,
    )
    to += tl.arange(0, 16)
    if ADD:
        row += tl.load(to)
    tl.store(to, row)


@triton.jit
def backward(
    records,
    offsets,
    ids,
    place,
    turn,
    ended,
    tiles_x,
    width,
    height,
    c1,
    inv_near,
    kept,
    g_rgb,
    g_alpha,
    g_depth,
    g_median,
    g_normal,
    g_distortion,
    g_semantics,
    rows,
    touched,
    GEOMETRY: tl.constexpr,
    SEMANTICS: tl.constexpr,
    KEPT_PLANES: tl.constexpr,
    ROW: tl.constexpr,
):
    """Gradient rows of a tile's surfels, and which were written. ``g_semantics`` is (K, H, W)."""
    t = tl.load(turn + tl.program_id(0)).to(tl.int64)
    p, image, inside, px, py = pixels(t.to(tl.int32), tiles_x, width, height)
    keep = kept + t * (KEPT_PLANES * PIXELS) + p
    light, last = tl.load(keep), tl.load(keep + PIXELS)
    g_red = tl.load(g_rgb + 3 * image, inside, 0.0)
    g_green = tl.load(g_rgb + 3 * image + 1, inside, 0.0)
    g_blue = tl.load(g_rgb + 3 * image + 2, inside, 0.0)
    g_a = tl.load(g_alpha + image, inside, 0.0)
    total = tl.zeros([PIXELS], tl.float32)
    by_inv = total
    plane = tl.cast(width, tl.int64) * height
    if GEOMETRY:
        gz, gmed = tl.load(g_depth + image, inside, 0.0), tl.load(g_median + image, inside, 0.0)
        gnx = tl.load(g_normal + 3 * image, inside, 0.0)
        gny = tl.load(g_normal + 3 * image + 1, inside, 0.0)
        gnz = tl.load(g_normal + 3 * image + 2, inside, 0.0)
        gd = tl.load(g_distortion + image, inside, 0.0)
        median_rank, first_hit = tl.load(keep + 4 * PIXELS), tl.load(keep + 5 * PIXELS)
        # dL_d/dw_i = m_i^2 A + Q - 2 m_i M with the totals A, M, Q: scaled by the incoming gradient once, here.
        ga, gm = gd * (1.0 - light), gd * tl.load(keep + 2 * PIXELS)
        g_a += gd * tl.load(keep + 3 * PIXELS)
    start, count = tl.load(offsets + t), tl.load(ended + t)
    i = start + count - 1
    # As in forward, numbers are loaded one ahead.
    number, number_of_row = tl.load(ids + i, count > 0, 0), tl.load(place + i, count > 0, 0)
    for back in tl.range(0, count):
        at, row = records + number.to(tl.int64) * SIZE, number_of_row.to(tl.int64)
        i = start + (count - 2 - back)
        number, number_of_row = tl.load(ids + i, i >= start, 0), tl.load(place + i, i >= start, 0)
        rank = (count - 1 - back).to(tl.float32)
        dx, dy, iz, q, r, u, v, square, is_exact, raw, alpha, inv, in_front, depth = splat(at, px, py, inv_near)
        counts = (last >= rank) & (alpha >= ALPHA_MIN) & in_front
        if tl.max(counts.to(tl.int32), axis=0) > 0:
            alpha = tl.where(counts, alpha, 0.0)
            ra = 1.0 / (1.0 - alpha)
            light = light * ra
            w = alpha * light
            value = g_a + g_red * tl.load(at + 10) + g_green * tl.load(at + 11) + g_blue * tl.load(at + 12)
            if SEMANTICS:
                label = (tl.load(at + 17) / LOW_RANGE).to(tl.int64)
                value += tl.load(g_semantics + label * plane + image, inside, 0.0)
            to = rows + row * ROW
            if GEOMETRY:
                depth = tl.where(counts, depth, 0.0)
                m = c1 * (first_hit - inv)
                value += gz * depth + gnx * tl.load(at + 13) + gny * tl.load(at + 14) + gnz * tl.load(at + 15)
                slope = m * ga - gm
                value += m * (slope - gm)
                g_here = tl.where(counts & (median_rank == rank), gmed, 0.0)
                by_inv = (-2.0 * c1) * (w * slope) - (w * gz + g_here) * (depth * depth)
                normal = four_sums(w * gnx, w * gny, w * gnz, w * 0.0)
                tl.store(to + 16 + tl.arange(0, 4), normal)
            by_alpha = (light * value - total * ra) * alpha
            total += w * value
            put_row(
                to,
                dx,
                dy,
                q,
                r,
                u,
                v,
                square,
                is_exact,
                raw,
                iz,
                by_alpha,
                by_inv,
                w * g_red,
                w * g_green,
                w * g_blue,
                ADD=False,
            )
            tl.store(touched + row, 1)


ROWS_AT_ONCE = tl.constexpr(8)
"""Rows of a surfel that are loaded together: most surfels have fewer, and large ones wait an eighth as often."""


@triton.jit
def sum_rows(start, count_rows, rows, touched, sums, ROW: tl.constexpr, SUMS: tl.constexpr):
    """Each surfel's rows that were written, added in a fixed order: one program of one warp per surfel."""
    n = tl.program_id(0).to(tl.int64)
    r, k = tl.arange(0, ROWS_AT_ONCE)[:, None], tl.arange(0, 32)[None, :]
    total = tl.zeros([ROWS_AT_ONCE, 32], tl.float32)
    first, size = tl.load(start + n).to(tl.int64), tl.load(count_rows + n)
    for i in tl.range(0, size, ROWS_AT_ONCE):
        row = first + i + r
        written = tl.load(touched + row, i + r < size, 0) != 0
        total += tl.load(rows + row * ROW + k, written & (k < ROW), 0.0)
    k = tl.arange(0, 32)
    tl.store(sums + n * SUMS + k, tl.sum(total, axis=0), k < SUMS)
