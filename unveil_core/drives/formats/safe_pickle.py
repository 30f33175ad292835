"""Reading pickles of datasets without running what a stranger put into them.

A pickle is a program: it may call anything that it names. Here it may name only what arrays and tables of numbers need, and
gets stand-ins for all of these, which keep what they are given; everything else is refused before anything is called. NumPy's
own types are no exception: their ``__setstate__`` takes a stranger's word for how wide a number is and whether it is a pointer.
Arrays are made of what the stand-ins hold, once it was checked. Python's own unpickler is used, not the one in C, which makes
room for whatever a pickle announces. What a pickle may cost is bounded beside: its steps, the bytes that it makes, the digits of
its numbers, and what its lists come to when each is written out wherever it is named.
"""

from __future__ import annotations

import gzip
import io
import math
import os
import pickle
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.files import NO_ARCHIVE

__all__ = ["ARRAYS", "StandIn", "read_admitted", "read_archived_object", "read_arrays"]

MOST_BYTES = 1 << 30
"""Of one unpacked file: hundred times a sweep's. A few bytes of gzip can stand for more than fits into memory."""
FIRST_BYTES, MOST_UNPACKED = 64 << 20, 200
"""Beyond the first bytes, how many one packed byte unpacks to at most. Labels of a sweep, all but alike, make fifty."""
PIECE_BYTES = 1 << 20
MOST_STEPS = 1 << 20
"""Of the program that a pickle is, each of which makes an object at most. A table has some hundred, and two for each text; a scene
of a thousand frames with dicts of small arrays has 300,000."""
MOST_HELD = 1 << 21
"""Values in lists, tuples and dicts, those that stand in several places counted in each: sixty that name one another are more than
any loop comes to the end of."""
NUMBER_BYTES, NUMBER_DIGITS = 9, 20
"""Of a whole number of 64 bits, with and without a sign."""
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


class _Kind(StandIn):
    """A ``numpy.dtype``."""

    def made(self) -> np.dtype[Any]:
        name = self.arguments[0] if self.arguments else None
        order = self.state[1] if isinstance(self.state, tuple) and len(self.state) > 1 else "="
        if not isinstance(name, str) or not KINDS.fullmatch(name) or order not in ("<", ">", "=", "|"):
            raise pickle.UnpicklingError("an array holds neither numbers nor texts nor objects")
        return np.dtype(name).newbyteorder(order)  # type: ignore[arg-type]


class _Array(StandIn):
    """A ``numpy.ndarray``; as a class it is what its pickle names."""

    def made(self) -> NDArray[Any]:
        if not isinstance(self.state, tuple) or len(self.state) != 5:
            raise pickle.UnpicklingError("an array has no content")
        _, shape, kind, fortran, content = self.state
        if not isinstance(kind, _Kind) or not isinstance(shape, tuple) or not all(type(n) is int for n in shape):
            raise pickle.UnpicklingError("an array has no shape or type")
        return _array_of(content, kind.made(), shape, "F" if fortran else "C")


_made_bytes: ContextVar[list[int]] = ContextVar("made_bytes")
"""Of the pickle that is read, beyond its own."""


def _count(size: int) -> None:
    """Count bytes before they are made: of one text a pickle may make bytes and arrays any number of times."""
    made = _made_bytes.get()
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


def _reconstruct(kind: Any, *_: Any) -> _Array:
    if kind is not _Array:
        raise pickle.UnpicklingError("an array of an unknown kind")
    return _Array()


def _number(kind: Any, content: Any) -> Any:
    """A scalar of NumPy."""
    if not isinstance(kind, _Kind) or kind.made().hasobject:
        raise pickle.UnpicklingError("a number of an unknown kind")
    return _array_of(content, kind.made(), (1,), "C")[0]


def _from_buffer(content: Any, kind: Any, shape: Any, order: Any) -> _Array:
    """As protocol 5 writes arrays."""
    made = _Array()
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
    _check_keys(key for key, _ in pairs)
    return dict(pairs)


def _check_keys(keys: Iterable[Any]) -> None:
    """Refuse keys other than texts and numbers: that of a tuple of tuples of itself takes for ever."""
    if not all(key is None or isinstance(key, str | bytes | int | float | np.number) for key in keys):
        raise pickle.UnpicklingError("a dict has keys that are neither texts nor numbers")


ARRAYS: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Kind,
    ("_codecs", "encode"): _latin1,
    ("__builtin__", "bytes"): _no_bytes,
    ("collections", "OrderedDict"): _ordered,
}
for _package in ("numpy.core", "numpy._core"):
    ARRAYS[f"{_package}.multiarray", "_reconstruct"] = _reconstruct
    ARRAYS[f"{_package}.multiarray", "scalar"] = _number
    ARRAYS[f"{_package}.numeric", "_frombuffer"] = _from_buffer
