"""Memory that is used again: page faults of fresh arrays cost more than the arithmetic on them.

A forward pass borrows a set of named :class:`Buffers` until its backward pass is done; two live passes get two sets.
Arrays returned to callers (planes, gradients) come from :func:`lend`: their memory goes back to the pool when the last
reference to the array, or to a tensor made of it, is dropped. So a training step allocates nothing once it has run twice.
"""

from __future__ import annotations

import threading
import weakref
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

__all__ = ["POOL_SIZE", "Buffers", "borrow", "give_back", "lend"]

POOL_SIZE = 2
"""Sets kept for later; more live passes than this get fresh ones."""
CACHE_LINE = 64
LENT_KEPT = 48
"""Returned arrays kept for later."""
LENT_SLACK = 2.0
"""How much larger than needed a returned array may be."""


def _aligned(size: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """A flat array that begins at a cache line."""
    raw = np.empty(max(1, size) * dtype.itemsize + CACHE_LINE, np.uint8)
    start = -raw.ctypes.data % CACHE_LINE
    return raw[start : start + max(1, size) * dtype.itemsize].view(dtype)


class Buffers:
    """Named arrays that grow and never shrink."""

    def __init__(self) -> None:
        self._arrays: dict[str, NDArray[Any]] = {}

    def array(self, name: str, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """An array of this shape; its contents are whatever was there."""
        size = int(np.prod(shape))
        held = self._arrays.get(name)
        if held is None or held.size < size or held.dtype != np.dtype(dtype):
            held = self._arrays[name] = _aligned(size + size // 5, np.dtype(dtype))
        return held[:size].reshape(shape)

    def zeros(self, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """A float32 array of zeros that many may share: never write to it."""
        size = int(np.prod(shape))
        held = self._arrays.get("zeros")
        if held is None or held.size < size:
            held = self._arrays["zeros"] = np.zeros(max(1, size), np.float32)
        return held[:size].reshape(shape)


_pool: list[Buffers] = []


def borrow() -> Buffers:
    """A set of buffers nobody uses."""
    try:
        return _pool.pop()
    except IndexError:
        return Buffers()


def give_back(buffers: Buffers) -> None:
    """Return a set; the pool keeps a few and drops the rest."""
    if len(_pool) < POOL_SIZE:
        _pool.append(buffers)


class _Lender:
    """Flat byte arrays that are out, by the array that was handed over, and those that came back."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.returned: list[NDArray[np.uint8]] = []
        self.out: dict[int, weakref.ref[NDArray[Any]]] = {}
        self.fresh = 0

    def take(self, size: int) -> NDArray[np.uint8]:
        with self.lock:
            fitting = [k for k, a in enumerate(self.returned) if size <= a.size <= LENT_SLACK * size]
            if fitting:
                return self.returned.pop(min(fitting, key=lambda k: self.returned[k].size))
            self.fresh += 1
        return _aligned(size + size // 8, np.dtype(np.uint8))

    def hand_over(self, memory: NDArray[np.uint8], array: NDArray[Any]) -> None:
        key = id(memory)

        def came_back(_: weakref.ref[NDArray[Any]]) -> None:
            with self.lock:
                self.out.pop(key, None)
                self.returned.append(memory)
                if len(self.returned) > LENT_KEPT:
                    del self.returned[0]

        with self.lock:
            self.out[key] = weakref.ref(array, came_back)


_lender = _Lender()


def lend(shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray[Any]:
    """An array of this shape; its contents are whatever was there.

    Its memory is used again when the array is gone, and with it every view of it and every tensor made of it.
    """
    kind = np.dtype(dtype)
    size = int(np.prod(shape)) * kind.itemsize
    memory = _lender.take(size)
    # Over a memoryview, not over an array: views would otherwise hold on to the memory alone, and not to this array.
    array: NDArray[Any] = np.ndarray(shape, kind, buffer=memory.data)
    _lender.hand_over(memory, array)
    return array
