"""A tile is 16x16 pixels in 4x4 blocks of 16; a block is one :mod:`lanes` vector. What both directions share."""

# mypy: ignore-errors
from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import INLINED
from unveil_core.raster import records as rec
from unveil_core.raster.cpu.lanes import Vector, lane_function
from unveil_core.raster.passes import TILE
from unveil_core.raster.spec import ALPHA_MAX

__all__ = [
    "AHEAD",
    "BLOCK",
    "BLOCKS",
    "KEPT_LABEL",
    "Splat",
    "TILE",
    "aligned",
    "expect",
    "get",
    "get_next",
    "kept_planes",
    "kept_size",
    "offsets_of",
    "put",
    "put_next",
    "reached",
    "sources",
]

u64 = np.uint64
BLOCK, BLOCKS = 4, 16
AHEAD = 12
"""How many surfels before its turn a record is asked for: it lies anywhere in memory."""
# exp(-x) on [0, 5.7] as (p(-x / 8))^8: beyond 5.7 alpha is under 1/255 whatever the opacity.
X_MAX = 5.7
EXP = {
    3: (0.999916539, -0.996679945, 0.477770812, -0.115977704),
    4: (0.999997025, -0.999812178, 0.498007646, -0.158996021, 0.0290251283),
    5: (0.999999903, -0.999991289, 0.499867671, -0.16591143, 0.0396654613, -0.00578264651),
}
"""By degree; relative errors 7e-4, 3e-5 and 3e-6."""
# A ray in the disc's own plane has q = 0. Held away from it, masked lanes stay finite and zero times them is zero.
Q_MIN = 1e-10
LANE_X = [k % BLOCK + 0.5 for k in range(16)]
LANE_Y = [k // BLOCK + 0.5 for k in range(16)]
BLOCK_X = [k % BLOCK * BLOCK + 0.5 for k in range(16)]
BLOCK_Y = [k // BLOCK * BLOCK + 0.5 for k in range(16)]


@lane_function(lambda: types.uint64)
def reached(builder, records, at, low, tile_x, tile_y):
    """Bit b: does the surfel of the record at ``at`` reach between the pixel centres of block b?

    Its ellipse is ``|(e0 x + e1 y, e2 y)| <= 1`` about (ex, ey). A convex function is least over a box at the box's
    point nearest to the centre along one of the two edges that face it.
    """
    e0, e1, e2 = (records.one(at, k) for k in (rec.E0, rec.E1, rec.E2))

    def box(x, y):
        low_x, low_y = Vector.of(builder, BLOCK_X) + (tile_x - x), Vector.of(builder, BLOCK_Y) + (tile_y - y)
        high_x, high_y = low_x + float(BLOCK - 1), low_y + float(BLOCK - 1)
        return low_x, low_y, high_x, high_y, low_x.most(0.0).least(high_x), low_y.most(0.0).least(high_y)

    def inside(x, y):
        s, t = e0 * x + e1 * y, e2 * y
        return s * s + t * t <= 1.0

    low_x, low_y, high_x, high_y, near_x, near_y = box(records.one(at, rec.EX), records.one(at, rec.EY))
    lean = e1 / e0
    turn = e0 * e1 / (e1 * e1 + e2 * e2)
    met = inside((0.0 - near_y * lean).most(low_x).least(high_x), near_y)
    met |= inside(near_x, (0.0 - near_x * turn).most(low_y).least(high_y))
    *_, near_x, near_y = box(records.one(at, rec.CX), records.one(at, rec.CY))
    met |= near_x * near_x + near_y * near_y <= low
    return met.bits()


def _from_mean(builder, records, at, block_x, block_y):
    """A block's corner less the projected mean, with the digits that the mean's own float32 has not.

    Single numbers, and strictly in this order: the first difference is exact.
    """
    base = ir.FloatType()(rec.REST_BASE)
    floor = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(ir.FloatType(), [ir.FloatType()]), "llvm.floor.f32"
    )
    rest = records.number(at, rec.REST)
    rest_x = builder.call(floor, [builder.fadd(builder.fdiv(rest, base), ir.FloatType()(0.5))])
    rests = rest_x, builder.fsub(rest, builder.fmul(rest_x, base))
    corner = []
    for block, field, left in zip((block_x, block_y), (rec.CX, rec.CY), rests, strict=True):
        whole = builder.fsub(block.number(), records.number(at, field))
        corner.append(Vector.of(builder, builder.fsub(whole, builder.fmul(left, ir.FloatType()(rec.REST_UNIT)))))
    return corner


class Splat:
    """A surfel at the sixteen pixels of a block, while code is generated.

    Attributes:
        dx, dy: pixel centre less projected mean.
        q, r, u, v: the intersection, r = 1 / q.
        square: squared distance that the weight is taken of; is_exact: whether it is the intersection's.
        raw: opacity times weight; alpha: at most ``ALPHA_MAX``, not masked.
        inv: one over the depth; in_front: whether that is a depth that counts.
    """

    def __init__(self, builder, Degree, records, at, block_x, block_y, inv_near):
        one = lambda k: records.one(at, k)  # noqa: E731
        x, y = _from_mean(builder, records, at, block_x, block_y)
        self.dx, self.dy = Vector.of(builder, LANE_X) + x, Vector.of(builder, LANE_Y) + y
        nu, nv = one(rec.A0) * self.dx + one(rec.B0) * self.dy, one(rec.A1) * self.dx + one(rec.B1) * self.dy
        q = 1.0 + one(rec.A2) * self.dx + one(rec.B2) * self.dy
        self.q = (q.magnitude() > Q_MIN).where(q, Q_MIN)
        self.r = 1.0 / self.q
        self.u, self.v = nu * self.r, nv * self.r
        exact, screen = self.u * self.u + self.v * self.v, 2.0 * (self.dx * self.dx + self.dy * self.dy)
        self.is_exact = exact <= screen
        self.square = exact.least(screen)
        x = (self.square * 0.5).least(X_MAX) * 0.125
        *rest, highest = EXP[Degree]
        e = Vector.of(builder, highest)
        for c in reversed(rest):
            e = e * x + c
        for _ in range(3):
            e = e * e
        self.raw = e * one(rec.OPACITY)
        self.alpha = self.raw.least(ALPHA_MAX)
        self.inv = self.is_exact.where(self.q, 1.0) * one(rec.IZ)
        self.in_front = (self.inv > 0.0) & (self.inv <= inv_near)
        self.z = one(rec.Z)

    def depth(self):
        return self.is_exact.where(self.r, 1.0) * self.z


def _four_rows(builder, first, step):
    rows = [first]
    for _ in range(3):
        rows.append(builder.add(rows[-1], step))
    return rows


@lane_function(lambda: types.void)
def put(builder, memory, at, plane, first, step, spread):
    """A block's values to an image: (row r, column c) to ``first + r step + c spread``."""
    plane.scatter(memory.load(at), _four_rows(builder, first, step), spread)


@lane_function(lambda: types.void)
def put_next(builder, memory, at, plane, first, step):
    """The same, where a row's values lie next to one another."""
    plane.scatter(memory.load(at), _four_rows(builder, first, step), None)


@lane_function(lambda: types.void)
def get(builder, memory, at, plane, first, step, spread):
    """A block's values from an image, the way back of :func:`put`."""
    memory.store(plane.gather(_four_rows(builder, first, step), spread), at)


@lane_function(lambda: types.void)
def get_next(builder, memory, at, plane, first, step):
    """The same, where a row's values lie next to one another."""
    memory.store(plane.gather(_four_rows(builder, first, step), None), at)


@lane_function(lambda: types.void)
def expect(builder, records, at):
    """Ask for a record that will be needed soon."""
    for line in (0, 16):
        records.prefetch(at, line)


def kept_planes(geometry):
    """A block's planes that forward keeps for backward, the first ones of its state in both."""
    return ["T", "LAST", "M1", "M2", "MEDIAN_I", "FIRST"] if geometry else ["T", "LAST"]


KEPT_LABEL = 4 * 16
"""Floats that a block keeps of a label for backward: transmittance, two moments and first hit."""


def kept_size(label_count: int, geometry: bool, label_distortion: bool) -> int:
    """Floats that a tile keeps for backward; the last ones are the masks of the labels that each block met."""
    return BLOCKS * (16 * len(kept_planes(geometry)) + (label_count * KEPT_LABEL if label_distortion else 0) + 1)


def offsets_of(planes, *names):
    """Where these planes lie in a block's state; 0 for one that a group does not have, and so does not touch."""
    return tuple(u64(16 * planes.index(name) if name in planes else 0) for name in names)


@njit(**INLINED)
def aligned(memory):
    """Where the first whole cache line of a float32 array begins."""
    return u64((u64(64) - u64(memory.ctypes.data) % u64(64)) % u64(64)) // u64(4)


TILE_SOURCES = ("lanes.py", "block.py", "tile_output.py", "../passes.py", "../records.py", "../spec.py")


def sources(*names: str) -> int:
    """A number of the code that a kernel is made of: files beside this one, those of the tile kernels by default.

    numba's cache looks at a kernel's own file and at the values it closes over, so the kernels close over this.
    """
    here = Path(__file__).parent
    texts = (here / name for name in names or TILE_SOURCES)
    return int(hashlib.sha256(b"".join(text.read_bytes() for text in texts)).hexdigest()[:12], 16)
