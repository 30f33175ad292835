"""Slots of a hash table: keys that differ in any of their bits lie apart."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.base.kernels.hashing import slot_of


@pytest.mark.parametrize("shift", [0, 10, 21, 42, 50])
def test_keys_in_a_row_spread_over_the_table(shift: int) -> None:
    """A street along one axis: its packed coordinates differ in a few bits only, wherever these are."""
    slots = [slot_of((1 << 62) + (k << shift) & ((1 << 63) - 1), 4096) for k in range(1024)]
    assert all(0 <= s < 4096 for s in slots)
    # Thrown at random, 1024 balls hit 905 of 4096 boxes.
    assert len(set(slots)) > 850


def test_negative_keys_have_slots_too() -> None:
    assert 0 <= slot_of(np.int64(-5), 64) < 64
