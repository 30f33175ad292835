"""Holes are planted where the street was seen, and tell how well it was filled there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.inpaint.chart.test_chart import chart, coordinates, in_car, street  # noqa: F401
from tests.inpaint.sunny_street import sunny_chart
from unveil_core.base.srgb import relight
from unveil_core.base.types import Mask
from unveil_core.inpaint.by_stretch import _surely_more
from unveil_core.inpaint.chart.planted import by_block, crossed_errors, plant_holes
from unveil_core.inpaint.chart.street_chart import INVENTED, OBSERVED, OUTSIDE, StreetChart
from unveil_core.inpaint.fill.chart_fill import fill_chart
from unveil_core.inpaint.light.shade import Light
from unveil_core.inpaint.light.sun import Sun


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


def test_what_was_found_where_a_hole_is_does_not_judge_it() -> None:
    """Asphalt is mended in patches, and a sun is made up whose shadows are the patches that were seen: it explains each hole that
    it was found with, and none that it was not."""
    even, _, footprint, *_ = sunny_chart(None)
    footprint[400:440, 60:100] = True
    s, t = even.coordinates()
    patches = (np.sin(2.1 * s)[:, None] * np.sin(1.7 * t + 1)[None] > 0.2) & (even.source == OBSERVED)
    patched = replace(even, color=np.where(patches[..., None], relight(even.color, 0.2), even.color))
    shown: list[Mask] = []

    def find(seen: StreetChart) -> Light:
        shown.append(seen.source == OBSERVED)
        nothing = np.zeros_like(patches)
        return Light(Sun(np.array([0.0, 0.0, 1.0]), 1.0, 0.0, 90.0), patches & shown[-1], nothing)

    def fill(holed: StreetChart, planted: Mask, found: Light | None) -> StreetChart:
        return fill_chart(holed, planted, light=found)

    holes = plant_holes(patched, footprint)
    by_itself = holes.errors(patched, fill(holes.chart, holes.footprint, find(patched)))
    without = holes.errors(patched, fill(holes.chart, holes.footprint, None))
    shown.clear()
    crossed, as_before = crossed_errors(patched, footprint, find, fill)
    assert len(shown) == 2 and not (shown[0] & shown[1]).any()
    np.testing.assert_allclose(as_before.mean(), by_block(without, holes.blocks()).mean())
    assert by_itself.mean() < 0.6 * without.mean()
    assert crossed.mean() > 0.9 * as_before.mean()


def test_holes_of_one_block_count_once() -> None:
    """A house shades four holes, and what explains them all by chance is no surer for that."""
    block = np.repeat([0, 1, 2, -1], 4)
    more = np.repeat([0.3, 0.0, 0.02, 5.0], 4) + np.tile([0.0, 0.004, -0.004, 0.001], 4)
    one, other = 0.2 + more, np.full(16, 0.2)
    assert _surely_more(one[:12], other[:12])
    assert not _surely_more(by_block(one, block), by_block(other, block))
    assert _surely_more(by_block(one, block) + 2, by_block(other, block))
