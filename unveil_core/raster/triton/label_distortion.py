"""The distortion within each label, on the GPU, from the same lists as the other planes.

Each surfel has one label, and a label's transmittance and moments do not see the others. So a tile's list is sorted by label
(stably, so that depth stays the order within), and a program goes through it label after label with one label's state in
registers. Backward goes through a label's run twice: once for its totals, once back. Nothing is kept per label in memory.
"""

# mypy: ignore-errors
from __future__ import annotations

import triton
import triton.language as tl

from unveil_core.raster.triton.backward import put_row
from unveil_core.raster.triton.splat import ALPHA_MIN, LOW_RANGE, PIXELS, SIZE, pixels, splat

__all__ = ["label_backward", "label_forward", "label_keys"]


@triton.jit(do_not_specialize=["total"])
def label_keys(tiles, ids, labels, offsets, ended, total, keys, LABELS: tl.constexpr, BLOCK: tl.constexpr):
    """What the entries are sorted by: tile, then label; behind them what no pixel of the tile needed.

    Args:
        tiles: tile of each entry; keys: int32, of them.
    """
    i = tl.program_id(0).to(tl.int64) * BLOCK + tl.arange(0, BLOCK)
    here = i < total
    t = tl.load(tiles + i, here, 0).to(tl.int32)
    label = tl.load(labels + tl.load(ids + i, here, 0), here, 0).to(tl.int32)
    needed = i < tl.load(offsets + t, here, 0).to(tl.int64) + tl.load(ended + t, here, 0)
    tl.store(keys + i, t * (LABELS + 1) + tl.where(needed, label, LABELS), here)


@triton.jit
def _entry(records, ids, by_label, i, start, last, px, py, inv_near):
    """The i-th entry by label: its number in the list, and its splat; the last value says which pixels it counts for."""
    j = tl.load(by_label + i)
    at = records + tl.load(ids + j).to(tl.int64) * SIZE
    dx, dy, iz, q, r, u, v, square, is_exact, raw, alpha, inv, in_front, _ = splat(at, px, py, inv_near)
    counts = (last >= (j - start).to(tl.float32)) & (alpha >= ALPHA_MIN) & in_front
    return j, dx, dy, iz, q, r, u, v, square, is_exact, raw, tl.where(counts, alpha, 0.0), inv, counts


@triton.jit
def _label_at(records, ids, by_label, i, end):
    """Label of the i-th entry by label; -1 behind the last."""
    here = i < end
    at = records + tl.load(ids + tl.load(by_label + i, here, 0), here, 0).to(tl.int64) * SIZE
    return tl.where(here, (tl.load(at + 17, here, 0.0) / LOW_RANGE).to(tl.int32), -1)


@triton.jit
def _met(light, m1, m2, first, alpha, inv, counts, c1):
    """A label's state behind a surfel, and what the surfel adds to the distortion."""
    first = tl.where(counts & (light >= 1.0), inv, first)
    w, m = alpha * light, c1 * (first - inv)
    more = w * (m * (m * (1.0 - light) - 2.0 * m1) + m2)
    return light * (1.0 - alpha), m1 + w * m, m2 + w * m * m, first, more


@triton.jit
def label_forward(
    records,
    offsets,
    ids,
    by_label,
    turn,
    ended,
    tiles_x,
    width,
    height,
    c1,
    inv_near,
    kept,
    plane,
    KEPT_PLANES: tl.constexpr,
):
    """The plane of a tile."""
    t = tl.load(turn + tl.program_id(0)).to(tl.int64)
    p, image, inside, px, py = pixels(t.to(tl.int32), tiles_x, width, height)
    last = tl.load(kept + t * (KEPT_PLANES * PIXELS) + PIXELS + p)
    zero = tl.zeros([PIXELS], tl.float32)
    light, m1, m2, first, total = zero + 1.0, zero, zero, zero, zero
    start = tl.load(offsets + t)
    end = start + tl.load(ended + t)
    label = _label_at(records, ids, by_label, start, end)
    for i in tl.range(start, end):
        _, _, _, _, _, _, _, _, _, _, _, alpha, inv, counts = _entry(
            records, ids, by_label, i, start, last, px, py, inv_near
        )
        light, m1, m2, first, more = _met(light, m1, m2, first, alpha, inv, counts, c1)
        total += more
        following = _label_at(records, ids, by_label, i + 1, end)
        if following != label:
            light, m1, m2, first = zero + 1.0, zero, zero, zero
        label = following
    tl.store(plane + image, total, inside)


@triton.jit
def label_backward(
    records,
    offsets,
    ids,
    by_label,
    place,
    turn,
    ended,
    tiles_x,
    width,
    height,
    c1,
    inv_near,
    kept,
    g_plane,
    rows,
    touched,
    KEPT_PLANES: tl.constexpr,
    ROW: tl.constexpr,
):
    """Add the plane's gradient to the rows that the backward pass of the other planes has written."""
    t = tl.load(turn + tl.program_id(0)).to(tl.int64)
    p, image, inside, px, py = pixels(t.to(tl.int32), tiles_x, width, height)
    last = tl.load(kept + t * (KEPT_PLANES * PIXELS) + PIXELS + p)
    gl = tl.load(g_plane + image, inside, 0.0)
    zero = tl.zeros([PIXELS], tl.float32)
    start = tl.load(offsets + t)
    end = start + tl.load(ended + t)
    begin = start
    while begin < end:
        light, m1, m2, first = zero + 1.0, zero, zero, zero
        label = _label_at(records, ids, by_label, begin, end)
        i, following = begin, label
        while following == label:
            _, _, _, _, _, _, _, _, _, _, _, alpha, inv, counts = _entry(
                records, ids, by_label, i, start, last, px, py, inv_near
            )
            light, m1, m2, first, _ = _met(light, m1, m2, first, alpha, inv, counts, c1)
            i += 1
            following = _label_at(records, ids, by_label, i, end)
        # dL_ds/dw_i = m_i^2 A + Q - 2 m_i M with the label's totals A, M, Q.
        ga, gm, gq, total = gl * (1.0 - light), gl * m1, gl * m2, zero
        for back in tl.range(0, i - begin):
            j, dx, dy, iz, q, r, u, v, square, is_exact, raw, alpha, inv, counts = _entry(
                records, ids, by_label, i - 1 - back, start, last, px, py, inv_near
            )
            row = tl.load(place + j).to(tl.int64)
            # Where no pixel counts, no row was written.
            if tl.load(touched + row) != 0:
                ra = 1.0 / (1.0 - alpha)
                light = light * ra
                w, m = alpha * light, c1 * (first - inv)
                slope = m * ga - gm
                value = m * (slope - gm) + gq
                by_alpha = (light * value - total * ra) * alpha
                total += w * value
                put_row(
                    rows + row * ROW,
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
                    (-2.0 * c1) * (w * slope),
                    zero,
                    zero,
                    zero,
                    ADD=True,
                )
        begin = i
