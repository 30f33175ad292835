"""Sixteen pixels as one value: vectors that numba kernels hold in registers.

numba has no vector type, and a loop over 16 floats becomes vector code only if LLVM proves that nothing overlaps, which
costs copies and breaks silently. Here sixteen lanes are a value of a kernel like any number, and :func:`lane_function`
turns a Python function over :class:`Vector` into straight vector instructions of whatever width the processor has
(LLVM splits 16 lanes into two or four parts where it must).
"""

# mypy: ignore-errors
from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, models, register_model

__all__ = ["LANES", "Vector", "add_across", "lane_function", "lane_type"]

LANES = 16
FLOAT, WORD = ir.FloatType(), ir.IntType(32)
FLOATS = ir.VectorType(FLOAT, LANES)
WORDS = ir.VectorType(WORD, LANES)
_FAST = ("fast",)


class LaneType(types.Type):
    """numba's type of sixteen float32."""

    def __init__(self) -> None:
        super().__init__("lanes16")


lane_type = LaneType()


@register_model(LaneType)
class _LaneModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: Any) -> None:
        super().__init__(manager, fe_type, FLOATS)


class Truth:
    """Sixteen truths while code is generated."""

    def __init__(self, builder: ir.IRBuilder, value: ir.Value) -> None:
        self.builder, self.value = builder, value

    def __and__(self, other: Truth) -> Truth:
        return Truth(self.builder, self.builder.and_(self.value, other.value))

    def __or__(self, other: Truth) -> Truth:
        return Truth(self.builder, self.builder.or_(self.value, other.value))

    def where(self, yes: Any, no: Any) -> Vector:
        """``yes`` where true, ``no`` elsewhere."""
        pick = Vector.of(self.builder, yes), Vector.of(self.builder, no)
        return Vector(self.builder, self.builder.select(self.value, pick[0].value, pick[1].value))

    def bits(self) -> ir.Value:
        """An unsigned 64-bit number whose bit l is lane l."""
        packed = self.builder.bitcast(self.value, ir.IntType(LANES))
        return self.builder.zext(packed, ir.IntType(64))


