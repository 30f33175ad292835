"""The tile kernels: surfels blended into pixels, and the way back. See ``raster.spec`` for the mathematics.

A tile is 16x16 pixels in 4x4 blocks of 16 pixels; a block is one :mod:`lanes` vector. What makes it fast:

* Each surfel is held against all sixteen blocks of a tile at once, exactly: is there a point of the block within its
  ellipse or its low-pass circle? A third of the blocks within its bounding box have none.
* Forward goes block by block: its pixels stay in registers while the surfels of its list pass in depth order, and the
  list is left when the last pixel has used up its light. The lists are made for ``SEGMENT`` surfels at a time, so that
  what lies behind a closed wall costs nothing.
* Forward notes which blocks a surfel touched; backward visits only those, surfel by surfel, with the surfel's sums in
  registers.
* A plane that was not asked for leaves no instruction behind: the kernels are compiled per group of planes
  (``GROUPS``), each when it is first needed.
* Each surfel-tile intersection writes its own gradient row; rows are then summed per surfel in a fixed order. No
  atomics, no per-thread buffers: results are bitwise the same for any number of threads.
"""

# mypy: ignore-errors
from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.cpython.unsafe.numbers import trailing_zeros

from unveil_core.parallel import FAST
from unveil_core.raster.cpu import lanes
from unveil_core.raster.cpu.lanes import Truth, Vector, add_across, lane_function, lane_type
from unveil_core.raster.cpu.records import (
    R_A0, R_A1, R_A2, R_B0, R_B1, R_B2, R_BLUE, R_CX, R_CY, R_E0, R_E1, R_E2, R_EX, R_EY, R_GREEN, R_IZ, R_LABEL,
    R_LOW, R_NX, R_NY, R_NZ, R_OPACITY, R_RED, R_Z, RECORD,
)  # fmt: skip
from unveil_core.raster.spec import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN

__all__ = ["GROUPS", "TILE", "kept_size", "row_size", "template"]

