"""Reading pickles of datasets without running what a stranger put into them.

A pickle is a program: it may call anything that it names. Here it may name only what arrays and tables of numbers need, and
gets stand-ins for all of these, which keep what they are given; everything else is refused before anything is called. NumPy's
own types are no exception: their ``__setstate__`` takes a stranger's word for how wide a number is and whether it is a pointer.
Arrays are made of what the stand-ins hold, once it was checked. Python's own unpickler is used, not the one in C, which makes
room for whatever a pickle announces.
"""

from __future__ import annotations

import gzip
import io
import math
import pickle
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping
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
PIECE_BYTES = 1 << 20
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


def _array_of(content: Any, dtype: np.dtype[Any], shape: tuple[int, ...], order: Any) -> NDArray[Any]:
    """An array that owns its content: bytes of numbers, or a list of objects. Both must be as many as the shape says."""
    count = math.prod(shape)
    wanted, unit = (list, 1) if dtype.hasobject else (bytes | bytearray, dtype.itemsize)
    if min(shape, default=0) < 0 or not isinstance(content, wanted) or len(content) != count * unit:  # type: ignore[arg-type]
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
        raise pickle.UnpicklingError(f"text in {encoding}")
    return text.encode("latin1")


def _no_bytes() -> bytes:
    """The same, where there are none."""
    return b""


ARRAYS: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): _Array,
    ("numpy", "dtype"): _Kind,
    ("_codecs", "encode"): _latin1,
    ("__builtin__", "bytes"): _no_bytes,
    ("collections", "OrderedDict"): dict,
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
        self.admitted = admitted

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

    dispatch[pickle.BUILD[0]] = load_build
    dispatch[pickle.BYTEARRAY8[0]] = load_bytearray8


def _plain(value: Any, done: dict[int, tuple[Any, Any]]) -> Any:
    """A value with the arrays that its stand-ins stand for, however deep. ``done`` has what was seen before, by identity."""
    if id(value) in done:
        return done[id(value)][1]
    if isinstance(value, tuple):
        made: Any = tuple(_plain(v, done) for v in value)
        done[id(value)] = value, made
        return made
    if isinstance(value, _Array):
        made = value.made()
        done[id(value)] = value, made
        if made.dtype.hasobject:
            for i, held in enumerate(made.flat):
                made.flat[i] = _plain(held, done)
        return made
    done[id(value)] = value, value
    if isinstance(value, list):
        value[:] = [_plain(v, done) for v in value]
    elif isinstance(value, dict):
        for key in value:
            value[key] = _plain(value[key], done)
    elif isinstance(value, StandIn) and not isinstance(value, _Kind):
        value.arguments, value.state = _plain(value.arguments, done), _plain(value.state, done)
    return value


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
            file.seek(0)
            content = _all_of(gzip.GzipFile(fileobj=file) if packed else file)
    except FileNotFoundError as error:
        raise DriveError("there is no such file", path=path, mend="download it again") from error
    except (OSError, EOFError, zlib.error) as error:
        raise DriveError(f"is cut short or damaged: {error}", path=path, mend="download it again") from error
    if len(content) > MOST_BYTES:
        raise DriveError("unpacks to more than a gigabyte", path=path, mend="this is no file of the dataset")
    return _unpickled(io.BytesIO(content), admitted, path)


def _all_of(stream: Any) -> bytes:
    """What a stream holds, or just more than :data:`MOST_BYTES` of it. Piece by piece: for one read of so many bytes, room for
    all of them is taken first."""
    pieces, size = list[bytes](), 0
    while size <= MOST_BYTES and (piece := stream.read(min(PIECE_BYTES, MOST_BYTES + 1 - size))):
        pieces.append(piece)
        size += len(piece)
    return b"".join(pieces)


def _unpickled(stream: io.BytesIO, admitted: Mapping[tuple[str, str], Any], path: Path) -> Any:
    try:
        return _plain(_Restricted(stream, admitted).load(), {})
    except MemoryError as error:
        raise DriveError("asks for more memory than there is", path=path, mend="download it again") from error
    except Exception as error:  # whatever a damaged or hostile pickle makes go wrong is that file's fault
        raise DriveError(f"is no pickle that can be read: {error}", path=path, mend="download it again") from error


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
            if packed.getinfo(f"{name}.npy").file_size > MOST_BYTES:
                raise DriveError("unpacks to more than a gigabyte", path=path, mend="this is no file of the dataset")
            stream = io.BytesIO(packed.read(f"{name}.npy"))
        version = np.lib.format.read_magic(stream)  # type: ignore[no-untyped-call]
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = header(stream)  # type: ignore[no-untyped-call]
    except KeyError as error:
        raise DriveError(f"lacks an array: {error.args[0]}", path=path, mend="make it again") from error
    except NO_ARCHIVE as error:
        raise DriveError(f"is no archive of arrays: {error}", path=path, mend="make it again") from error
    if shape != () or not kind.hasobject:
        raise DriveError(f"{name} is an array of {shape} {kind}, no object", path=path, mend="make it again")
    held = _unpickled(stream, ARRAYS, path)
    if not isinstance(held, np.ndarray) or held.shape != ():
        raise DriveError(f"{name} is no object", path=path, mend="make it again")
    return held.item()
