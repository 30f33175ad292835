"""Where a number goes in a hash table, for compiled code."""

# mypy: disable-error-code="no-untyped-def"
from __future__ import annotations

import numpy as np

from unveil_core.base.kernels.compiled import njit

__all__ = ["slot_of"]


@njit(cache=True, inline="always")
def slot_of(key, size):
    """Slot of a 64-bit number in a table whose ``size`` is a power of two.

    The finalizer of MurmurHash3 (Appleby 2011): every bit of the key reaches every bit of the slot. Numbers packed from coordinates
    need that, for what lies in a row along one axis differs in few bits, high or low.
    """
    mixed = np.uint64(key)
    mixed = (mixed ^ (mixed >> np.uint64(33))) * np.uint64(0xFF51AFD7ED558CCD)
    mixed = (mixed ^ (mixed >> np.uint64(33))) * np.uint64(0xC4CEB9FE1A85EC53)
    return np.int64((mixed ^ (mixed >> np.uint64(33))) & np.uint64(size - 1))
