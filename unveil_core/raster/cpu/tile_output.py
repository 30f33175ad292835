"""What becomes of a tile's memory when its surfels are blended: its planes to the images, and what backward needs of it.

A part of the kernel of :mod:`forward`.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import types

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import INLINED
from unveil_core.raster.cpu.block import BLOCK, BLOCKS, KEPT_LABEL, put, put_next
from unveil_core.raster.cpu.lanes import lane_function

__all__ = ["keep_tile", "write_tile"]

f32, u64 = np.float32, np.uint64
ZERO = f32(0)


@lane_function(lambda: types.void)
def _to_alpha(builder, memory, at):
    """Transmittance becomes alpha."""
    memory.store(1.0 - memory.load(at), at)


@njit(**INLINED)
def keep_tile(memory, base, size, state_size, kept_size, label_count, label_distortion, met, keep):
    """What backward needs of a tile."""
    stride = kept_size + (label_count * KEPT_LABEL if label_distortion else 0)
    for b in range(BLOCKS):
        at, to = base + u64(b * size), u64(b * stride)
        for lane in range(u64(kept_size)):
            keep[to + lane] = memory[at + lane]
        if label_distortion:
            for k in range(label_count):
                if (met[b] >> k) & 1:
                    target, source = to + u64(kept_size + k * KEPT_LABEL), at + u64(state_size + k * 80 + 16)
                    for lane in range(u64(KEPT_LABEL)):
                        keep[target + lane] = memory[source + lane]
        keep[u64(BLOCKS * stride + b)] = f32(met[b])


@njit(**INLINED)
def write_tile(
    memory,
    base,
    size,
    state_size,
    slot_size,
    places,
    tx,
    ty,
    width,
    height,
    label_count,
    geometry,
    semantics,
    label_distortion,
    met,
    rgb,
    alphas,
    depth,
    median,
    normal,
    distortion,
    labels,
    label_dist,
):
    """A tile's planes to the images; a block at the border pixel by pixel."""
    F_T, F_RED, F_NX, F_DEPTH, F_DIST, F_MEDIAN, F_LDIST = places
    for b in range(BLOCKS):
        x0, y0, at = tx + b % 4 * 4, ty + b // 4 * 4, base + u64(b * size)
        _to_alpha(memory, at + F_T)
        if x0 + BLOCK <= width and y0 + BLOCK <= height:
            one, step = u64(y0 * width + x0), u64(width)
            for c in range(u64(3)):
                put(memory, at + F_RED + c * u64(16), rgb, u64(3) * one + c, u64(3) * step, u64(3))
            put_next(memory, at + F_T, alphas, one, step)
            if geometry:
                put_next(memory, at + F_DEPTH, depth, one, step)
                put_next(memory, at + F_MEDIAN, median, one, step)
                for c in range(u64(3)):
                    put(memory, at + F_NX + c * u64(16), normal, u64(3) * one + c, u64(3) * step, u64(3))
                put_next(memory, at + F_DIST, distortion, one, step)
            if label_distortion:
                put_next(memory, at + F_LDIST, label_dist, one, step)
            if semantics:
                n = u64(label_count)
                for k in range(n):
                    slot = at + u64(state_size) + k * u64(slot_size)
                    if (u64(met[b]) >> k) & u64(1) == u64(0):
                        for lane in range(u64(16)):
                            memory[slot + lane] = ZERO
                    put(memory, slot, labels, n * one + k, n * step, n)
            continue
        for row in range(BLOCK):
            y = y0 + row
            if y >= height:
                continue
            for c in range(min(BLOCK, width - x0)):
                j, yy, xx = base + u64(b * size + row * BLOCK + c), u64(y), u64(x0 + c)
                rgb[yy, xx, u64(0)] = memory[F_RED + j]
                rgb[yy, xx, u64(1)] = memory[F_RED + u64(16) + j]
                rgb[yy, xx, u64(2)] = memory[F_RED + u64(32) + j]
                alphas[yy, xx] = memory[F_T + j]
                if geometry:
                    depth[yy, xx] = memory[F_DEPTH + j]
                    median[yy, xx] = memory[F_MEDIAN + j]
                    normal[yy, xx, u64(0)] = memory[F_NX + j]
                    normal[yy, xx, u64(1)] = memory[F_NX + u64(16) + j]
                    normal[yy, xx, u64(2)] = memory[F_NX + u64(32) + j]
                    distortion[yy, xx] = memory[F_DIST + j]
                if label_distortion:
                    label_dist[yy, xx] = memory[F_LDIST + j]
                if semantics:
                    for k in range(u64(label_count)):
                        here = (u64(met[b]) >> k) & u64(1) != u64(0)
                        labels[yy, xx, k] = memory[j + u64(state_size) + k * u64(slot_size)] if here else ZERO
