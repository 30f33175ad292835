"""Grow-only buffers, lent to one forward pass until its backward pass is done.

Page faults of fresh arrays cost more than the arithmetic on them. A pool keeps the buffers of finished passes; two live forward
passes get two sets.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike, NDArray

__all__ = ["Buffers", "borrow", "give_back"]


class Buffers:
    """Named arrays that grow and never shrink."""

    def __init__(self) -> None:
        self._arrays: dict[str, NDArray] = {}  # type: ignore[type-arg]

    def array(self, name: str, shape: tuple[int, ...], dtype: DTypeLike = np.float32) -> NDArray:  # type: ignore[type-arg]
        """An array of this shape; its contents are whatever was there."""
        size = int(np.prod(shape))
        held = self._arrays.get(name)
        if held is None or held.size < size or held.dtype != np.dtype(dtype):
            held = self._arrays[name] = np.empty(max(1, size + size // 5), dtype)
        return held[:size].reshape(shape)


_pool: list[Buffers] = []


def borrow() -> Buffers:
    """A set of buffers nobody uses."""
    return _pool.pop() if _pool else Buffers()


def give_back(buffers: Buffers) -> None:
    """Return a set; at most a few are kept."""
    if len(_pool) < 4 and not any(b is buffers for b in _pool):
        _pool.append(buffers)