"""What arrays, and dicts of such, name."""


_IN_PYTHON: Any = pickle._Unpickler  # type: ignore[attr-defined]


class _Restricted(_IN_PYTHON):  # type: ignore[misc]
    dispatch = dict(_IN_PYTHON.dispatch)

    def __init__(self, stream: io.BytesIO, admitted: Mapping[tuple[str, str], Any]) -> None:
        super().__init__(stream)
        self.admitted, self.steps = admitted, 0

    def find_class(self, module: str, name: str) -> Any:
        try:
            return self.admitted[module, name]
        except KeyError:
            raise pickle.UnpicklingError(f"it names {module}.{name}, which no such file needs") from None

    def persistent_load(self, pid: Any) -> Any:
        raise pickle.UnpicklingError("it refers to objects outside of it")

    def load_build(self) -> None:
        """Only stand-ins get a state: a pickle could set attributes of functions as well."""
        state = self.stack.pop()
        if not isinstance(self.stack[-1], StandIn):
            raise pickle.UnpicklingError("it gives a state to what has none")
        self.stack[-1].__setstate__(state)

    def load_bytearray8(self) -> None:
        """Without making room before it is there."""
        (length,) = struct.unpack("<Q", self.read(8))
        content = self.read(length) if length <= MOST_BYTES else b""
        if len(content) != length:
            raise pickle.UnpicklingError("it ends too soon")
        self.append(bytearray(content))

    def load_long1(self) -> None:
        self._load_number(self.read(1)[0])

    def load_long4(self) -> None:
        (count,) = struct.unpack("<i", self.read(4))
        self._load_number(count)

    def _load_number(self, count: int) -> None:
        """Of a number of a megabyte, arithmetic takes minutes."""
        if not 0 <= count <= NUMBER_BYTES:
            raise pickle.UnpicklingError("a number has more than 64 bits")
        self.append(pickle.decode_long(self.read(count)))

    def load_digits(self) -> None:
        """A number in digits, as protocol 0 writes it; 00 and 01 are truth values."""
        line = self.readline()[:-1]
        digits = line.removesuffix(b"L")
        if len(digits) > NUMBER_DIGITS:
            raise pickle.UnpicklingError("a number has more than 64 bits")
        self.append(line == b"01" if line in (b"00", b"01") else int(digits))

    def load_setitem(self) -> None:
        _check_keys(self.stack[-2:-1])
        _IN_PYTHON.load_setitem(self)

    def load_setitems(self) -> None:
        _check_keys(self.stack[::2])
        _IN_PYTHON.load_setitems(self)

    def load_dict(self) -> None:
        _check_keys(self.stack[::2])
        _IN_PYTHON.load_dict(self)

    dispatch[pickle.BUILD[0]] = load_build
    dispatch[pickle.BYTEARRAY8[0]] = load_bytearray8
    dispatch[pickle.LONG1[0]], dispatch[pickle.LONG4[0]] = load_long1, load_long4
    dispatch[pickle.INT[0]] = dispatch[pickle.LONG[0]] = load_digits
    dispatch[pickle.SETITEM[0]], dispatch[pickle.SETITEMS[0]] = load_setitem, load_setitems
    dispatch[pickle.DICT[0]] = load_dict
    for _step in (pickle.EMPTY_SET, pickle.ADDITEMS, pickle.FROZENSET, pickle.EXT1, pickle.EXT2, pickle.EXT4):
        del dispatch[_step[0]]  # of no table: sets may hold what keys may not be


def _counted(step: Callable[[Any], None]) -> Callable[[Any], None]:
    def counted(unpickler: Any) -> None:
        unpickler.steps += 1
        if unpickler.steps > MOST_STEPS:
            raise pickle.UnpicklingError(f"it has more than {MOST_STEPS:,} steps, which no such file needs")
        step(unpickler)

    return counted


_Restricted.dispatch = {code: _counted(step) for code, step in _Restricted.dispatch.items()}


