"""Pictures by frame that are made when they are asked for, and held as long as there is room.

A drive may have thousands of frames, so no stage holds all of their pictures. It asks for them by index, as if it had a list;
what was used last stays in memory, up to a number of bytes, and the rest is read or computed again. What takes long to compute is
written to disk once instead. Results never depend on how much is held.
"""

from __future__ import annotations

import dataclasses
import itertools
import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Generic, TypeVar

from numpy.typing import NDArray

from unveil_core.base.parallel import works_alone
from unveil_core.base.resume.checkpoint import Kept

__all__ = ["DEFAULT_BYTES", "FrameCache", "Frames", "nbytes_of", "subset"]

T = TypeVar("T")
DEFAULT_BYTES = 1 << 30
"""Room where the caller does not say how much there is: a dozen frames of 1920x1280 with all that training asks of them."""


def nbytes_of(value: object) -> int:
    """Bytes of the arrays and tensors in a value, of its fields if it is a dataclass, of its elements if it is a tuple."""
    size = getattr(value, "nbytes", None)
    if isinstance(size, int):
        return size
    if isinstance(value, tuple | list):
        return sum(nbytes_of(v) for v in value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return sum(nbytes_of(getattr(value, f.name)) for f in dataclasses.fields(value))
    return 0


class Frames(Sequence[T], Generic[T]):
    """One value per frame, made by a function of the frame's index. Never write to the arrays: they are handed out again."""

    def __init__(self, count: int, make: Callable[[int], T]) -> None:
        self._count, self._make = count, make

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            chosen = range(self._count)[index]
            return Frames(len(chosen), lambda k: self[chosen[k]])
        return self._get(range(self._count)[index])

    def __iter__(self) -> Iterator[T]:
        return (self._get(i) for i in range(self._count))

    def _get(self, index: int) -> T:
        return self._make(index)


def subset(values: Sequence[T], frames: Sequence[int]) -> Frames[T]:
    """The values of some frames only, in their order."""
    return Frames(len(frames), lambda k: values[frames[k]])


class _Held(Frames[T]):
    """Frames whose values stay in a cache for a while."""

    def __init__(self, cache: FrameCache, count: int, make: Callable[[int], T]) -> None:
        super().__init__(count, make)
        self._cache = cache
        self._key = next(cache.keys)
        weakref.finalize(self, cache.forget, self._key)

    def _get(self, index: int) -> T:
        return self._cache.get((self._key, index), self._make)


class FrameCache:
    """Room for values by frame; those that were used last stay.

    Args:
        most: bytes.
    """

    def __init__(self, most: int = DEFAULT_BYTES) -> None:
        self.most = most
        self.keys = itertools.count()
        self._held: OrderedDict[tuple[int, int], tuple[Any, int]] = OrderedDict()
        self._bytes = 0
        self._lock = threading.RLock()
        self._made: dict[tuple[int, int], threading.Lock] = {}

    @property
    def nbytes(self) -> int:
        """Bytes that are held."""
        return self._bytes

    def frames(self, count: int, make: Callable[[int], T]) -> Sequence[T]:
        """Values of ``count`` frames.

        Args:
            make: gives the value of frame i, the same at each call.
        """
        return _Held(self, count, make)

    def stored(
        self, folder: Path, count: int, make: Callable[[int], tuple[NDArray[Any], ...]]
    ) -> Sequence[tuple[NDArray[Any], ...]]:
        """Tuples of arrays of ``count`` frames that are computed once, and read from files from then on.

        Args:
            folder: where the files go; made, and the caller's to remove.
            make: gives the arrays of frame i.
        """
        kept = Kept(folder)

        def get(index: int) -> tuple[NDArray[Any], ...]:
            found = kept.once(str(index), lambda: {str(k): array for k, array in enumerate(make(index))})
            return tuple(found[str(k)] for k in range(len(found)))

        return self.frames(count, get)

    def get(self, key: tuple[int, int], make: Callable[[int], T]) -> T:
        """The held value of a key, or that of ``make``, which is held from now on."""
        if not works_alone():  # what it makes may wait for threads that wait for it
            return self._get(key, make)
        with self._lock:
            mine = self._made.setdefault(key, threading.Lock())
        with mine:  # of threads that ask for one value at once one makes it
            try:
                return self._get(key, make)
            finally:
                with self._lock:
                    self._made.pop(key, None)

    def _get(self, key: tuple[int, int], make: Callable[[int], T]) -> T:
        with self._lock:
            if key in self._held:
                self._held.move_to_end(key)
                value: T = self._held[key][0]
                return value
        value = make(key[1])
        size = nbytes_of(value)
        with self._lock:
            if key not in self._held:
                self._held[key] = (value, size)
                self._bytes += size
            # At least one value stays, however little room there is: it was asked for just now.
            while self._bytes > self.most and len(self._held) > 1:
                _, (_, dropped) = self._held.popitem(last=False)
                self._bytes -= dropped
        return value

    def forget(self, sequence: int) -> None:
        """Drop the values of a sequence that is gone."""
        with self._lock:
            for key in [k for k in self._held if k[0] == sequence]:
                self._bytes -= self._held.pop(key)[1]
