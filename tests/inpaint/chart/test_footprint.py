"""What removed objects stand on."""

from __future__ import annotations

import numpy as np
import pytest

from tests.inpaint.sunny_street import TEXEL, sunny_chart
from unveil_core.inpaint.chart.footprint import footprint_of
from unveil_core.inpaint.chart.street_chart import OBSERVED, OUTSIDE


@pytest.mark.parametrize("length", [4.5, 18.0])
def test_an_object_stands_on_its_whole_floor(length: float) -> None:
    """A lorry as a car: of its sides alone, seen up to 2 m, with strays far off."""
    chart = sunny_chart(None)[0]
    x, z = (g.ravel() for g in np.meshgrid(np.arange(2, 2 + length, 0.08), np.arange(0.1, 2, 0.1)))
    sides = [np.column_stack([x, np.full(x.size, y), z]) for y in (-3.5, -1.5)]
    ends = [
        np.column_stack([np.full(26, end), np.linspace(-3.5, -1.5, 26), np.full(26, 1.0)]) for end in (2, 2 + length)
    ]
    strays = np.array([[1.0, 5.0, 0.5], [25.0, 6.0, 0.5]])
    found = footprint_of(chart, [np.concatenate([*sides, *ends, strays])])
    area = found.sum() * TEXEL**2
    assert abs(area / (length * 2.0) - 1) < 0.06
    row, column, _ = chart.index_of(np.array([[2 + length / 2, -2.5, 0.0]]))
    assert found[row, column].all()


def test_ground_seen_between_two_cars_that_pass_for_one_is_street() -> None:
    chart = sunny_chart(None)[0]
    x, y = (g.ravel() for g in np.meshgrid(np.arange(0, 4, 0.08), np.arange(-3.5, -1.7, 0.08)))
    car = np.column_stack([x, y, np.full(x.size, 1.0)])
    both = np.concatenate([car + (3, 0, 0), car + (8.2, 0, 0)])
    row, column, _ = chart.index_of(np.array([[5.0, -2.6, 0.0], [7.6, -2.6, 0.0], [10.0, -2.6, 0.0]]))
    chart.source[row[1] - 20 : row[1] + 21] = OBSERVED
    assert footprint_of(chart, [both])[row, column].tolist() == [True, False, True]
    chart.source[row[1] - 20 : row[1] + 21] = OUTSIDE
    assert footprint_of(chart, [both])[row, column].all(), "nobody saw that there is a gap"