class Vector:
    """Sixteen floats while code is generated; arithmetic with a number broadcasts it."""

    def __init__(self, builder: ir.IRBuilder, value: ir.Value) -> None:
        self.builder, self.value = builder, value

    @staticmethod
    def of(builder: ir.IRBuilder, value: Any) -> Vector:
        """A vector of a vector, of a Python number, of sixteen of them, or of a float of the generated code."""
        if isinstance(value, Vector):
            return value
        if isinstance(value, int | float):
            value = [float(value)] * LANES
        if isinstance(value, list | tuple):
            return Vector(builder, ir.Constant(FLOATS, [float(v) for v in value]))
        one = builder.insert_element(ir.Constant(FLOATS, ir.Undefined), value, ir.Constant(WORD, 0))
        return Vector(builder, builder.shuffle_vector(one, ir.Constant(FLOATS, ir.Undefined), ir.Constant(WORDS, None)))

    def _with(self, operation: str, other: Any, *, turned: bool = False) -> Vector:
        a, b = self.value, Vector.of(self.builder, other).value
        a, b = (b, a) if turned else (a, b)
        return Vector(self.builder, getattr(self.builder, operation)(a, b, flags=_FAST))

    def __add__(self, other: Any) -> Vector:
        return self._with("fadd", other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Vector:
        return self._with("fsub", other)

    def __rsub__(self, other: Any) -> Vector:
        return self._with("fsub", other, turned=True)

    def __mul__(self, other: Any) -> Vector:
        return self._with("fmul", other)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Vector:
        return self._with("fdiv", other)

    def __rtruediv__(self, other: Any) -> Vector:
        return self._with("fdiv", other, turned=True)

    def _compare(self, sign: str, other: Any) -> Truth:
        right = Vector.of(self.builder, other).value
        return Truth(self.builder, self.builder.fcmp_ordered(sign, self.value, right, flags=_FAST))

    def __lt__(self, other: Any) -> Truth:
        return self._compare("<", other)

    def __le__(self, other: Any) -> Truth:
        return self._compare("<=", other)

    def __gt__(self, other: Any) -> Truth:
        return self._compare(">", other)

    def __ge__(self, other: Any) -> Truth:
        return self._compare(">=", other)

    def equals(self, other: Any) -> Truth:
        """Lanes that are the same number."""
        return self._compare("==", other)

    def least(self, other: Any) -> Vector:
        """The smaller of the two, lane by lane."""
        return (self < other).where(self, other)

    def most(self, other: Any) -> Vector:
        """The greater of the two, lane by lane."""
        return (self > other).where(self, other)

    def number(self) -> ir.Value:
        """The first lane, as a float of the generated code."""
        return self.builder.extract_element(self.value, ir.Constant(WORD, 0))

    def magnitude(self) -> Vector:
        """Without the sign."""
        kind = ir.FunctionType(FLOATS, [FLOATS])
        function = cgutils.get_or_insert_function(self.builder.module, kind, f"llvm.fabs.v{LANES}f32")
        return Vector(self.builder, self.builder.call(function, [self.value]))

    def shuffled(self, other: Vector, lanes: list[int]) -> Vector:
        """Lanes of both, counted through: 0 to 15 are this one's, 16 to 31 the other's."""
        mask = ir.Constant(WORDS, lanes)
        return Vector(self.builder, self.builder.shuffle_vector(self.value, other.value, mask))


def add_across(vectors: list[Vector]) -> Vector:
    """Lane k of the result is the sum over the lanes of vector k; up to sixteen vectors, by halving in pairs."""
    builder = vectors[0].builder
    level = vectors + [Vector.of(builder, 0.0)] * (LANES - len(vectors))
    group = LANES
    while group > 1:
        half = group // 2
        low, high = [], []
        for lane in range(LANES):
            start, position = lane // group * group, lane % group
            first = position < half
            low.append(start + position if first else LANES + start + position - half)
            high.append(start + half + position if first else LANES + start + position)
        level = [
            level[k].shuffled(level[k + half], low) + level[k].shuffled(level[k + half], high) for k in range(half)
        ]
        group = half
    return level[0]


class Floats:
    """A float32 array of the kernel while code is generated: its memory as one run of floats."""

    def __init__(self, builder: ir.IRBuilder, data: ir.Value) -> None:
        self.builder, self.data = builder, data

    def _pointer(self, index: ir.Value, offset: int, lanes: int = 1) -> ir.Value:
        if offset:
            index = self.builder.add(index, ir.Constant(index.type, offset))
        pointer = self.builder.gep(self.data, [index])
        return pointer if lanes == 1 else self.builder.bitcast(pointer, ir.VectorType(FLOAT, lanes).as_pointer())

    def number(self, index: ir.Value, offset: int = 0) -> ir.Value:
        """The float at index + offset."""
        return self.builder.load(self._pointer(index, offset))

    def one(self, index: ir.Value, offset: int = 0) -> Vector:
        """The float at index + offset, in every lane."""
        return Vector.of(self.builder, self.number(index, offset))

    def load(self, index: ir.Value, offset: int = 0) -> Vector:
        """Sixteen floats from index + offset on."""
        return Vector(self.builder, self.builder.load(self._pointer(index, offset, LANES), align=4))

    def store(self, vector: Vector, index: ir.Value, offset: int = 0) -> None:
        """The sixteen lanes to index + offset and on."""
        self.builder.store(vector.value, self._pointer(index, offset, LANES), align=4)

    def store_four(self, vector: Vector, index: ir.Value, first: int = 0, offset: int = 0) -> None:
        """Four lanes, from ``first`` on, to index + offset and on."""
        chosen = ir.Constant(ir.VectorType(WORD, 4), [first + k for k in range(4)])
        four = self.builder.shuffle_vector(vector.value, vector.value, chosen)
        self.builder.store(four, self._pointer(index, offset, 4), align=4)

    def gather(self, rows: list[ir.Value], spread: ir.Value | None) -> Vector:
        """Four floats of each of four rows: those at ``spread`` from one another, or next to one another."""
        if spread is None:
            fours = [self.builder.load(self._pointer(row, 0, 4), align=4) for row in rows]
            eight = ir.Constant(ir.VectorType(WORD, 8), list(range(8)))
            halves = [self.builder.shuffle_vector(a, b, eight) for a, b in (fours[:2], fours[2:])]
            return Vector(self.builder, self.builder.shuffle_vector(*halves, ir.Constant(WORDS, list(range(LANES)))))
        value = ir.Constant(FLOATS, ir.Undefined)
        for lane, at in enumerate(self._spread(rows, spread)):
            value = self.builder.insert_element(value, self.builder.load(self._pointer(at, 0)), WORD(lane))
        return Vector(self.builder, value)

    def scatter(self, vector: Vector, rows: list[ir.Value], spread: ir.Value | None) -> None:
        """The way back of :meth:`gather`."""
        if spread is None:
            for k, row in enumerate(rows):
                self.store_four(vector, row, 4 * k)
            return
        for lane, at in enumerate(self._spread(rows, spread)):
            self.builder.store(self.builder.extract_element(vector.value, WORD(lane)), self._pointer(at, 0))

    def _spread(self, rows: list[ir.Value], spread: ir.Value) -> list[ir.Value]:
        places = []
        for row in rows:
            places.append(row)
            for _ in range(3):
                places.append(self.builder.add(places[-1], spread))
        return places

    def prefetch(self, index: ir.Value, offset: int = 0) -> None:
        """Ask the memory for what lies at index + offset."""
        byte = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, WORD, WORD, WORD])
        function = cgutils.get_or_insert_function(self.builder.module, kind, "llvm.prefetch.p0")
        pointer = self.builder.bitcast(self._pointer(index, offset), byte)
        self.builder.call(function, [pointer, WORD(0), WORD(3), WORD(1)])


