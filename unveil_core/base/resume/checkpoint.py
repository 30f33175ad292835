"""What long work computes, kept on disk so that the same work, begun again, need not compute it again.

Plain NumPy files without pickled objects, written under another name and renamed: a file is there whole or not at all.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.array_headers import open_npz
from unveil_core.base.disk.new_files import new_file
from unveil_core.base.files import NO_ARCHIVE, move

__all__ = ["EVERY_S", "FACTS", "Checkpoint", "Kept", "facts_array", "facts_of", "read_arrays", "write_arrays"]

EVERY_S = 120.0
"""Seconds between two checkpoints: at most so much work is lost."""
FACTS = "facts"


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays by name; the folder is made if need be. Not forced to the disk as results are: a lost file is computed again."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, new = new_file(path.parent, f".{path.name}.", ".new")
    try:
        with os.fdopen(handle, "wb") as stream:
            np.savez(stream, **arrays)  # type: ignore[arg-type]
        move(new, path)
    finally:
        new.unlink(missing_ok=True)


def read_arrays(path: Path) -> dict[str, NDArray[Any]] | None:
    """What :func:`write_arrays` wrote; None where it is missing or damaged, as a power cut leaves it, or packed by somebody."""
    try:
        with open_npz(path, most_bytes=path.stat().st_size) as data:
            return dict(data)
    except NO_ARCHIVE:
        return None


def facts_array(facts: Any) -> NDArray[np.uint8]:
    """What JSON can hold, numbers of NumPy among it, as an array beside others."""
    return np.frombuffer(json.dumps(facts, default=lambda number: number.item()).encode(), np.uint8)


def facts_of(array: NDArray[Any]) -> Any:
    """Inverse of :func:`facts_array`."""
    try:
        return json.loads(array.tobytes())  # states of generators are whole numbers of 128 bits
    except RecursionError:
        raise ValueError("it holds too many lists or objects within one another") from None


class Kept:
    """Results by name, each computed once.

    Args:
        folder: where they lie; None = nowhere, everything is computed.
        every_s: seconds between two checkpoints of a computation, :data:`EVERY_S` by default.
    """

    def __init__(self, folder: Path | None = None, every_s: float | None = None) -> None:
        self.folder, self.every_s = folder, EVERY_S if every_s is None else every_s

    def once(self, name: str, make: Callable[[], Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
        """The arrays of ``make``: computed if they are not there yet."""
        path = None if self.folder is None else self.folder / f"{name}.npz"
        found = None if path is None else read_arrays(path)
        if found is None:
            found = dict(make())
            if path is not None:
                write_arrays(path, found)
        return found

    def has(self, name: str) -> bool:
        """Whether there is a file of that name, which may be damaged."""
        return self.folder is not None and (self.folder / f"{name}.npz").is_file()

    def within(self, name: str) -> Kept:
        """Results under a name of their own."""
        return Kept(None if self.folder is None else self.folder / name, self.every_s)

    def checkpoint(self, name: str) -> Checkpoint:
        """The state of a computation that takes long."""
        return Checkpoint(None if self.folder is None else self.folder / f"{name}.npz", self.every_s)


class Checkpoint:
    """The state of a computation, saved now and then.

    Args:
        path: of the file; None = nowhere.
        every_s: seconds between two saves.
    """

    def __init__(self, path: Path | None = None, every_s: float = EVERY_S) -> None:
        self.path, self.every_s = path, every_s
        self._last = time.monotonic()

    def due(self) -> bool:
        """Whether it is time to save."""
        return self.path is not None and time.monotonic() - self._last >= self.every_s

    def save(self, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> None:
        """Save arrays, and facts that JSON can hold."""
        if self.path is not None:
            write_arrays(self.path, {**arrays, FACTS: facts_array(facts)})
        self._last = time.monotonic()

    def load(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]] | None:
        """What was saved last, None where nothing was."""
        arrays = None if self.path is None else read_arrays(self.path)
        if arrays is None or FACTS not in arrays:
            return None
        try:
            facts = facts_of(arrays.pop(FACTS))
        except ValueError:
            return None
        return (arrays, facts) if isinstance(facts, dict) else None