f32, u32, u64 = np.float32, np.uint32, np.uint64
TILE, BLOCK, BLOCKS = 16, 4, 16
SEGMENT = 512
ONE, ZERO, HALF = f32(1), f32(0), f32(0.5)
# exp(-x) on [0, 5.7] as (p(-x / 8))^8: beyond 5.7 alpha is under 1/255 whatever the opacity. Relative error 2e-6.
X_MAX = 5.7
EXP = (0.999999903, -0.999991289, 0.499867671, -0.16591143, 0.0396654613, -0.00578264651)
# A ray in the disc's own plane has q = 0. Held away from it, masked lanes stay finite and zero times them is zero.
Q_MIN = 1e-10
FINISHED = 2.0
"""The least alpha that counts in a pixel whose light is used up: none does."""
LANE_X = [k % BLOCK + 0.5 for k in range(16)]
LANE_Y = [k // BLOCK + 0.5 for k in range(16)]
BLOCK_X = [k % BLOCK * BLOCK + 0.5 for k in range(16)]
BLOCK_Y = [k // BLOCK * BLOCK + 0.5 for k in range(16)]
PIXEL_X, PIXEL_Y = np.array(LANE_X, np.float32), np.array(LANE_Y, np.float32)


# ---- what both directions share
@lane_function(lambda: types.uint64)
def _reached(builder, records, at, tile_x, tile_y):
    """Bit b: does the surfel of the record at ``at`` reach between the pixel centres of block b?

    Its ellipse is ``|(e0 x + e1 y, e2 y)| <= 1`` about (ex, ey). A convex function is least over a box at the box's
    point nearest to the centre along one of the two edges that face it.
    """
    e0, e1, e2 = (records.one(at, k) for k in (R_E0, R_E1, R_E2))

    def box(x, y):
        low_x, low_y = Vector.of(builder, BLOCK_X) + (tile_x - x), Vector.of(builder, BLOCK_Y) + (tile_y - y)
        high_x, high_y = low_x + float(BLOCK - 1), low_y + float(BLOCK - 1)
        return low_x, low_y, high_x, high_y, low_x.most(0.0).least(high_x), low_y.most(0.0).least(high_y)

    def inside(x, y):
        s, t = e0 * x + e1 * y, e2 * y
        return s * s + t * t <= 1.0

    low_x, low_y, high_x, high_y, near_x, near_y = box(records.one(at, R_EX), records.one(at, R_EY))
    lean = e1 / e0
    turn = e0 * e1 / (e1 * e1 + e2 * e2)
    met = inside((0.0 - near_y * lean).most(low_x).least(high_x), near_y)
    met |= inside(near_x, (0.0 - near_x * turn).most(low_y).least(high_y))
    *_, near_x, near_y = box(records.one(at, R_CX), records.one(at, R_CY))
    met |= near_x * near_x + near_y * near_y <= records.one(at, R_LOW)
    return met.bits()


class Splat:
    """A surfel at the sixteen pixels of a block, while code is generated.

    Attributes:
        dx, dy: pixel centre less projected mean.
        q, r, u, v: the intersection, r = 1 / q.
        square: squared distance that the weight is taken of; is_exact: whether it is the intersection's.
        raw: opacity times weight; alpha: at most ``ALPHA_MAX``, not masked.
        inv: one over the depth; in_front: whether that is a depth that counts.
    """

    def __init__(self, builder, records, at, block_x, block_y, inv_near):
        one = lambda k: records.one(at, k)  # noqa: E731
        self.dx = Vector.of(builder, LANE_X) + (block_x - one(R_CX))
        self.dy = Vector.of(builder, LANE_Y) + (block_y - one(R_CY))
        nu, nv = one(R_A0) * self.dx + one(R_B0) * self.dy, one(R_A1) * self.dx + one(R_B1) * self.dy
        q = 1.0 + one(R_A2) * self.dx + one(R_B2) * self.dy
        self.q = (q.magnitude() > Q_MIN).where(q, Q_MIN)
        self.r = 1.0 / self.q
        self.u, self.v = nu * self.r, nv * self.r
        exact, screen = self.u * self.u + self.v * self.v, 2.0 * (self.dx * self.dx + self.dy * self.dy)
        self.is_exact = exact <= screen
        self.square = exact.least(screen)
        x = (self.square * 0.5).least(X_MAX) * 0.125
        e = Vector.of(builder, EXP[5])
        for c in EXP[4::-1]:
            e = e * x + c
        for _ in range(3):
            e = e * e
        self.raw = e * one(R_OPACITY)
        self.alpha = self.raw.least(ALPHA_MAX)
        self.inv = self.is_exact.where(self.q, 1.0) * one(R_IZ)
        self.in_front = (self.inv > 0.0) & (self.inv <= inv_near)
        self.z = one(R_Z)

    def depth(self):
        return self.is_exact.where(self.r, 1.0) * self.z


def _four_rows(builder, first, step):
    rows = [first]
    for _ in range(3):
        rows.append(builder.add(rows[-1], step))
    return rows


@lane_function(lambda: types.void)
def _put(builder, memory, at, plane, first, step, spread):
    """A block's values to an image: (row r, column c) to ``first + r step + c spread``."""
    plane.scatter(memory.load(at), _four_rows(builder, first, step), spread)


@lane_function(lambda: types.void)
def _put_next(builder, memory, at, plane, first, step):
    """The same, where a row's values lie next to one another."""
    plane.scatter(memory.load(at), _four_rows(builder, first, step), None)


@lane_function(lambda: types.void)
def _get(builder, memory, at, plane, first, step, spread):
    """A block's values from an image, the way back of :func:`_put`."""
    memory.store(plane.gather(_four_rows(builder, first, step), spread), at)


@lane_function(lambda: types.void)
def _get_next(builder, memory, at, plane, first, step):
    """The same, where a row's values lie next to one another."""
    memory.store(plane.gather(_four_rows(builder, first, step), None), at)


# ---- forward: the first planes of a block's state are what backward needs
def _forward_planes(geometry, distortion_of_labels):
    names = ["T", "LAST"]
    names += ["M1", "M2", "MEDIAN_I", "FIRST"] if geometry else []
    names += ["LEAST", "RED", "GREEN", "BLUE"]
    names += ["NX", "NY", "NZ", "DEPTH", "DIST", "MEDIAN"] if geometry else []
    return names + (["LDIST"] if distortion_of_labels else [])


def _kept_planes(geometry):
    return 6 if geometry else 2


KEPT_LABEL = 4 * 16
"""Floats that a block keeps of a label for backward: transmittance, two moments and first hit."""


def kept_size(label_count: int, geometry: bool, label_distortion: bool) -> int:
    """Floats that a tile keeps for backward; the last one is the mask of labels met."""
    return BLOCKS * (16 * _kept_planes(geometry) + (label_count * KEPT_LABEL if label_distortion else 0)) + 1


def _state_type(Geometry, Labels):
    return types.UniTuple(lane_type, len(_forward_planes(Geometry, Labels)))


@lane_function(_state_type)
def _load_state(builder, Geometry, Labels, memory, at):
    """A block's pixels from memory."""
    return tuple(memory.load(at, 16 * k) for k in range(len(_forward_planes(Geometry, Labels))))


@lane_function(lambda Geometry, Labels: types.void)
def _store_state(builder, Geometry, Labels, memory, at, state):
    """A block's pixels to memory."""
    for k, vector in enumerate(state):
        memory.store(vector, at, 16 * k)


@lane_function(lambda G, S, L: types.Tuple((_state_type(G, L), types.uint64)))
def _blend(
    builder, Geometry, Semantics, Labels, state, memory, slot, records, at, block_x, block_y, rank, c1, inv_near
):
    """One surfel onto one block; also its lanes that had a part (low 16 bits) and those that go on (high 16 bits)."""
    names = _forward_planes(Geometry, Labels)
    s = dict(zip(names, state, strict=True))
    p = Splat(builder, records, at, block_x, block_y, inv_near)
    light = s["T"]
    valid = (p.alpha >= s["LEAST"]) & p.in_front
    # The surfel that would bring the light under the limit ends the pixel, and does not count itself.
    past = light * (1.0 - p.alpha)
    lasts = past >= TRANSMITTANCE_MIN
    s["LEAST"] = valid.where(lasts.where(s["LEAST"], FINISHED), s["LEAST"])
    counts = valid & lasts
    alpha = counts.where(p.alpha, 0.0)
    w = alpha * light
    s["T"] = counts.where(past, light)
    s["LAST"] = counts.where(rank, s["LAST"])
    for name, field in (("RED", R_RED), ("GREEN", R_GREEN), ("BLUE", R_BLUE)):
        s[name] += w * records.one(at, field)
    if Geometry:
        depth = p.depth()
        s["FIRST"] = (counts & (light >= 1.0)).where(p.inv, s["FIRST"])
        m = c1 * (s["FIRST"] - p.inv)
        for name, field in (("NX", R_NX), ("NY", R_NY), ("NZ", R_NZ)):
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
    packed = ir.Constant(ir.ArrayType(lanes.FLOATS, len(names)), ir.Undefined)
    for k, name in enumerate(names):
        packed = builder.insert_value(packed, s[name].value, k)
    return packed, told


def template(label_count, geometry, semantics, distortion_of_labels):
    """A block's state before the first surfel, as flat float32."""
    names = _forward_planes(geometry, distortion_of_labels)
    starts = {"T": 1.0, "LAST": -1.0, "MEDIAN_I": -1.0, "LEAST": ALPHA_MIN}
    slot = [0.0, 1.0, 0.0, 0.0, 0.0] if distortion_of_labels else [0.0] * semantics
    planes = [starts.get(name, 0.0) for name in names] + slot * label_count
    return np.repeat(np.array(planes, np.float32), 16)


# ---- backward
def _backward_planes(geometry, semantics, distortion_of_labels):
    names = ["T", "LAST"]
    names += ["M1", "M2", "MEDIAN_I", "FIRST"] if geometry else []
    names += ["SUM", "G_RED", "G_GREEN", "G_BLUE", "G_ALPHA"]
    names += ["G_DEPTH", "G_MEDIAN", "G_NX", "G_NY", "G_NZ", "G_DIST", "GA"] if geometry else []
    return names + (["G_LDIST"] if distortion_of_labels else [])


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


@lane_function(lambda Geometry: types.void)
def _store_empty_row(builder, Geometry, rows, at):
    """A gradient row of zeros."""
    zero = Vector.of(builder, 0.0)
    rows.store(zero, at)
    if Geometry:
        rows.store_four(zero, at, 0, 16)


@lane_function(lambda: types.void)
def _expect(builder, records, at):
    """Ask for a record that will be needed soon."""
    for line in (0, 16):
        records.prefetch(at, line)


@lane_function(lambda G, S, L: _sums_type(G))
def _unblend(
    builder, Geometry, Semantics, Labels, sums, memory, start, slot, records, at, block_x, block_y, rank, c1, inv_near
):
    """One surfel off one block: its sums with what this block adds; the block's light and sums behind, updated."""
    offset = {name: 16 * k for k, name in enumerate(_backward_planes(Geometry, Semantics, Labels))}
    plane = lambda name: memory.load(start, offset[name])  # noqa: E731
    one = lambda k: records.one(at, k)  # noqa: E731
    p = Splat(builder, records, at, block_x, block_y, inv_near)
    counts = (plane("LAST") >= rank) & (p.alpha >= ALPHA_MIN) & p.in_front
    alpha = counts.where(p.alpha, 0.0)
    ra = 1.0 / (1.0 - alpha)
    light = plane("T") * ra
    memory.store(light, start, offset["T"])
    w, total = alpha * light, plane("SUM")
    g_rgb = [plane(name) for name in ("G_RED", "G_GREEN", "G_BLUE")]
    value = plane("G_ALPHA") + g_rgb[0] * one(R_RED) + g_rgb[1] * one(R_GREEN) + g_rgb[2] * one(R_BLUE)
    if Semantics:
        value += memory.load(slot)
    if Geometry:
        depth = counts.where(p.depth(), 0.0)
        m = c1 * (plane("FIRST") - p.inv)
        ga, gm, g_depth = plane("GA"), plane("M1"), plane("G_DEPTH")
        g_normal = [plane(name) for name in ("G_NX", "G_NY", "G_NZ")]
        value += g_depth * depth
        value += g_normal[0] * one(R_NX) + g_normal[1] * one(R_NY) + g_normal[2] * one(R_NZ)
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
        by_q += p.is_exact.where(by_inv, 0.0) * one(R_IZ)
        adds = [p.is_exact.where(p.q, 1.0) * by_inv, *(w * g for g in g_normal)]
    adds = [
        by_nu, by_nu * p.dx, by_nu * p.dy, by_nv, by_nv * p.dx, by_nv * p.dy, by_q, by_q * p.dx, by_q * p.dy, h,
        *(w * g for g in g_rgb), by_screen * p.dx, by_screen * p.dy, *adds,
    ]  # fmt: skip
    return tuple(a + b for a, b in zip(sums, adds, strict=True))


# ---- one pair of kernels per group of planes
def _sources() -> int:
    """A number of the code that the kernels are generated from: numba's cache looks at this file only."""
    texts = b"".join((Path(__file__).parent / name).read_bytes() for name in ("lanes.py", "records.py", "../spec.py"))
    return int(hashlib.sha256(texts).hexdigest()[:12], 16)


@njit(**{**FAST, "forceinline": True})
def _aligned(memory):
    """Where the first whole cache line of a float32 array begins."""
    return u64((u64(64) - u64(memory.ctypes.data) % u64(64)) % u64(64)) // u64(4)


def _group(geometry, semantics, distortion_of_labels):
    """Forward and backward with these switches as constants, after the switches themselves."""
    sources = _sources()
    planes = len(_forward_planes(geometry, distortion_of_labels)) * 16
    slot_size = 80 if distortion_of_labels else 16
    kept_planes = _kept_planes(geometry) * 16
    names = _forward_planes(geometry, distortion_of_labels)
    (F_LEAST, F_T, F_RED, F_NX, F_DEPTH, F_DIST, F_MEDIAN, F_LDIST) = (
        u64(names.index(n) * 16 if n in names else 0)
        for n in ("LEAST", "T", "RED", "NX", "DEPTH", "DIST", "MEDIAN", "LDIST")
    )
    back_names = _backward_planes(geometry, semantics, distortion_of_labels)
    back_planes = len(back_names) * 16
    row_floats = u64(row_size(geometry))
    back_slot = 112 if distortion_of_labels else 16
    (B_T, B_M1, B_M2, B_SUM, G_RED, G_ALPHA, G_DEPTH, G_MEDIAN, G_NX, G_DIST, B_GA, G_LDIST) = (
        u64(back_names.index(n) * 16 if n in back_names else 0)
        for n in ("T", "M1", "M2", "SUM", "G_RED", "G_ALPHA", "G_DEPTH", "G_MEDIAN", "G_NX", "G_DIST", "GA", "G_LDIST")
    )

    @njit(**FAST)
    def forward(
        tile, end, tiles_x, template, records, offsets, ids, width, height, c1, inv_near, label_count,
        rgb, alphas, depth, median, normal, distortion, labels, label_dist, kept, hits,
    ):  # fmt: skip
        if sources < 0:
            return
        size = template.size
        memory = np.empty(BLOCKS * size + 16, f32)
        base = _aligned(memory)
        lists = np.empty(BLOCKS * SEGMENT, np.int32)
        counts = np.empty(BLOCKS, np.int64)
        for t in range(tile, end):
            tx, ty = (t % tiles_x) * TILE, (t // tiles_x) * TILE
            first, last = offsets[t], offsets[t + 1]
            alive = u64(0xFFFF)
            for b in range(BLOCKS):
                for l in range(u64(size)):
                    memory[base + u64(b * size) + l] = template[l]
            if tx + TILE > width or ty + TILE > height:
                for b in range(BLOCKS):
                    inside = 0
                    for l in range(16):
                        x, y = tx + b % 4 * 4 + l % 4, ty + b // 4 * 4 + l // 4
                        if x < width and y < height:
                            inside += 1
                        else:
                            memory[base + u64(b * size + l) + F_LEAST] = f32(FINISHED)
                    if inside == 0:
                        alive &= ~(u64(1) << u64(b))
            met = 0
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
                    blocks = _reached(records, u64(ids[u64(i)]) * u64(RECORD), f32(tx), f32(ty)) & alive
                    while blocks != u64(0):
                        b = trailing_zeros(blocks)
                        blocks &= blocks - u64(1)
                        lists[u64(b * u64(SEGMENT)) + u64(counts[b])] = i
                        counts[b] += 1
                for b in range(BLOCKS):
                    if counts[b] == 0:
                        continue
                    at = base + u64(b * size)
                    state = _load_state(geometry, distortion_of_labels, memory, at)
                    block_x, block_y = f32(tx + b % 4 * 4), f32(ty + b // 4 * 4)
                    for k in range(counts[b]):
                        i = u64(lists[u64(b * SEGMENT + k)])
                        g = u64(ids[i]) * u64(RECORD)
                        if semantics:
                            slot = at + u64(planes) + u64(np.int64(records[g + u64(R_LABEL)]) * slot_size)
                        else:
                            slot = at
                        state, told = _blend(
                            geometry, semantics, distortion_of_labels, state, memory, slot, records, g, block_x,
                            block_y, f32(np.int64(i) - first), c1, inv_near,
                        )  # fmt: skip
                        hits[i] |= np.uint16(u64((told & u64(0xFFFF)) != u64(0)) << u64(b))
                        if told <= u64(0xFFFF):
                            alive &= ~(u64(1) << u64(b))
                            break
                    _store_state(geometry, distortion_of_labels, memory, at, state)
                if distortion_of_labels:
                    for i in range(low, high):
                        if hits[u64(i)] != 0:
                            met |= 1 << np.int64(records[u64(ids[u64(i)]) * u64(RECORD) + u64(R_LABEL)])
            if kept.shape[0] > 0:
                keep = kept[t]
                stride = kept_planes + (label_count * KEPT_LABEL if distortion_of_labels else 0)
                for b in range(BLOCKS):
                    at, to = base + u64(b * size), u64(b * stride)
                    for l in range(u64(kept_planes)):
                        keep[to + l] = memory[at + l]
                    if distortion_of_labels:
                        for k in range(label_count):
                            if (met >> k) & 1:
                                target, source = to + u64(kept_planes + k * KEPT_LABEL), at + u64(planes + k * 80 + 16)
                                for l in range(u64(KEPT_LABEL)):
                                    keep[target + l] = memory[source + l]
                keep[u64(BLOCKS * stride)] = f32(met)
            for b in range(BLOCKS):
                x0, y0, at = tx + b % 4 * 4, ty + b // 4 * 4, base + u64(b * size)
                for l in range(u64(16)):
                    memory[at + F_T + l] = ONE - memory[at + F_T + l]
                if x0 + BLOCK <= width and y0 + BLOCK <= height:
                    one, step = u64(y0 * width + x0), u64(width)
                    for c in range(u64(3)):
                        _put(memory, at + F_RED + c * u64(16), rgb, u64(3) * one + c, u64(3) * step, u64(3))
                    _put_next(memory, at + F_T, alphas, one, step)
                    if geometry:
                        _put_next(memory, at + F_DEPTH, depth, one, step)
                        _put_next(memory, at + F_MEDIAN, median, one, step)
                        for c in range(u64(3)):
                            _put(memory, at + F_NX + c * u64(16), normal, u64(3) * one + c, u64(3) * step, u64(3))
                        _put_next(memory, at + F_DIST, distortion, one, step)
                    if distortion_of_labels:
                        _put_next(memory, at + F_LDIST, label_dist, one, step)
                    if semantics:
                        n = u64(label_count)
                        for k in range(n):
                            _put(memory, at + u64(planes) + k * u64(slot_size), labels, n * one + k, n * step, n)
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
                        if distortion_of_labels:
                            label_dist[yy, xx] = memory[F_LDIST + j]
                        if semantics:
                            for k in range(u64(label_count)):
                                labels[yy, xx, k] = memory[j + u64(planes) + k * u64(slot_size)]

    @njit(**FAST)
    def backward(
        tile, end, tiles_x, records, offsets, ids, width, height, c1, inv_near, label_count,
        kept, hits, g_rgb, g_alpha, g_depth, g_median, g_normal, g_distortion, g_labels, g_label_dist, place, rows,
    ):  # fmt: skip
        if sources < 0:
            return
        size = back_planes + (label_count * back_slot if semantics else 0)
        stride = kept_planes + (label_count * KEPT_LABEL if distortion_of_labels else 0)
        memory = np.empty(BLOCKS * size + 16, f32)
        base = _aligned(memory)
        for t in range(tile, end):
            tx, ty = (t % tiles_x) * TILE, (t // tiles_x) * TILE
            first, count = offsets[t], offsets[t + 1] - offsets[t]
            keep = kept[t]
            met = np.int64(keep[u64(BLOCKS * stride)])
            for b in range(BLOCKS):
                at, source = base + u64(b * size), u64(b * stride)
                for l in range(u64(kept_planes)):
                    memory[at + l] = keep[source + l]
                for l in range(u64(16)):
                    memory[at + B_SUM + l] = ZERO
                x0, y0 = tx + b % 4 * 4, ty + b // 4 * 4
                whole = x0 + BLOCK <= width and y0 + BLOCK <= height
                if whole:
                    one, step = u64(y0 * width + x0), u64(width)
                    for c in range(u64(3)):
                        _get(memory, at + G_RED + c * u64(16), g_rgb, u64(3) * one + c, u64(3) * step, u64(3))
                    _get_next(memory, at + G_ALPHA, g_alpha, one, step)
                    if geometry:
                        _get_next(memory, at + G_DEPTH, g_depth, one, step)
                        _get_next(memory, at + G_MEDIAN, g_median, one, step)
                        for c in range(u64(3)):
                            _get(memory, at + G_NX + c * u64(16), g_normal, u64(3) * one + c, u64(3) * step, u64(3))
                        _get_next(memory, at + G_DIST, g_distortion, one, step)
                    if distortion_of_labels:
                        _get_next(memory, at + G_LDIST, g_label_dist, one, step)
                    if semantics:
                        n = u64(label_count)
                        for k in range(n):
                            _get(memory, at + u64(back_planes) + k * u64(back_slot), g_labels, n * one + k, n * step, n)
                for l in range(0 if whole else 16):
                    x, y = tx + b % 4 * 4 + l % 4, ty + b // 4 * 4 + l // 4
                    j, yy, xx = at + u64(l), u64(y), u64(x)
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
                        if distortion_of_labels:
                            memory[G_LDIST + j] = g_label_dist[yy, xx]
                        if semantics:
                            for k in range(u64(label_count)):
                                memory[u64(back_planes) + k * u64(back_slot) + j] = g_labels[yy, xx, k]
                    else:
                        for k in range((u64(back_planes) - G_RED) // u64(16)):
                            memory[G_RED + k * u64(16) + j] = ZERO
                        if semantics:
                            for k in range(u64(label_count)):
                                memory[u64(back_planes) + k * u64(back_slot) + j] = ZERO
                if geometry:
                    # dL_d/dw_i = m_i^2 A + Q - 2 m_i M with the totals A, M, Q: scaled by the incoming gradient here.
                    for l in range(u64(16)):
                        j = at + l
                        gd = memory[G_DIST + j]
                        memory[B_GA + j] = gd * (ONE - memory[B_T + j])
                        memory[G_ALPHA + j] += gd * memory[B_M2 + j]
                        memory[B_M1 + j] *= gd
                if distortion_of_labels:
                    for k in range(label_count):
                        if (met >> k) & 1:
                            saved = source + u64(kept_planes + k * KEPT_LABEL)
                            slot = at + u64(back_planes + k * back_slot + 16)
                            for l in range(u64(16)):
                                gd, light = memory[G_LDIST + at + l], keep[saved + l]
                                memory[slot + l] = light
                                memory[slot + u64(16) + l] = gd * keep[saved + u64(16) + l]
                                memory[slot + u64(32) + l] = gd * keep[saved + u64(32) + l]
                                memory[slot + u64(48) + l] = keep[saved + u64(48) + l]
                                memory[slot + u64(64) + l] = ZERO
                                memory[slot + u64(80) + l] = gd * (ONE - light)
            for back in range(count - 1, -1, -1):
                i = u64(first + back)
                if back >= 8:
                    _expect(records, u64(ids[i - u64(8)]) * u64(RECORD))
                row = u64(place[i]) * row_floats
                blocks = u64(hits[i])
                if blocks == u64(0):
                    _store_empty_row(geometry, rows, row)
                    continue
                g = u64(ids[i]) * u64(RECORD)
                label_slot = 0
                if semantics:
                    label_slot = back_planes + np.int64(records[g + u64(R_LABEL)]) * back_slot
                sums = _no_sums(geometry)
                while blocks != u64(0):
                    b = np.int64(trailing_zeros(blocks))
                    blocks &= blocks - u64(1)
                    at = base + u64(b * size)
                    sums = _unblend(
                        geometry, semantics, distortion_of_labels, sums, memory, at, at + u64(label_slot), records, g,
                        f32(tx + b % 4 * 4), f32(ty + b // 4 * 4), f32(back), c1, inv_near,
                    )  # fmt: skip
                _store_row(geometry, sums, rows, row)

    return geometry, semantics, distortion_of_labels, forward, backward


GROUPS = {
    "colour": _group(geometry=False, semantics=False, distortion_of_labels=False),
    "semantic": _group(geometry=False, semantics=True, distortion_of_labels=False),
    "geometry": _group(geometry=True, semantics=False, distortion_of_labels=False),
    "all": _group(geometry=True, semantics=True, distortion_of_labels=True),
}
"""Name to (geometry, semantics, label distortion, forward, backward), the cheapest first."""
