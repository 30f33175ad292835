"""Forward on the GPU: one program per tile of 16x16 pixels blends its surfels in depth order.

The arithmetic is that of ``cpu.forward``, except the label distortion, which ``label_distortion`` makes from the same lists.
"""

# mypy: ignore-errors
from __future__ import annotations

import triton
import triton.language as tl

from unveil_core.raster.triton.splat import ALPHA_MIN, LOW_RANGE, PIXELS, SIZE, T_MIN, pixels, splat

__all__ = ["VOTE", "forward"]

VOTE = tl.constexpr(8)
"""Surfels between two votes on whether any pixel still takes light. A vote is a barrier; a tile that is finished walks 3.5
surfels too far on average, and tiles hold hundreds."""


@triton.jit
def _no_labels(COUNT: tl.constexpr):
    sums = ()
    for _ in tl.static_range(COUNT):
        sums = sums + (tl.zeros([PIXELS], tl.float32),)
    return sums


@triton.jit
def _add_to_label(sums, label, w, COUNT: tl.constexpr):
    """One sum in registers per label: the label is the same for the whole tile, so this is a branch without divergence."""
    added = ()
    for k in tl.static_range(COUNT):
        added = added + (tl.where(label == k, sums[k] + w, sums[k]),)
    return added


@triton.jit
def forward(
    records,
    offsets,
    ids,
    turn,
    tiles_x,
    width,
    height,
    c1,
    inv_near,
    rgb,
    alphas,
    depths,
    medians,
    normals,
    distortion,
    semantics,
    kept,
    ended,
    GEOMETRY: tl.constexpr,
    LABELS: tl.constexpr,
    KEEP: tl.constexpr,
    KEPT_PLANES: tl.constexpr,
):
    """Planes of a tile; ``semantics`` is (K, H, W), where neighbours in memory are neighbours in the image.

    Args:
        kept: (T, 2 or 6, 256) transmittance and last rank; with geometry two moments, the median's rank and the first hit.
        turn: tile of each program, the longest lists first. ended: entries of a tile's list that any pixel needed.
        LABELS: how many labels to sum, 0 without semantics. KEEP: whether a backward pass or the label distortion follows.
    """
    t = tl.load(turn + tl.program_id(0)).to(tl.int64)
    p, image, inside, px, py = pixels(t.to(tl.int32), tiles_x, width, height)
    zero = tl.zeros([PIXELS], tl.float32)
    light, last, live = zero + 1.0, zero - 1.0, inside
    red, green, blue = zero, zero, zero
    nx, ny, nz, depth_sum, dist, m1, m2, first_hit, median = zero, zero, zero, zero, zero, zero, zero, zero, zero
    median_rank = zero - 1.0
    sums = _no_labels(LABELS)
    start, end = tl.load(offsets + t), tl.load(offsets + t + 1)
    # Each surfel's number is loaded while the one before it is worked on: record after number would be two waits in a row.
    i, going, upcoming = start, 1, tl.load(ids + start, start < end, 0)
    while (i < end) & (going > 0):
        stop = tl.minimum(i + VOTE, end)
        for j in tl.range(i, stop):
            at = records + upcoming.to(tl.int64) * SIZE
            upcoming = tl.load(ids + j + 1, j + 1 < end, 0)
            rank = (j - start).to(tl.float32)
            _, _, _, _, _, _, _, _, _, _, alpha, inv, in_front, depth = splat(at, px, py, inv_near)
            valid = live & (alpha >= ALPHA_MIN) & in_front
            # The surfel that would bring the light under the limit ends the pixel, and does not count itself.
            past = light * (1.0 - alpha)
            counts = valid & (past >= T_MIN)
            live = live & ((valid == 0) | (past >= T_MIN))
            w = tl.where(counts, alpha, 0.0) * light
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
            if LABELS > 0:
                sums = _add_to_label(sums, (tl.load(at + 17) / LOW_RANGE).to(tl.int32), w, LABELS)
            light = tl.where(counts, past, light)
        i = stop
        going = tl.max(live.to(tl.int32), axis=0)
    # Once more, from memory, so that no register holds through the loop what only the stores need.
    t = tl.load(turn + tl.program_id(0)).to(tl.int64)
    p, image, inside, _, _ = pixels(t.to(tl.int32), tiles_x, width, height)
    tl.store(rgb + 3 * image, red, inside)
    tl.store(rgb + 3 * image + 1, green, inside)
    tl.store(rgb + 3 * image + 2, blue, inside)
    tl.store(alphas + image, 1.0 - light, inside)
    if GEOMETRY:
        tl.store(depths + image, depth_sum, inside)
        tl.store(medians + image, median, inside)
        tl.store(normals + 3 * image, nx, inside)
        tl.store(normals + 3 * image + 1, ny, inside)
        tl.store(normals + 3 * image + 2, nz, inside)
        tl.store(distortion + image, dist, inside)
    if LABELS > 0:
        plane = tl.cast(width, tl.int64) * height
        for k in tl.static_range(LABELS):
            tl.store(semantics + k * plane + image, sums[k], inside)
    if KEEP:
        keep = kept + t * (KEPT_PLANES * PIXELS) + p
        tl.store(keep, light)
        tl.store(keep + PIXELS, last)
        tl.store(ended + t, tl.max(last, axis=0).to(tl.int32) + 1)
        if GEOMETRY:
            tl.store(keep + 2 * PIXELS, m1)
            tl.store(keep + 3 * PIXELS, m2)
            tl.store(keep + 4 * PIXELS, median_rank)
            tl.store(keep + 5 * PIXELS, first_hit)
