"""The tile kernels on the GPU: one program per tile of 16x16 pixels. See ``raster.spec`` for the mathematics.

The arrays are those of the CPU backend: the same records, tile lists and gradient rows, so that each can be compared.
What a tile keeps per label lies in memory (``slots``), as a program cannot index its registers.
"""

# mypy: ignore-errors
from __future__ import annotations

import triton
import triton.language as tl

from unveil_core.raster import records as rec
from unveil_core.raster import spec

__all__ = ["KEPT", "PIXELS", "SLOT", "backward", "forward"]

ALPHA_MIN, ALPHA_MAX = tl.constexpr(spec.ALPHA_MIN), tl.constexpr(spec.ALPHA_MAX)
T_MIN = tl.constexpr(spec.TRANSMITTANCE_MIN)
Q_MIN = tl.constexpr(1e-10)
SIZE, LOW_RANGE = tl.constexpr(rec.SIZE), tl.constexpr(rec.LOW_RANGE)
REST_UNIT, REST_BASE = tl.constexpr(rec.REST_UNIT), tl.constexpr(rec.REST_BASE)
TILE = tl.constexpr(16)
PIXELS = tl.constexpr(256)
KEPT = tl.constexpr(6)
"""Planes that a tile keeps: transmittance, last rank, two moments, the median's rank, first hit."""
SLOT = tl.constexpr(5)
"""Planes that a tile keeps per label: semantics, transmittance, two moments, first hit."""


