"""Tables that pandas pickled, read without pandas: as release 1.0 writes them, and those since 1.3."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.drives.formats.safe_pickle import ARRAYS, StandIn, read_admitted

__all__ = ["read_table"]

PLAIN = (str, bytes, bool, int, float, np.generic, type(None))
"""What a cell of a table may be."""


class _Frame(StandIn):
    pass


class _Blocks(StandIn):
    pass


class _Index(StandIn):
    pass


class _RangeIndex(StandIn):
    pass


class _Placed(StandIn):
    pass


def _new_index(kind: type, options: Mapping[str, Any]) -> StandIn:
    if kind not in (_Index, _RangeIndex):
        raise pickle.UnpicklingError("an index of an unknown kind")
    if not isinstance(options, dict):
        raise pickle.UnpicklingError("an index without its options")
    made = kind()
    made.state = dict(options)
    return made  # type: ignore[no-any-return]


def _unpickle_block(values: Any, place: Any, dimensions: int) -> StandIn:
    return _Placed(values, place, dimensions)


_TABLES: dict[tuple[str, str], Any] = {
    **ARRAYS,
    ("pandas.core.frame", "DataFrame"): _Frame,
    ("pandas.core.internals.managers", "BlockManager"): _Blocks,
    ("pandas.core.internals", "BlockManager"): _Blocks,
    ("pandas.core.indexes.base", "_new_Index"): _new_index,
    ("pandas.core.indexes.base", "Index"): _Index,
    ("pandas.core.indexes.range", "RangeIndex"): _RangeIndex,
    ("pandas.core.indexes.numeric", "Int64Index"): _Index,
    ("pandas._libs.internals", "_unpickle_block"): _unpickle_block,
    ("builtins", "slice"): slice,
    ("__builtin__", "slice"): slice,
}


def read_table(path: Path) -> dict[str, NDArray[Any]]:
    """The columns of a pandas DataFrame, (N,) each, without pandas.

    Raises:
        DriveError: missing, cut short, no such table, or naming anything else; nothing is run then.
    """
    frame = read_admitted(path, _TABLES)
    try:
        return _columns(frame)
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise DriveError(f"Not a table of pandas: {error}", path=path, mend="download it again") from error


def _columns(frame: Any) -> dict[str, NDArray[Any]]:
    if not isinstance(frame, _Frame):
        raise ValueError(f"it holds a {type(frame).__name__}")
    state = frame.state
    manager = state["_mgr" if "_mgr" in state else "_data"] if isinstance(state, dict) else state
    if manager.arguments:  # pandas 1.3 and later give blocks and axes at once
        blocks, axes = manager.arguments
        pairs = [(_array(b.arguments[0]), b.arguments[1]) for b in blocks]
        names = axes[0]
    else:
        parts = manager.state[3]["0.14.1"]
        pairs = [(_array(b["values"]), b["mgr_locs"]) for b in parts["blocks"]]
        names = parts["axes"][0]
    labels = list(names.state["data"])
    if not all(isinstance(n, str) for n in labels):
        raise ValueError("columns without a name")
    found: dict[str, NDArray[Any]] = {}
    for values, place in pairs:
        if not isinstance(place, slice | np.ndarray):
            raise ValueError("a block without its place")
        rows = np.atleast_2d(values)
        for row, k in zip(rows, np.arange(len(labels))[place], strict=True):
            if row.dtype.hasobject and not all(isinstance(v, PLAIN) for v in row):
                raise ValueError(f"column {labels[int(k)]} holds neither texts nor numbers")
            found[labels[int(k)]] = row
    if set(found) != set(labels):
        raise ValueError("columns are missing")
    return {name: found[name] for name in labels}


def _array(values: Any) -> NDArray[Any]:
    if not isinstance(values, np.ndarray):
        raise ValueError("a block without an array")
    return values
