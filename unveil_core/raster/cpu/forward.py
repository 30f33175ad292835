"""Forward: surfels blended into pixels. See ``raster.spec`` for the mathematics.

* Each surfel is held against all sixteen blocks of a tile at once, exactly: is there a point of the block within its
  ellipse or its low-pass circle? A third of the blocks within its bounding box have none.
* Then block by block: the pixels stay in registers while the surfels of the block's list pass in depth order, and the
  list is left when the last pixel has used up its light. Lists are made for ``SEGMENT`` surfels at a time, so that what
  lies behind a closed wall costs nothing.
* Which blocks a surfel touched is noted, so that backward visits only those.
* A plane that was not asked for leaves no instruction behind: a kernel is made per group of planes.
"""

# mypy: ignore-errors
from __future__ import annotations

from collections.abc import Callable

import numpy as np
from llvmlite import ir
from numba import types
from numba.cpython.unsafe.numbers import trailing_zeros

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import FAST
from unveil_core.raster import records as rec
from unveil_core.raster.cpu.block import (
    AHEAD,
    BLOCKS,
    TILE,
    Splat,
    aligned,
    expect,
    kept_planes,
    offsets_of,
    reached,
    sources,
)
from unveil_core.raster.cpu.lanes import FLOATS, lane_function, lane_type
from unveil_core.raster.cpu.tile_output import keep_tile, write_tile
from unveil_core.raster.spec import Limits

__all__ = ["forward_kernel", "template"]

f32, u64 = np.float32, np.uint64
SEGMENT = 512
FINISHED = 2.0
"""The least alpha that counts in a pixel whose light is used up: none does."""


def _planes(geometry, label_distortion):
    names = [*kept_planes(geometry), "LEAST", "RED", "GREEN", "BLUE"]
    names += ["NX", "NY", "NZ", "DEPTH", "DIST", "MEDIAN"] if geometry else []
    return names + (["LDIST"] if label_distortion else [])


def _state_type(Geometry, Labels):
    return types.UniTuple(lane_type, len(_planes(Geometry, Labels)))


@lane_function(_state_type)
def _load_state(builder, Geometry, Labels, memory, at):
    """A block's pixels from memory."""
    return tuple(memory.load(at, 16 * k) for k in range(len(_planes(Geometry, Labels))))


@lane_function(lambda Geometry, Labels: types.void)
def _store_state(builder, Geometry, Labels, memory, at, state):
    """A block's pixels to memory."""
    for k, vector in enumerate(state):
        memory.store(vector, at, 16 * k)


@lane_function(lambda G, S, L, D: types.Tuple((_state_type(G, L), types.uint64)))
def _blend(
    builder,
    Geometry,
    Semantics,
    Labels,
    Degree,
    state,
    memory,
    slot,
    records,
    at,
    block_x,
    block_y,
    rank,
    c1,
    inv_near,
    least_light,
):
    """One surfel onto one block; also its lanes that had a part (low 16 bits) and those that go on (high 16 bits)."""
    names = _planes(Geometry, Labels)
    s = dict(zip(names, state, strict=True))
    p = Splat(builder, Degree, records, at, block_x, block_y, inv_near)
    light = s["T"]
    valid = (p.alpha >= s["LEAST"]) & p.in_front
    # The surfel that would bring the light under the limit ends the pixel, and does not count itself.
    past = light * (1.0 - p.alpha)
    lasts = past >= least_light
    s["LEAST"] = valid.where(lasts.where(s["LEAST"], FINISHED), s["LEAST"])
    counts = valid & lasts
    alpha = counts.where(p.alpha, 0.0)
    w = alpha * light
    s["T"] = counts.where(past, light)
    s["LAST"] = counts.where(rank, s["LAST"])
    for name, field in (("RED", rec.RED), ("GREEN", rec.GREEN), ("BLUE", rec.BLUE)):
        s[name] += w * records.one(at, field)
    if Geometry:
        depth = p.depth()
        s["FIRST"] = (counts & (light >= 1.0)).where(p.inv, s["FIRST"])
        m = c1 * (s["FIRST"] - p.inv)
        for name, field in (("NX", rec.NX), ("NY", rec.NY), ("NZ", rec.NZ)):
            s[name] += w * records.one(at, field)
        s["DEPTH"] += w * depth
        s["DIST"] += w * (m * (m * (1.0 - light) - 2.0 * s["M1"]) + s["M2"])
        wm = w * m
        s["M1"] += wm
        s["M2"] += wm * m
        middle = counts & (light > 0.5)
        s["MEDIAN"] = middle.where(depth, s["MEDIAN"])
        s["MEDIAN_I"] = middle.where(rank, s["MEDIAN_I"])
    if Semantics:
        memory.store(memory.load(slot) + w, slot)
    if Labels:
        llight, m1, m2, first = (memory.load(slot, 16 * k) for k in (1, 2, 3, 4))
        first = (counts & (llight >= 1.0)).where(p.inv, first)
        lw = alpha * llight
        m = c1 * (first - p.inv)
        s["LDIST"] += lw * (m * (m * (1.0 - llight) - 2.0 * m1) + m2)
        wm = lw * m
        for k, value in enumerate((llight * (1.0 - alpha), m1 + wm, m2 + wm * m, first)):
            memory.store(value, slot, 16 * (k + 1))
    going = (s["LEAST"] < 1.0).bits()
    told = builder.or_(counts.bits(), builder.shl(going, ir.Constant(going.type, 16)))
    packed = ir.Constant(ir.ArrayType(FLOATS, len(names)), ir.Undefined)
    for k, name in enumerate(names):
        packed = builder.insert_value(packed, s[name].value, k)
    return packed, told


