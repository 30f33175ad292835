"""Reading pickles of datasets without running what a stranger put into them.

A pickle is a program: it may call anything that it names. Here it may name only what arrays and tables of numbers need, and for
pandas' tables, which are read without pandas, it gets stand-ins that keep what they are given. Everything else is refused before
anything is called.
"""

from __future__ import annotations

import gzip
import io
import pickle
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError

__all__ = ["read_archived_object", "read_arrays", "read_table"]

MOST_BYTES = 1 << 30
"""Of one unpacked file: hundred times a sweep's. A few bytes of gzip can stand for more than fits into memory."""


class _StandIn:
    """Keeps arguments and state of a pandas object that the pickle would make."""

    arguments: tuple[Any, ...]
    state: Any

    def __new__(cls, *arguments: Any) -> _StandIn:
        made = super().__new__(cls)
        made.arguments, made.state = arguments, None
        return made

    def __setstate__(self, state: Any) -> None:
        self.state = state


class _Frame(_StandIn):
    pass


class _Blocks(_StandIn):
    pass


class _Index(_StandIn):
    pass


class _RangeIndex(_StandIn):
    pass


class _Placed(_StandIn):
    pass


def _new_index(kind: type, options: Mapping[str, Any]) -> _StandIn:
    if kind not in (_Index, _RangeIndex):
        raise pickle.UnpicklingError("an index of an unknown kind")
    made = kind()
    made.state = dict(options)
    return made  # type: ignore[no-any-return]


def _unpickle_block(values: Any, place: Any, dimensions: int) -> _StandIn:
    return _Placed(values, place, dimensions)


def _array_globals() -> dict[tuple[str, str], Any]:
    made = np.array([1.0]).__reduce__()[0]
    scalar = np.float64(1.0).__reduce__()[0]
    found: dict[tuple[str, str], Any] = {
        ("numpy", "ndarray"): np.ndarray,
        ("numpy", "dtype"): np.dtype,
        ("_codecs", "encode"): _latin1,
        ("collections", "OrderedDict"): dict,
    }
    for package in ("numpy.core", "numpy._core"):
        found[f"{package}.multiarray", "_reconstruct"] = made
        found[f"{package}.multiarray", "scalar"] = scalar
        found[f"{package}.numeric", "_frombuffer"] = _from_buffer
    return found


def _latin1(text: str, encoding: str) -> bytes:
    """Bytes as protocol 2 writes them."""
    if encoding != "latin1":
        raise pickle.UnpicklingError(f"text in {encoding}")
    return text.encode("latin1")


def _from_buffer(buffer: Any, dtype: Any, shape: Any, order: str) -> NDArray[Any]:
    return np.frombuffer(buffer, dtype=dtype).reshape(shape, order="F" if order == "F" else "C")


_ARRAYS = _array_globals()
_TABLES: dict[tuple[str, str], Any] = {
    **_ARRAYS,
    ("pandas.core.frame", "DataFrame"): _Frame,
    ("pandas.core.internals.managers", "BlockManager"): _Blocks,
    ("pandas.core.internals", "BlockManager"): _Blocks,
    ("pandas.core.indexes.base", "_new_Index"): _new_index,
    ("pandas.core.indexes.base", "Index"): _Index,
    ("pandas.core.indexes.range", "RangeIndex"): _RangeIndex,
    ("pandas.core.indexes.numeric", "Int64Index"): _Index,
    ("pandas._libs.internals", "_unpickle_block"): _unpickle_block,
    ("builtins", "slice"): slice,
}


class _Restricted(pickle.Unpickler):
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


def _load(path: Path, admitted: Mapping[tuple[str, str], Any]) -> Any:
    try:
        with path.open("rb") as stream:
            packed = stream.read(2) == b"\x1f\x8b"
        with gzip.open(path) if packed else path.open("rb") as stream:
            content = stream.read(MOST_BYTES + 1)
    except FileNotFoundError as error:
        raise DriveError("there is no such file", path=path, mend="download it again") from error
    except (OSError, EOFError, zlib.error) as error:
        raise DriveError(f"is cut short or damaged: {error}", path=path, mend="download it again") from error
    if len(content) > MOST_BYTES:
        raise DriveError("unpacks to more than a gigabyte", path=path, mend="this is no file of the dataset")
    return _unpickled(io.BytesIO(content), admitted, path)


