"""Backward: gradients of pixels carried to surfels. See ``raster.spec`` for the mathematics.

* A tile's surfels are taken from last to first, each over the blocks that it touched, with its sums in registers.
* Each surfel-tile intersection that touched a pixel writes its own gradient row; rows are then summed per surfel in a
  fixed order. No atomics, no per-thread buffers: results are bitwise the same for any number of threads.
"""

# mypy: ignore-errors
from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import types
from numba.cpython.unsafe.numbers import trailing_zeros

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import FAST, INLINED
from unveil_core.raster import records as rec
from unveil_core.raster.cpu.block import (
    AHEAD,
    BLOCK,
    BLOCKS,
    KEPT_LABEL,
    TILE,
    Splat,
    aligned,
    expect,
    get,
    get_next,
    kept_planes,
    offsets_of,
    sources,
)
from unveil_core.raster.cpu.lanes import Vector, add_across, lane_function, lane_type
from unveil_core.raster.spec import ALPHA_MAX

__all__ = ["backward_kernel", "row_size"]

f32, u64 = np.float32, np.uint64
ZERO = f32(0)


def _planes(geometry, semantics, label_distortion):
    names = [*kept_planes(geometry), "SUM", "G_RED", "G_GREEN", "G_BLUE", "G_ALPHA"]
    names += ["G_DEPTH", "G_MEDIAN", "G_NX", "G_NY", "G_NZ", "G_DIST", "GA"] if geometry else []
    return names + (["G_LDIST"] if label_distortion else [])


def _sum_count(geometry):
    return 19 if geometry else 15


def row_size(geometry: bool) -> int:
    """Floats of a gradient row: moments (1, dx, dy) of n_u, n_v and q; opacity; rgb; screen (2); 1/z; normal (3)."""
    return 20 if geometry else 16


def _sums_type(Geometry):
    return types.UniTuple(lane_type, _sum_count(Geometry))


@lane_function(_sums_type)
def _no_sums(builder, Geometry):
    """A surfel's sums before its first block."""
    return (Vector.of(builder, 0.0),) * _sum_count(Geometry)


@lane_function(lambda Geometry: types.void)
def _store_row(builder, Geometry, sums, rows, at):
    """The sums over the lanes to a gradient row."""
    rows.store(add_across(list(sums[:16])), at)
    if Geometry:
        rows.store_four(add_across(list(sums[16:])), at, 0, 16)


@lane_function(lambda G, S, L, D: _sums_type(G))
def _unblend(
    builder,
    Geometry,
    Semantics,
    Labels,
    Degree,
    sums,
    memory,
    start,
    slot,
    records,
    at,
    block_x,
    block_y,
    rank,
    c1,
    inv_near,
    least_alpha,
):
    """One surfel off one block: its sums with what this block adds; the block's light and sums behind, updated."""
    offset = {name: 16 * k for k, name in enumerate(_planes(Geometry, Semantics, Labels))}
    plane = lambda name: memory.load(start, offset[name])  # noqa: E731
    one = lambda k: records.one(at, k)  # noqa: E731
    p = Splat(builder, Degree, records, at, block_x, block_y, inv_near)
    counts = (plane("LAST") >= rank) & (p.alpha >= least_alpha) & p.in_front
    alpha = counts.where(p.alpha, 0.0)
    ra = 1.0 / (1.0 - alpha)
    light = plane("T") * ra
    memory.store(light, start, offset["T"])
    w, total = alpha * light, plane("SUM")
    g_rgb = [plane(name) for name in ("G_RED", "G_GREEN", "G_BLUE")]
    value = plane("G_ALPHA") + g_rgb[0] * one(rec.RED) + g_rgb[1] * one(rec.GREEN) + g_rgb[2] * one(rec.BLUE)
    if Semantics:
        value += memory.load(slot)
    if Geometry:
        depth = counts.where(p.depth(), 0.0)
        m = c1 * (plane("FIRST") - p.inv)
        ga, gm, g_depth = plane("GA"), plane("M1"), plane("G_DEPTH")
        g_normal = [plane(name) for name in ("G_NX", "G_NY", "G_NZ")]
        value += g_depth * depth
        value += g_normal[0] * one(rec.NX) + g_normal[1] * one(rec.NY) + g_normal[2] * one(rec.NZ)
        slope = m * ga - gm
        value += m * (slope - gm)
        by_m = w * slope
    by_alpha = light * value - total * ra
    memory.store(total + w * value, start, offset["SUM"])
    if Labels:
        llight, m1, m2, first, ltotal, ga = (memory.load(slot, 16 * k) for k in (1, 2, 3, 4, 5, 6))
        llight = llight * ra
        m = c1 * (first - p.inv)
        lw, slope = alpha * llight, m * ga - m1
        lvalue = m * (slope - m1) + m2
        by_alpha += llight * lvalue - ltotal * ra
        by_m += lw * slope
        memory.store(llight, slot, 16)
        memory.store(ltotal + lw * lvalue, slot, 80)
    # alpha = opacity G: d alpha = alpha d(log opacity + log G), and nothing where alpha is held at its maximum.
    h = (p.raw <= ALPHA_MAX).where(by_alpha * alpha, 0.0)
    by_intersection = p.is_exact.where(h, 0.0)
    by_screen = p.is_exact.where(0.0, h)
    scaled = by_intersection * p.r
    minus = 0.0 - scaled
    by_nu, by_nv, by_q = minus * p.u, minus * p.v, scaled * p.square
    adds = []
    if Geometry:
        g_median = (counts & plane("MEDIAN_I").equals(rank)).where(plane("G_MEDIAN"), 0.0)
        by_inv = (-2.0 * c1) * by_m - (w * g_depth + g_median) * (depth * depth)
        by_q += p.is_exact.where(by_inv, 0.0) * one(rec.IZ)
        adds = [p.is_exact.where(p.q, 1.0) * by_inv, *(w * g for g in g_normal)]
    adds = [
        by_nu,
        by_nu * p.dx,
        by_nu * p.dy,
        by_nv,
        by_nv * p.dx,
        by_nv * p.dy,
        by_q,
        by_q * p.dx,
        by_q * p.dy,
        h,
        *(w * g for g in g_rgb),
        by_screen * p.dx,
        by_screen * p.dy,
        *adds,
    ]
    return tuple(a + b for a, b in zip(sums, adds, strict=True))


