"""Holes are planted where the street was seen, and tell how well it was filled there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.inpaint.chart.test_chart import chart, coordinates, in_car, street  # noqa: F401
from unveil_core.inpaint.chart.planted import plant_holes
from unveil_core.inpaint.chart.street_chart import INVENTED, OBSERVED, OUTSIDE, StreetChart
from unveil_core.inpaint.fill.chart_fill import fill_chart


@pytest.fixture(name="footprint")
def _footprint(chart: StreetChart) -> np.ndarray:  # noqa: F811
    return in_car(*coordinates(chart))


def test_a_hole_is_as_large_as_the_object_and_lies_on_seen_street(chart: StreetChart, footprint: np.ndarray) -> None:  # noqa: F811
    holes = plant_holes(chart, footprint)
    assert holes.count >= 1
    inside = holes.number > 0
    assert (chart.source[inside] == OBSERVED).mean() > 0.95 and (holes.chart.source[inside] == OUTSIDE).all()
    assert np.isinf(holes.chart.nearest[inside]).all() and not (inside & footprint).any()
    assert inside.sum() >= holes.count * footprint.sum()
    np.testing.assert_array_equal(holes.chart.color[~inside], chart.color[~inside])
    assert (holes.footprint & ~footprint).sum() >= holes.count * footprint.sum() * 0.9


def test_a_better_fill_has_smaller_errors(chart: StreetChart, footprint: np.ndarray) -> None:  # noqa: F811
    holes = plant_holes(chart, footprint)
    filled = fill_chart(holes.chart, holes.footprint)
    inside = holes.number > 0
    grey = replace(filled, color=np.where(inside[..., None], np.float32(0.2), filled.color))
    good, bad = holes.errors(chart, filled), holes.errors(chart, grey)
    assert good.shape == (holes.count,) and (filled.source[inside] == INVENTED).all()
    assert (good < 0.15).all() and (bad > 0.3).all()
    np.testing.assert_allclose(holes.errors(chart, chart), 0, atol=1e-6)


def test_where_nothing_was_removed_nothing_is_planted(chart: StreetChart) -> None:  # noqa: F811
    assert plant_holes(chart, np.zeros(chart.source.shape, bool)).count == 0
