"""Borders of lanes: lines along the street, whole or broken, and the carriageway's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.inpaint.painted_lane import KERBS, MIDDLE, PER_M, middle_line, painted, rectangle, road
from unveil_core.base.types import Mask
from unveil_core.inpaint.fill.lane_borders import lane_borders

NONE = np.zeros_like(road())


def borders(paint: Mask, *, hidden: Mask = NONE, line: Mask = NONE, seed: int = 0) -> np.ndarray:
    """Columns at 20 m, as metres of their middles, on the road."""
    luma = np.where(hidden, 0, painted(paint, seed=seed).mean(axis=2)).astype(np.float32)
    found = lane_borders(luma, ~hidden, road(), line, 20 * PER_M, texels_per_m=PER_M)
    at = (np.flatnonzero(found) + 0.5) / PER_M
    assert found[: int(KERBS[0] * PER_M)].all() and found[int(KERBS[1] * PER_M) + 1 :].all()
    return at[(at > KERBS[0]) & (at < KERBS[1])]


def dashes(long: float, period: float, first: float = 0.0) -> Mask:
    starts = np.arange(first, 40, period)
    return np.any([rectangle((s, s + long), (MIDDLE - 0.06, MIDDLE + 0.06)) for s in starts], axis=0)


def test_the_road_ends_at_its_border_and_a_lane_at_a_whole_line() -> None:
    assert not len(borders(NONE))
    at = borders(NONE, line=middle_line())
    assert len(at) == 2 and abs(at.mean() - MIDDLE) < 0.05


@settings(max_examples=20, deadline=None)
@given(long=st.floats(1.5, 4), gap=st.floats(1.5, 6), first=st.floats(0, 6), seed=st.integers(0, 9))
def test_a_lane_ends_at_a_broken_line_though_cars_hide_some_of_it(
    long: float, gap: float, first: float, seed: int
) -> None:
    hidden = rectangle((17, 24), (5, 9))
    at = borders(dashes(long, long + gap, first), hidden=hidden, seed=seed)
    assert 1 <= len(at) <= 5 and np.abs(at - MIDDLE).max() < 0.13


@pytest.mark.parametrize("what", ["an arrow's shaft", "a crossing", "bays", "grain"])
def test_other_paint_ends_no_lane(what: str) -> None:
    paint = {
        "an arrow's shaft": rectangle((12, 16), (4.9, 5.1)),
        "a crossing": np.any([rectangle((22, 25.5), (3.25 + k, 3.75 + k)) for k in range(8)], axis=0),
        "bays": np.any([rectangle((5.6 * k, 5.6 * k + 0.12), (3.1, 5.1)) for k in range(7)], axis=0),
        "grain": NONE,
    }[what]
    for seed in range(3):
        assert not len(borders(paint, seed=seed))
