"""Grow-only buffers, lent to one forward pass until its backward pass is done.

Page faults of fresh arrays cost more than the arithmetic on them. A pool keeps the buffers of finished passes; two
live forward passes get two sets.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

__all__ = ["POOL_SIZE", "Buffers", "borrow", "give_back"]

POOL_SIZE = 2
"""Sets kept for later; more live passes than this get fresh ones."""


class Buffers:
    """Named arrays that grow and never shrink."""

    def __init__(self) -> None:
        self._arrays: dict[str, NDArray[Any]] = {}

    def array(self, name: str, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray[Any]:
        """An array of this shape; its contents are whatever was there."""
        size = int(np.prod(shape))
        held = self._arrays.get(name)
        if held is None or held.size < size or held.dtype != np.dtype(dtype):
            held = self._arrays[name] = np.empty(max(1, size + size // 5), dtype)
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