@lane_function(lambda S, L: types.void)
def _scale_totals(builder, Semantics, Labels, memory, at):
    """dL_d/dw_i = m_i^2 A + Q - 2 m_i M with the totals A, M, Q: scaled by the incoming gradient once."""
    offset = {name: 16 * k for k, name in enumerate(_planes(True, Semantics, Labels))}
    plane = lambda name: memory.load(at, offset[name])  # noqa: E731
    g = plane("G_DIST")
    memory.store(g * (1.0 - plane("T")), at, offset["GA"])
    memory.store(plane("G_ALPHA") + g * plane("M2"), at, offset["G_ALPHA"])
    memory.store(plane("M1") * g, at, offset["M1"])


@lane_function(lambda: types.void)
def _read_label(builder, keep, saved, memory, gradient, slot):
    """A label's state as forward kept it, to its slot: light, two scaled totals, first hit, sum behind, scaled A."""
    g, light = memory.load(gradient), keep.load(saved)
    planes = (
        light,
        g * keep.load(saved, 16),
        g * keep.load(saved, 32),
        keep.load(saved, 48),
        Vector.of(builder, 0.0),
        g * (1.0 - light),
    )
    for k, plane in enumerate(planes):
        memory.store(plane, slot, 16 * (k + 1))


@njit(**INLINED)
def _read(
    memory,
    base,
    size,
    state_size,
    slot_size,
    kept_size,
    places,
    tx,
    ty,
    width,
    height,
    label_count,
    geometry,
    semantics,
    label_distortion,
    keep,
    g_rgb,
    g_alpha,
    g_depth,
    g_median,
    g_normal,
    g_distortion,
    g_labels,
    g_label_dist,
):
    """A tile's state as forward kept it, and the gradients of its pixels; a block at the border pixel by pixel."""
    B_SUM, G_RED, G_ALPHA, G_DEPTH, G_MEDIAN, G_NX, G_DIST, G_LDIST = places
    stride = kept_size + (label_count * KEPT_LABEL if label_distortion else 0)
    for b in range(BLOCKS):
        at, source = base + u64(b * size), u64(b * stride)
        for lane in range(u64(kept_size)):
            memory[at + lane] = keep[source + lane]
        for lane in range(u64(16)):
            memory[at + B_SUM + lane] = ZERO
        x0, y0 = tx + b % 4 * 4, ty + b // 4 * 4
        whole = x0 + BLOCK <= width and y0 + BLOCK <= height
        if whole:
            one, step = u64(y0 * width + x0), u64(width)
            for c in range(u64(3)):
                get(memory, at + G_RED + c * u64(16), g_rgb, u64(3) * one + c, u64(3) * step, u64(3))
            get_next(memory, at + G_ALPHA, g_alpha, one, step)
            if geometry:
                get_next(memory, at + G_DEPTH, g_depth, one, step)
                get_next(memory, at + G_MEDIAN, g_median, one, step)
                for c in range(u64(3)):
                    get(memory, at + G_NX + c * u64(16), g_normal, u64(3) * one + c, u64(3) * step, u64(3))
                get_next(memory, at + G_DIST, g_distortion, one, step)
            if label_distortion:
                get_next(memory, at + G_LDIST, g_label_dist, one, step)
            if semantics:
                n = u64(label_count)
                for k in range(n):
                    get(memory, at + u64(state_size) + k * u64(slot_size), g_labels, n * one + k, n * step, n)
        for lane in range(0 if whole else 16):
            x, y = tx + b % 4 * 4 + lane % 4, ty + b // 4 * 4 + lane // 4
            j, yy, xx = at + u64(lane), u64(y), u64(x)
            if x < width and y < height:
                for c in range(u64(3)):
                    memory[G_RED + c * u64(16) + j] = g_rgb[yy, xx, c]
                memory[G_ALPHA + j] = g_alpha[yy, xx]
                if geometry:
                    memory[G_DEPTH + j] = g_depth[yy, xx]
                    memory[G_MEDIAN + j] = g_median[yy, xx]
                    for c in range(u64(3)):
                        memory[G_NX + c * u64(16) + j] = g_normal[yy, xx, c]
                    memory[G_DIST + j] = g_distortion[yy, xx]
                if label_distortion:
                    memory[G_LDIST + j] = g_label_dist[yy, xx]
                if semantics:
                    for k in range(u64(label_count)):
                        memory[u64(state_size) + k * u64(slot_size) + j] = g_labels[yy, xx, k]
            else:
                for k in range((u64(state_size) - G_RED) // u64(16)):
                    memory[G_RED + k * u64(16) + j] = ZERO
                if semantics:
                    for k in range(u64(label_count)):
                        memory[u64(state_size) + k * u64(slot_size) + j] = ZERO
        if geometry:
            _scale_totals(semantics, label_distortion, memory, at)
        if label_distortion:
            met = np.int64(keep[u64(BLOCKS * stride + b)])
            for k in range(label_count):
                if (met >> k) & 1:
                    _read_label(
                        keep,
                        source + u64(kept_size + k * KEPT_LABEL),
                        memory,
                        at + G_LDIST,
                        at + u64(state_size + k * slot_size),
                    )


def backward_kernel(geometry: bool, semantics: bool, label_distortion: bool, degree: int) -> Callable[..., None]:
    """The kernel for tiles, with these switches as constants."""
    code = sources()
    planes = _planes(geometry, semantics, label_distortion)
    places = offsets_of(planes, "SUM", "G_RED", "G_ALPHA", "G_DEPTH", "G_MEDIAN", "G_NX", "G_DIST", "G_LDIST")
    state_size, slot_size = 16 * len(planes), 112 if label_distortion else 16
    kept_size, row_floats = 16 * len(kept_planes(geometry)), u64(row_size(geometry))

    @njit(**FAST)
    def backward(
        tile,
        end,
        tiles_x,
        records,
        offsets,
        ids,
        width,
        height,
        c1,
        inv_near,
        least_alpha,
        label_count,
        kept,
        hits,
        g_rgb,
        g_alpha,
        g_depth,
        g_median,
        g_normal,
        g_distortion,
        g_labels,
        g_label_dist,
        place,
        rows,
        touched,
    ):
        if code < 0:
            return
        size = state_size + (label_count * slot_size if semantics else 0)
        memory = np.empty(BLOCKS * size + 16, f32)
        base = aligned(memory)
        for t in range(tile, end):
            tx, ty = (t % tiles_x) * TILE, (t // tiles_x) * TILE
            first, count = offsets[t], offsets[t + 1] - offsets[t]
            _read(
                memory,
                base,
                size,
                state_size,
                slot_size,
                kept_size,
                places,
                tx,
                ty,
                width,
                height,
                label_count,
                geometry,
                semantics,
                label_distortion,
                kept[t],
                g_rgb,
                g_alpha,
                g_depth,
                g_median,
                g_normal,
                g_distortion,
                g_labels,
                g_label_dist,
            )
            for back in range(count - 1, -1, -1):
                i = u64(first + back)
                if back >= AHEAD:
                    expect(records, u64(ids[i - u64(AHEAD)]) * u64(rec.SIZE))
                row, blocks = u64(place[i]), u64(hits[i])
                touched[row] = blocks != u64(0)
                if blocks == u64(0):
                    continue
                g = u64(ids[i]) * u64(rec.SIZE)
                label_slot = 0
                if semantics:
                    label_slot = state_size + np.int64(records[g + u64(rec.LABEL_LOW)] / f32(rec.LOW_RANGE)) * slot_size
                sums = _no_sums(geometry)
                while blocks != u64(0):
                    b = np.int64(trailing_zeros(blocks))
                    blocks &= blocks - u64(1)
                    at = base + u64(b * size)
                    sums = _unblend(
                        geometry,
                        semantics,
                        label_distortion,
                        degree,
                        sums,
                        memory,
                        at,
                        at + u64(label_slot),
                        records,
                        g,
                        f32(tx + b % 4 * 4),
                        f32(ty + b // 4 * 4),
                        f32(back),
                        c1,
                        inv_near,
                        least_alpha,
                    )
                _store_row(geometry, sums, rows, row * row_floats)

    return backward