class _Plain:
    """Makes values plain: with the arrays that their stand-ins stand for, however deep.

    Attributes:
        done: what was seen before, by identity, each with what was made of it and how many values it holds. It also keeps the
            values, so that no other gets their identity.
    """

    def __init__(self) -> None:
        self.done: dict[int, tuple[Any, Any, int]] = {}

    def of(self, value: Any) -> Any:
        """The plain value."""
        return self._of(value)[0]

    def _of(self, value: Any) -> tuple[Any, int]:
        if not isinstance(value, tuple | list | dict | StandIn):
            return value, 1
        if id(value) in self.done:
            _, made, held = self.done[id(value)]
            if not held:
                raise pickle.UnpicklingError("a list lies within itself")
            return made, held
        self.done[id(value)] = value, None, 0
        made, held = self._made(value)
        if held > MOST_HELD:
            raise pickle.UnpicklingError(f"its lists hold more than {MOST_HELD:,} values")
        self.done[id(value)] = value, made, held
        return made, held

    def _made(self, value: Any) -> tuple[Any, int]:
        if isinstance(value, _Array):
            array = value.made()
            held = 1
            if array.dtype.hasobject:
                for i, inner in enumerate(array.flat):
                    array.flat[i], more = self._of(inner)
                    held += more
            return array, held
        if isinstance(value, StandIn):
            if isinstance(value, _Kind):
                return value, 1
            value.arguments, first = self._of(value.arguments)
            value.state, second = self._of(value.state)
            return value, first + second
        parts = [self._of(v) for v in (value.values() if isinstance(value, dict) else value)]
        held = 1 + sum(more for _, more in parts)
        if isinstance(value, tuple):
            return tuple(part for part, _ in parts), held
        if isinstance(value, dict):
            value.update(zip(value, (part for part, _ in parts), strict=True))
        else:
            value[:] = [part for part, _ in parts]
        return value, held


def read_admitted(path: Path, admitted: Mapping[tuple[str, str], Any]) -> Any:
    """What a pickle holds, packed by gzip or not.

    Args:
        admitted: what it may name, by module and name, and what it gets for that.
    Raises:
        DriveError: missing, cut short, too large, or naming anything else; nothing is run then.
    """
    try:
        with open_file(path) as file:
            packed = file.read(2) == b"\x1f\x8b"
            most = _most_of(os.fstat(file.fileno()).st_size) if packed else MOST_BYTES
            file.seek(0)
            content = _all_of(gzip.GzipFile(fileobj=file) if packed else file, most)
    except FileNotFoundError as error:
        raise DriveError("Not found", path=path, mend="download it again") from error
    except (OSError, EOFError, zlib.error) as error:
        raise DriveError(f"Cut short or damaged: {error}", path=path, mend="download it again") from error
    if len(content) > most:
        raise DriveError(f"unpacks to more than {most >> 20:,} MB", path=path, mend="download it again")
    return _unpickled(io.BytesIO(content), admitted, path)


def _most_of(packed: int) -> int:
    """Bytes that a file of so many packed ones may unpack to."""
    return min(MOST_BYTES, FIRST_BYTES + MOST_UNPACKED * packed)


def _all_of(stream: Any, most: int) -> bytearray:
    """What a stream holds, or just more than ``most`` bytes of it. Piece by piece: for one read of so many bytes, room for all of
    them is taken first."""
    held = bytearray()
    while len(held) <= most and (piece := stream.read(min(PIECE_BYTES, most + 1 - len(held)))):
        held += piece
    return held


def _unpickled(stream: io.BytesIO, admitted: Mapping[tuple[str, str], Any], path: Path) -> Any:
    counted = _made_bytes.set([0])
    try:
        return _Plain().of(_Restricted(stream, admitted).load())
    except MemoryError as error:
        raise DriveError("asks for more memory than there is", path=path, mend="download it again") from error
    except Exception as error:  # whatever a damaged or hostile pickle makes go wrong is that file's fault
        raise DriveError(f"Not a readable pickle: {error}", path=path, mend="download it again") from error
    finally:
        _made_bytes.reset(counted)


def read_arrays(path: Path) -> Any:
    """A pickle of dicts, lists, numbers, strings and NumPy arrays, packed by gzip or not.

    Raises:
        DriveError: missing, cut short, or naming anything else; nothing is run then.
    """
    return read_admitted(path, ARRAYS)


def read_archived_object(path: Path, name: str) -> Any:
    """The one object that an array of an .npz holds, which NumPy keeps there as a pickle; as :func:`read_arrays`.

    Raises:
        DriveError: missing, cut short, no such object, or naming anything else; nothing is run then.
    """
    try:
        with open_file(path) as file, zipfile.ZipFile(file) as packed:
            about = packed.getinfo(f"{name}.npy")
            if about.file_size > _most_of(about.compress_size):
                raise DriveError(f"unpacks to {about.file_size >> 20:,} MB", path=path, mend="download it again")
            stream = io.BytesIO(packed.read(f"{name}.npy"))
        version = np.lib.format.read_magic(stream)  # type: ignore[no-untyped-call]
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = header(stream)  # type: ignore[no-untyped-call]
    except KeyError as error:
        raise DriveError(f"lacks an array: {error.args[0]}", path=path, mend="make it again") from error
    except NO_ARCHIVE as error:
        raise DriveError(f"Not an archive of arrays: {error}", path=path, mend="make it again") from error
    if shape != () or not kind.hasobject:
        raise DriveError(f"Not an object: {name} holds an array of {shape} {kind}", path=path, mend="make it again")
    held = _unpickled(stream, ARRAYS, path)
    if not isinstance(held, np.ndarray) or held.shape != ():
        raise DriveError(f"Not an object: {name}", path=path, mend="make it again")
    return held.item()