def _unwrapped(context: Any, builder: ir.IRBuilder, kind: types.Type, value: ir.Value) -> Any:
    if isinstance(kind, types.Array):
        return Floats(builder, context.make_array(kind)(context, builder, value).data)
    if kind == lane_type:
        return Vector(builder, value)
    if kind == types.float32:
        return Vector.of(builder, value)
    if isinstance(kind, types.BaseTuple):
        parts = cgutils.unpack_tuple(builder, value)
        return tuple(_unwrapped(context, builder, k, v) for k, v in zip(kind, parts, strict=True))
    return value


def lane_function(result: Callable[..., types.Type]) -> Callable[[Callable[..., Any]], Any]:
    """A function that kernels may call, written over vectors.

    Arguments arrive as what they are in the kernel: arrays of float32 as :class:`Floats`, lanes and float32 as
    :class:`Vector`, tuples of these as tuples, integers as values of the generated code. Arguments whose name begins
    with a capital are switches: constants of the kernel, given as Python values.

    Args:
        result: from the switches, the type that the function returns to the kernel.
    """

    def decorate(body: Callable[..., Any]) -> Any:
        names = list(inspect.signature(body).parameters)[1:]
        switches = [k for k, name in enumerate(names) if name[0].isupper()]

        def typer(_context: Any, *arguments: types.Type) -> Any:
            constants = {k: arguments[k].literal_value for k in switches}
            kind = result(*constants.values())

            def generate(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> Any:
                given = [
                    constants[k] if k in constants else _unwrapped(context, builder, signature.args[k], values[k])
                    for k in range(len(names))
                ]
                made = body(builder, *given)
                if isinstance(made, tuple):
                    flat = [m.value if isinstance(m, Vector) else m for m in made]
                    return context.make_tuple(builder, signature.return_type, flat)
                if made is None:
                    return context.get_dummy_value()
                return made.value if isinstance(made, Vector) else made

            return kind(*arguments), generate

        typer.__name__, typer.__doc__, typer.__module__ = body.__name__, body.__doc__, body.__module__
        # numba reads the names of the arguments off the signature.
        typer.__signature__ = inspect.Signature(
            [inspect.Parameter(n, inspect.Parameter.POSITIONAL_OR_KEYWORD) for n in ["context", *names]]
        )
        return intrinsic(prefer_literal=True)(typer)

    return decorate
