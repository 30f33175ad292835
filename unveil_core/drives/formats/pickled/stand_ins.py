"""What a pickle gets for what arrays name in it: stand-ins that keep what they are given, from which arrays are made once it was
checked.

NumPy's own types are no exception: their ``__setstate__`` takes a stranger's word for how wide a number is and whether it is a
pointer.
"""

from __future__ import annotations

import math
import pickle
import re
from collections.abc import Iterable
from contextvars import ContextVar
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ARRAYS", "MOST_BYTES", "Array", "Kind", "StandIn", "check_keys", "made_bytes"]

MOST_BYTES = 1 << 30
"""Of one unpacked file: hundred times a sweep's. A few bytes of gzip can stand for more than fits into memory."""
MOST_AXES = 32
KINDS = re.compile(r"b1|[iu][1248]|f2|f4|f8|f16|c8|c16|O8?|[SU][0-9]{1,5}")
"""Names of types of numbers, texts and objects, as NumPy pickles them."""


class StandIn:
    """Keeps arguments and state of an object that the pickle would make."""

    arguments: tuple[Any, ...]
    state: Any

    def __new__(cls, *arguments: Any) -> StandIn:
        made = super().__new__(cls)
        made.arguments, made.state = arguments, None
        return made

    def __setstate__(self, state: Any) -> None:
        self.state = state


class Kind(StandIn):
    """A ``numpy.dtype``."""

    def made(self) -> np.dtype[Any]:
        name = self.arguments[0] if self.arguments else None
        order = self.state[1] if isinstance(self.state, tuple) and len(self.state) > 1 else "="
        if not isinstance(name, str) or not KINDS.fullmatch(name) or order not in ("<", ">", "=", "|"):
            raise pickle.UnpicklingError("an array holds neither numbers nor texts nor objects")
        return np.dtype(name).newbyteorder(order)  # type: ignore[arg-type]


class Array(StandIn):
    """A ``numpy.ndarray``; as a class it is what its pickle names."""

    def made(self) -> NDArray[Any]:
        if not isinstance(self.state, tuple) or len(self.state) != 5:
            raise pickle.UnpicklingError("an array has no content")
        _, shape, kind, fortran, content = self.state
        if not isinstance(kind, Kind) or not isinstance(shape, tuple) or not all(type(n) is int for n in shape):
            raise pickle.UnpicklingError("an array has no shape or type")
        return _array_of(content, kind.made(), shape, "F" if fortran else "C")


made_bytes: ContextVar[list[int]] = ContextVar("made_bytes")
"""Of the pickle that is read, beyond its own."""


def _count(size: int) -> None:
    """Count bytes before they are made: of one text a pickle may make bytes and arrays any number of times."""
    made = made_bytes.get()
    made[0] += size
    if made[0] > MOST_BYTES:
        raise pickle.UnpicklingError("it makes more than a gigabyte of arrays")


def _array_of(content: Any, dtype: np.dtype[Any], shape: tuple[int, ...], order: Any) -> NDArray[Any]:
    """An array that owns its content: bytes of numbers, or a list of objects. Both must be as many as the shape says."""
    if len(shape) > MOST_AXES or any(not 0 <= n <= MOST_BYTES for n in shape):
        raise pickle.UnpicklingError("an array of a shape that none has")
    count = math.prod(shape)
    _count(count * dtype.itemsize)
    wanted, unit = (list, 1) if dtype.hasobject else (bytes | bytearray, dtype.itemsize)
    if not isinstance(content, wanted) or len(content) != count * unit:  # type: ignore[arg-type]
        raise pickle.UnpicklingError(f"an array of {shape} {dtype} has other content")
    if dtype.hasobject or not count:
        flat = np.empty(count, dtype=dtype)
        for i, value in enumerate(content if count else ()):
            flat[i] = value
    else:
        flat = np.frombuffer(content, dtype=dtype).copy()  # type: ignore[arg-type]
    return flat.reshape(shape, order=order)


def _reconstruct(kind: Any, *_: Any) -> Array:
    if kind is not Array:
        raise pickle.UnpicklingError("an array of an unknown kind")
    return Array()


def _number(kind: Any, content: Any) -> Any:
    """A scalar of NumPy."""
    if not isinstance(kind, Kind) or kind.made().hasobject:
        raise pickle.UnpicklingError("a number of an unknown kind")
    return _array_of(content, kind.made(), (1,), "C")[0]


def _from_buffer(content: Any, kind: Any, shape: Any, order: Any) -> Array:
    """As protocol 5 writes arrays."""
    made = Array()
    made.state = (1, shape, kind, order == "F", content)
    return made


def _latin1(text: str, encoding: str) -> bytes:
    """Bytes as protocol 2 writes them."""
    if encoding != "latin1":
        raise pickle.UnpicklingError("text in another encoding")
    _count(len(text))
    return text.encode("latin1")


def _no_bytes() -> bytes:
    """The same, where there are none."""
    return b""


def _ordered(pairs: Any = ()) -> dict[Any, Any]:
    """A dict that keeps an order, which every dict does."""
    if not isinstance(pairs, list | tuple) or not all(isinstance(p, list | tuple) and len(p) == 2 for p in pairs):
        raise pickle.UnpicklingError("an ordered dict of other than pairs")
    check_keys(key for key, _ in pairs)
    return dict(pairs)


def check_keys(keys: Iterable[Any]) -> None:
    """Refuse keys other than texts and numbers: that of a tuple of tuples of itself takes for ever."""
    if not all(key is None or isinstance(key, str | bytes | int | float | np.number) for key in keys):
        raise pickle.UnpicklingError("a dict has keys that are neither texts nor numbers")


ARRAYS: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): Array,
    ("numpy", "dtype"): Kind,
    ("_codecs", "encode"): _latin1,
    ("__builtin__", "bytes"): _no_bytes,
    ("collections", "OrderedDict"): _ordered,
}
for _package in ("numpy.core", "numpy._core"):
    ARRAYS[f"{_package}.multiarray", "_reconstruct"] = _reconstruct
    ARRAYS[f"{_package}.multiarray", "scalar"] = _number
    ARRAYS[f"{_package}.numeric", "_frombuffer"] = _from_buffer
"""What arrays, and dicts of such, name."""