@triton.jit
def _splat(at, px, py, inv_near):
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
def _pixels(t, tiles_x, width, height):
    p = tl.arange(0, PIXELS)
    x, y = (t % tiles_x) * TILE + p % TILE, (t // tiles_x) * TILE + p // TILE
    return p, y * width + x, (x < width) & (y < height), x.to(tl.float32) + 0.5, y.to(tl.float32) + 0.5


@triton.jit
def forward(
    records,
    offsets,
    ids,
    tiles_x,
    width,
    height,
    c1,
    inv_near,
    label_count,
    rgb,
    alphas,
    depths,
    medians,
    normals,
    distortion,
    semantics,
    label_distortion,
    kept,
    slots,
    GEOMETRY: tl.constexpr,
    SEMANTICS: tl.constexpr,
    LABELS: tl.constexpr,
):
    """Blend a tile's surfels in depth order."""
    t = tl.program_id(0)
    p, image, inside, px, py = _pixels(t, tiles_x, width, height)
    zero = tl.zeros([PIXELS], tl.float32)
    light, last, live = zero + 1.0, zero - 1.0, inside
    red, green, blue = zero, zero, zero
    nx, ny, nz, depth_sum, dist, m1, m2, first_hit, median, median_rank = (
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero,
        zero - 1.0,
    )
    label_dist = zero
    start, end = tl.load(offsets + t), tl.load(offsets + t + 1)
    i, going = start, tl.max(live.to(tl.int32), axis=0)
    while (i < end) & (going > 0):
        at = records + tl.load(ids + i).to(tl.int64) * SIZE
        rank = (i - start).to(tl.float32)
        _, _, _, _, _, _, _, _, _, _, alpha, inv, in_front, depth = _splat(at, px, py, inv_near)
        valid = live & (alpha >= ALPHA_MIN) & in_front
        # The surfel that would bring the light under the limit ends the pixel, and does not count itself.
        past = light * (1.0 - alpha)
        counts = valid & (past >= T_MIN)
        live = live & ((valid == 0) | (past >= T_MIN))
        going = tl.max(live.to(tl.int32), axis=0)
        if tl.max(counts.to(tl.int32), axis=0) > 0:
            alpha = tl.where(counts, alpha, 0.0)
            w = alpha * light
            red += w * tl.load(at + 10)
            green += w * tl.load(at + 11)
            blue += w * tl.load(at + 12)
            last = tl.where(counts, rank, last)
            if GEOMETRY:
                first_hit = tl.where(counts & (light >= 1.0), inv, first_hit)
                m = c1 * (first_hit - inv)
                nx += w * tl.load(at + 13)
                ny += w * tl.load(at + 14)
                nz += w * tl.load(at + 15)
                depth_sum += w * depth
                dist += w * (m * (m * (1.0 - light) - 2.0 * m1) + m2)
                m1 += w * m
                m2 += w * m * m
                middle = counts & (light > 0.5)
                median = tl.where(middle, depth, median)
                median_rank = tl.where(middle, rank, median_rank)
            if SEMANTICS:
                label = (tl.load(at + 17) / LOW_RANGE).to(tl.int64)
                slot = slots + ((t * label_count + label) * SLOT) * PIXELS + p
                tl.store(slot, tl.load(slot) + w)
                if LABELS:
                    llight, lm1, lm2 = tl.load(slot + PIXELS), tl.load(slot + 2 * PIXELS), tl.load(slot + 3 * PIXELS)
                    lfirst = tl.where(counts & (llight >= 1.0), inv, tl.load(slot + 4 * PIXELS))
                    lw = alpha * llight
                    m = c1 * (lfirst - inv)
                    label_dist += lw * (m * (m * (1.0 - llight) - 2.0 * lm1) + lm2)
                    tl.store(slot + PIXELS, llight * (1.0 - alpha))
                    tl.store(slot + 2 * PIXELS, lm1 + lw * m)
                    tl.store(slot + 3 * PIXELS, lm2 + lw * m * m)
                    tl.store(slot + 4 * PIXELS, lfirst)
                # The next surfel may have the same label: what was written must be there for every thread.
                tl.debug_barrier()
            light = tl.where(counts, past, light)
        i += 1
    tl.store(rgb + 3 * image, red, inside)
    tl.store(rgb + 3 * image + 1, green, inside)
    tl.store(rgb + 3 * image + 2, blue, inside)
    tl.store(alphas + image, 1.0 - light, inside)
    keep = kept + t * KEPT * PIXELS + p
    tl.store(keep, light)
    tl.store(keep + PIXELS, last)
    if GEOMETRY:
        tl.store(depths + image, depth_sum, inside)
        tl.store(medians + image, median, inside)
        tl.store(normals + 3 * image, nx, inside)
        tl.store(normals + 3 * image + 1, ny, inside)
        tl.store(normals + 3 * image + 2, nz, inside)
        tl.store(distortion + image, dist, inside)
        tl.store(keep + 2 * PIXELS, m1)
        tl.store(keep + 3 * PIXELS, m2)
        tl.store(keep + 4 * PIXELS, median_rank)
        tl.store(keep + 5 * PIXELS, first_hit)
    if LABELS:
        tl.store(label_distortion + image, label_dist, inside)
    if SEMANTICS:
        for k in range(0, label_count):
            value = tl.load(slots + ((t * label_count + k) * SLOT) * PIXELS + p)
            tl.store(semantics + image * label_count + k, value, inside)


@triton.jit
def backward(
    records,
    offsets,
    ids,
    place,
    tiles_x,
    width,
    height,
    c1,
    inv_near,
    label_count,
    kept,
    slots,
    behind,
    g_rgb,
    g_alpha,
    g_depth,
    g_median,
    g_normal,
    g_distortion,
    g_semantics,
    g_label_distortion,
    rows,
    touched,
    GEOMETRY: tl.constexpr,
    SEMANTICS: tl.constexpr,
    LABELS: tl.constexpr,
    ROW: tl.constexpr,
):
    """Gradient rows of a tile's surfels, from the last to the first.

    ``slots`` is as forward left it, and its transmittances are spent; ``behind`` (tiles, K, pixels) is zero, and
    becomes each label's sum behind.
    """
    t = tl.program_id(0)
    p, image, inside, px, py = _pixels(t, tiles_x, width, height)
    keep = kept + t * KEPT * PIXELS + p
    light, last = tl.load(keep), tl.load(keep + PIXELS)
    g_red = tl.load(g_rgb + 3 * image, inside, 0.0)
    g_green = tl.load(g_rgb + 3 * image + 1, inside, 0.0)
    g_blue = tl.load(g_rgb + 3 * image + 2, inside, 0.0)
    g_a = tl.load(g_alpha + image, inside, 0.0)
    total = tl.zeros([PIXELS], tl.float32)
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
    if LABELS:
        gl = tl.load(g_label_distortion + image, inside, 0.0)
    start = tl.load(offsets + t)
    i = start + tl.max(last, axis=0).to(tl.int64)
    while i >= start:
        at = records + tl.load(ids + i).to(tl.int64) * SIZE
        rank = (i - start).to(tl.float32)
        dx, dy, iz, q, r, u, v, square, is_exact, raw, alpha, inv, in_front, depth = _splat(at, px, py, inv_near)
        counts = (last >= rank) & (alpha >= ALPHA_MIN) & in_front
        row = tl.load(place + i).to(tl.int64)
        some = tl.max(counts.to(tl.int32), axis=0)
        if some > 0:
            alpha = tl.where(counts, alpha, 0.0)
            ra = 1.0 / (1.0 - alpha)
            light = light * ra
            w = alpha * light
            value = g_a + g_red * tl.load(at + 10) + g_green * tl.load(at + 11) + g_blue * tl.load(at + 12)
            if SEMANTICS:
                label = (tl.load(at + 17) / LOW_RANGE).to(tl.int64)
                value += tl.load(g_semantics + image * label_count + label, inside, 0.0)
            if GEOMETRY:
                depth = tl.where(counts, depth, 0.0)
                m = c1 * (first_hit - inv)
                value += gz * depth + gnx * tl.load(at + 13) + gny * tl.load(at + 14) + gnz * tl.load(at + 15)
                slope = m * ga - gm
                value += m * (slope - gm)
                by_m = w * slope
            by_alpha = light * value - total * ra
            total += w * value
            if LABELS:
                slot = slots + ((t * label_count + label) * SLOT) * PIXELS + p
                sum_behind = behind + (t * label_count + label) * PIXELS + p
                # The label's totals are those of the whole list; only its transmittance goes back step by step.
                whole_light = tl.load(slot)
                lga, lgm = gl * (1.0 - whole_light), gl * tl.load(slot + 2 * PIXELS)
                llight, ltotal = tl.load(slot + PIXELS) * ra, tl.load(sum_behind)
                m = c1 * (tl.load(slot + 4 * PIXELS) - inv)
                lw, slope = alpha * llight, m * lga - lgm
                lvalue = m * (slope - lgm) + gl * tl.load(slot + 3 * PIXELS)
                by_alpha += llight * lvalue - ltotal * ra
                by_m += lw * slope
                tl.store(slot + PIXELS, llight)
                tl.store(sum_behind, ltotal + lw * lvalue)
                tl.debug_barrier()
            h = tl.where(raw <= ALPHA_MAX, by_alpha * alpha, 0.0)
            by_intersection, by_screen = tl.where(is_exact, h, 0.0), tl.where(is_exact, 0.0, h)
            scaled = by_intersection * r
            by_nu, by_nv, by_q = -scaled * u, -scaled * v, scaled * square
            to = rows + row * ROW
            if GEOMETRY:
                g_here = tl.where(counts & (median_rank == rank), gmed, 0.0)
                by_inv = (-2.0 * c1) * by_m - (w * gz + g_here) * (depth * depth)
                by_q += tl.where(is_exact, by_inv, 0.0) * iz
                tl.store(to + 15, tl.sum(tl.where(is_exact, q, 1.0) * by_inv, axis=0))
                tl.store(to + 16, tl.sum(w * gnx, axis=0))
                tl.store(to + 17, tl.sum(w * gny, axis=0))
                tl.store(to + 18, tl.sum(w * gnz, axis=0))
            tl.store(to, tl.sum(by_nu, axis=0))
            tl.store(to + 1, tl.sum(by_nu * dx, axis=0))
            tl.store(to + 2, tl.sum(by_nu * dy, axis=0))
            tl.store(to + 3, tl.sum(by_nv, axis=0))
            tl.store(to + 4, tl.sum(by_nv * dx, axis=0))
            tl.store(to + 5, tl.sum(by_nv * dy, axis=0))
            tl.store(to + 6, tl.sum(by_q, axis=0))
            tl.store(to + 7, tl.sum(by_q * dx, axis=0))
            tl.store(to + 8, tl.sum(by_q * dy, axis=0))
            tl.store(to + 9, tl.sum(h, axis=0))
            tl.store(to + 10, tl.sum(w * g_red, axis=0))
            tl.store(to + 11, tl.sum(w * g_green, axis=0))
            tl.store(to + 12, tl.sum(w * g_blue, axis=0))
            tl.store(to + 13, tl.sum(by_screen * dx, axis=0))
            tl.store(to + 14, tl.sum(by_screen * dy, axis=0))
            tl.store(touched + row, 1)
        i -= 1
