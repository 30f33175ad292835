"""Looks at what a caller gives: are all numbers finite, and which labels are there? By bits, as fast math forgets NaN."""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import FAST

__all__ = ["CHUNK", "WORTH", "count_not_finite", "label_ends"]

u64 = np.uint64
CHUNK = 8192
"""Numbers that are looked at together."""
WORTH = 32
"""Chunks that are worth a thread: fewer are looked at sooner than one wakes up."""


@njit(**FAST)
def count_not_finite(first, end, bits, bad):
    """How many of some float32 numbers, given by their bits, are NaN or infinite (fast math forgets NaN); ``bad`` gets
    the count of each chunk of ``CHUNK``."""
    for chunk in range(first // CHUNK, (end + CHUNK - 1) // CHUNK):
        here = np.uint32(0)
        for i in range(u64(chunk * CHUNK), u64(min(bits.size, (chunk + 1) * CHUNK))):
            here += np.uint32((bits[i] & np.uint32(0x7F800000)) == np.uint32(0x7F800000))
        bad[chunk] = here


@njit(**FAST)
def label_ends(first, end, labels, ends):
    """Least and greatest label of each chunk of ``CHUNK``, as the columns of ``ends``."""
    for chunk in range(first // CHUNK, (end + CHUNK - 1) // CHUNK):
        low = high = labels[chunk * CHUNK]
        for i in range(u64(chunk * CHUNK), u64(min(labels.size, (chunk + 1) * CHUNK))):
            low, high = min(low, labels[i]), max(high, labels[i])
        ends[chunk, 0], ends[chunk, 1] = low, high