def template(label_count: int, geometry: bool, semantics: bool, label_distortion: bool, limits: Limits) -> np.ndarray:
    """A block's state before the first surfel, as flat float32."""
    names = _planes(geometry, label_distortion)
    starts = {"T": 1.0, "LAST": -1.0, "MEDIAN_I": -1.0, "LEAST": limits.alpha_min}
    slot = [0.0, 1.0, 0.0, 0.0, 0.0] if label_distortion else [0.0] * semantics
    planes = [starts.get(name, 0.0) for name in names] + slot * label_count
    return np.repeat(np.array(planes, np.float32), 16)


def forward_kernel(geometry: bool, semantics: bool, label_distortion: bool, degree: int) -> Callable[..., None]:
    """The kernel for tiles, with these switches as constants."""
    code = sources()
    planes = _planes(geometry, label_distortion)
    (F_LEAST,) = offsets_of(planes, "LEAST")
    places = offsets_of(planes, "T", "RED", "NX", "DEPTH", "DIST", "MEDIAN", "LDIST")
    state_size, slot_size = 16 * len(planes), 80 if label_distortion else 16
    kept_size = 16 * len(kept_planes(geometry))

    @njit(**FAST)
    def forward(
        tile,
        end,
        tiles_x,
        template,
        records,
        offsets,
        ids,
        width,
        height,
        c1,
        inv_near,
        least_light,
        label_count,
        rgb,
        alphas,
        depth,
        median,
        normal,
        distortion,
        labels,
        label_dist,
        kept,
        hits,
    ):
        if code < 0:
            return
        size = template.size
        memory = np.empty(BLOCKS * size + 16, f32)
        base = aligned(memory)
        lists = np.empty(BLOCKS * SEGMENT, np.int32)
        counts, met = np.empty(BLOCKS, np.int64), np.zeros(BLOCKS, np.int64)
        for t in range(tile, end):
            tx, ty = (t % tiles_x) * TILE, (t // tiles_x) * TILE
            first, last = offsets[t], offsets[t + 1]
            alive = u64(0xFFFF)
            for b in range(BLOCKS):
                met[b] = 0
                for lane in range(u64(state_size)):
                    memory[base + u64(b * size) + lane] = template[lane]
            if tx + TILE > width or ty + TILE > height:
                for b in range(BLOCKS):
                    inside = 0
                    for lane in range(16):
                        x, y = tx + b % 4 * 4 + lane % 4, ty + b // 4 * 4 + lane // 4
                        if x < width and y < height:
                            inside += 1
                        else:
                            memory[base + u64(b * size + lane) + F_LEAST] = f32(FINISHED)
                    if inside == 0:
                        alive &= ~(u64(1) << u64(b))
            for low in range(first, last, SEGMENT):
                high = min(low + SEGMENT, last)
                if alive == u64(0):
                    for i in range(low, last):
                        hits[u64(i)] = 0
                    break
                for b in range(BLOCKS):
                    counts[b] = 0
                for i in range(low, high):
                    hits[u64(i)] = 0
                    if i + AHEAD < high:
                        expect(records, u64(ids[u64(i + AHEAD)]) * u64(rec.SIZE))
                    g = u64(ids[u64(i)]) * u64(rec.SIZE)
                    word = records[g + u64(rec.LABEL_LOW)]
                    label = np.int64(word / f32(rec.LOW_RANGE))
                    blocks = reached(records, g, word - f32(rec.LOW_RANGE) * f32(label), f32(tx), f32(ty)) & alive
                    while blocks != u64(0):
                        b = trailing_zeros(blocks)
                        blocks &= blocks - u64(1)
                        if semantics and (met[b] >> label) & 1 == 0:
                            met[b] |= 1 << label
                            slot = u64(state_size + label * slot_size)
                            for lane in range(u64(slot_size)):
                                memory[base + b * u64(size) + slot + lane] = template[slot + lane]
                        lists[u64(b * u64(SEGMENT)) + u64(counts[b])] = i
                        counts[b] += 1
                for b in range(BLOCKS):
                    if counts[b] == 0:
                        continue
                    at = base + u64(b * size)
                    state = _load_state(geometry, label_distortion, memory, at)
                    block_x, block_y = f32(tx + b % 4 * 4), f32(ty + b // 4 * 4)
                    for k in range(counts[b]):
                        i = u64(lists[u64(b * SEGMENT + k)])
                        g = u64(ids[i]) * u64(rec.SIZE)
                        slot = at
                        if semantics:
                            label = np.int64(records[g + u64(rec.LABEL_LOW)] / f32(rec.LOW_RANGE))
                            slot += u64(state_size + label * slot_size)
                        state, told = _blend(
                            geometry,
                            semantics,
                            label_distortion,
                            degree,
                            state,
                            memory,
                            slot,
                            records,
                            g,
                            block_x,
                            block_y,
                            f32(np.int64(i) - first),
                            c1,
                            inv_near,
                            least_light,
                        )
                        hits[i] |= np.uint16(u64((told & u64(0xFFFF)) != u64(0)) << u64(b))
                        if told <= u64(0xFFFF):
                            alive &= ~(u64(1) << u64(b))
                            break
                    _store_state(geometry, label_distortion, memory, at, state)
            if kept.shape[0] > 0:
                keep_tile(memory, base, size, state_size, kept_size, label_count, label_distortion, met, kept[t])
            write_tile(
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
            )

    return forward