def _unpickled(stream: io.BytesIO, admitted: Mapping[tuple[str, str], Any], path: Path) -> Any:
    try:
        return _Restricted(stream, admitted).load()
    except MemoryError as error:
        raise DriveError("asks for more memory than there is", path=path, mend="download it again") from error
    except Exception as error:  # whatever a damaged or hostile pickle makes go wrong is that file's fault
        raise DriveError(f"is no pickle that can be read: {error}", path=path, mend="download it again") from error


def read_arrays(path: Path) -> Any:
    """A pickle of dicts, lists, numbers, strings and NumPy arrays, packed by gzip or not.

    Raises:
        DriveError: missing, cut short, or naming anything else; nothing is run then.
    """
    return _load(path, _ARRAYS)


def read_archived_object(path: Path, name: str) -> Any:
    """The one object that an array of an .npz holds, which NumPy keeps there as a pickle; as :func:`read_arrays`.

    Raises:
        DriveError: missing, cut short, no such object, or naming anything else; nothing is run then.
    """
    try:
        with zipfile.ZipFile(path) as packed:
            if packed.getinfo(f"{name}.npy").file_size > MOST_BYTES:
                raise DriveError("unpacks to more than a gigabyte", path=path, mend="this is no file of the dataset")
            stream = io.BytesIO(packed.read(f"{name}.npy"))
        version = np.lib.format.read_magic(stream)  # type: ignore[no-untyped-call]
        header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = header(stream)  # type: ignore[no-untyped-call]
    except KeyError as error:
        raise DriveError(f"lacks an array: {error.args[0]}", path=path, mend="make it again") from error
    except (OSError, EOFError, ValueError, zipfile.BadZipFile, zlib.error) as error:
        raise DriveError(f"is no archive of arrays: {error}", path=path, mend="make it again") from error
    if shape != () or not kind.hasobject:
        raise DriveError(f"{name} is an array of {shape} {kind}, no object", path=path, mend="make it again")
    held = _unpickled(stream, _ARRAYS, path)
    if not isinstance(held, np.ndarray) or held.shape != ():
        raise DriveError(f"{name} is no object", path=path, mend="make it again")
    return held.item()


def read_table(path: Path) -> dict[str, NDArray[Any]]:
    """The columns of a pandas DataFrame, (N,) each, without pandas.

    Raises:
        DriveError: missing, cut short, no such table, or naming anything else; nothing is run then.
    """
    frame = _load(path, _TABLES)
    try:
        return _columns(frame)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise DriveError(f"is no table of pandas: {error}", path=path, mend="download it again") from error


def _columns(frame: Any) -> dict[str, NDArray[Any]]:
    if not isinstance(frame, _Frame):
        raise ValueError(f"it holds a {type(frame).__name__}")
    state = frame.state
    manager = state["_mgr" if "_mgr" in state else "_data"] if isinstance(state, dict) else state
    if manager.arguments:  # pandas 1.3 and later give blocks and axes at once
        blocks, axes = manager.arguments
        pairs = [(np.asarray(b.arguments[0]), b.arguments[1]) for b in blocks]
        names = axes[0]
    else:
        parts = manager.state[3]["0.14.1"]
        pairs = [(np.asarray(b["values"]), b["mgr_locs"]) for b in parts["blocks"]]
        names = parts["axes"][0]
    labels = [str(n) for n in np.asarray(names.state["data"]).ravel()]
    found: dict[str, NDArray[Any]] = {}
    for values, place in pairs:
        rows = np.atleast_2d(values)
        for row, k in zip(rows, np.arange(len(labels))[place], strict=True):
            found[labels[int(k)]] = row
    if set(found) != set(labels):
        raise ValueError("columns are missing")
    return {name: found[name] for name in labels}
