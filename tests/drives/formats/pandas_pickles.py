"""Tables as pandas pickles them, written without pandas: its classes are named, and their arguments and states are its own.

Facts: pandas 1.0 (``DataFrame._data``, a block manager with a state), 1.5 and 2.2 (``_mgr``, blocks made by ``_unpickle_block``).
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Mapping, Sequence
from types import FunctionType
from typing import Any

import numpy as np

__all__ = ["table_pickle"]


class _Global:
    """A class or function of pandas, as a pickle names it."""

    def __init__(self, module: str, name: str) -> None:
        self.module, self.name = module, name

    def __call__(self, *arguments: object) -> object:
        raise TypeError("only a name")


class _Made:
    """An object that a pickle makes: by a call, or by ``__new__`` with a state."""

    def __init__(
        self, made_by: _Global, arguments: tuple[object, ...], state: object = None, new: bool = False
    ) -> None:
        self.made_by, self.arguments, self.state, self.new = made_by, arguments, state, new


class _Writer(pickle._Pickler):
    """Python's own pickler, that also writes the two above."""

    dispatch: dict[type, Any] = dict(pickle._Pickler.dispatch)  # type: ignore[attr-defined]

    def save_named(self, thing: _Global) -> None:
        if self.proto >= 4:  # type: ignore[attr-defined]
            self.save(thing.module)  # type: ignore[attr-defined]
            self.save(thing.name)  # type: ignore[attr-defined]
            self.write(pickle.STACK_GLOBAL)  # type: ignore[attr-defined]
        else:
            self.write(pickle.GLOBAL + f"{thing.module}\n{thing.name}\n".encode())  # type: ignore[attr-defined]
        self.memoize(thing)  # type: ignore[attr-defined]

    def save_made(self, thing: _Made) -> None:
        self.save(thing.made_by)  # type: ignore[attr-defined]
        self.save(thing.arguments)  # type: ignore[attr-defined]
        self.write(pickle.NEWOBJ if thing.new else pickle.REDUCE)  # type: ignore[attr-defined]
        self.memoize(thing)  # type: ignore[attr-defined]
        if thing.state is not None:
            self.save(thing.state)  # type: ignore[attr-defined]
            self.write(pickle.BUILD)  # type: ignore[attr-defined]

    dispatch[_Global] = save_named
    dispatch[_Made] = save_made
    dispatch[FunctionType] = pickle._Pickler.save_global  # type: ignore[attr-defined]


FRAME = _Global("pandas.core.frame", "DataFrame")
BLOCKS = _Global("pandas.core.internals.managers", "BlockManager")
BLOCK = _Global("pandas._libs.internals", "_unpickle_block")
NEW_INDEX = _Global("pandas.core.indexes.base", "_new_Index")
INDEX = _Global("pandas.core.indexes.base", "Index")
RANGE = _Global("pandas.core.indexes.range", "RangeIndex")
INTEGERS = _Global("pandas.core.indexes.numeric", "Int64Index")


def table_pickle(
    columns: Mapping[str, np.ndarray],
    *,
    release: str = "1.5",
    protocol: int = 4,
    placed: Mapping[str, Sequence[int]] | None = None,
) -> bytes:
    """A DataFrame of columns (N,), those of one type in one block.

    Args:
        release: of pandas, "1.0", "1.5" or "2.x".
        placed: places of columns in the table, where they are to be others than their own.
    """
    names = list(columns)
    count = len(next(iter(columns.values())))
    kinds: dict[np.dtype, list[str]] = {}
    for name, values in columns.items():
        kinds.setdefault(values.dtype, []).append(name)
    parts = []
    for held in kinds.values():
        place = np.array([i for n in held for i in ([names.index(n)] if placed is None else placed[n])])
        steps = set(np.diff(place).tolist())
        even = len(place) == 1 or (len(steps) == 1 and min(steps) > 0)
        at = slice(int(place[0]), int(place[-1]) + 1, next(iter(steps), 1)) if even else place
        parts.append((np.stack([columns[n] for n in held]), at))
    head = _Made(NEW_INDEX, (INDEX, {"data": np.array(names, dtype=object), "name": None}))
    if release == "1.0":
        rows = _Made(NEW_INDEX, (INTEGERS, {"data": np.arange(count), "name": None}))
        blocks = [{"values": v, "mgr_locs": at} for v, at in parts]
        axes = [head, rows]
        old = (axes, [v for v, _ in parts], [head for _ in parts], {"0.14.1": {"axes": axes, "blocks": blocks}})
        state: dict[str, object] = {"_data": _Made(BLOCKS, (), old, new=True), "_typ": "dataframe", "_metadata": []}
    else:
        rows = _Made(NEW_INDEX, (RANGE, {"name": None, "start": 0, "stop": count, "step": 1}))
        blocks_made = tuple(_Made(BLOCK, (v, at, 2)) for v, at in parts)
        state = {"_mgr": _Made(BLOCKS, (blocks_made, [head, rows])), "_typ": "dataframe", "_metadata": []}
        if release == "2.x":
            state |= {"attrs": {}, "_flags": {"allows_duplicate_labels": True}}
    stream = io.BytesIO()
    _Writer(stream, protocol).dump(_Made(FRAME, (), state, new=True))
    return stream.getvalue()
