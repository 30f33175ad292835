"""Who belongs to which number."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.semantics.members import Members


@given(st.lists(st.integers(0, 6), max_size=40))
def test_members_are_those_that_comparing_finds(numbers: list[int]) -> None:
    array = np.array(numbers, dtype=np.int64)
    members = Members(array)
    for number in range(1, 8):
        assert np.array_equal(members[number], np.flatnonzero(array == number))
