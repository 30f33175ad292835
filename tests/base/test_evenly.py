"""Some of many are chosen from the first to the last."""

from __future__ import annotations

import pytest

from unveil_core.base.evenly import evenly


@pytest.mark.parametrize(
    ("count", "most", "found"),
    [(0, 3, []), (1, 3, [0]), (3, 3, [0, 1, 2]), (5, 3, [0, 2, 4]), (101, 3, [0, 50, 100]), (4, 9, [0, 1, 2, 3])],
)
def test_as_many_as_asked_for_with_the_first_and_the_last(count: int, most: int, found: list[int]) -> None:
    assert evenly(count, most) == found
