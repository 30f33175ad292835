"""Stop lines that go on to the border of their lane."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.inpaint.painted_lane import (
    COLUMNS,
    LEVEL,
    MIDDLE,
    PER_M,
    ROWS,
    continued,
    middle_line,
    painted,
    rectangle,
    road,
    stop_line,
)
from tests.inpaint.sunny_street import sunny_chart
from unveil_core.base.types import Mask
from unveil_core.inpaint.chart.street_chart import OBSERVED, OUTSIDE
from unveil_core.inpaint.fill.chart_fill import fill_chart


def inside(line: Mask) -> Mask:
    return cv2.erode(line.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0).astype(bool)


def assert_completed(line: Mask, hidden: Mask, there: Mask) -> None:
    """All of what was hidden, and nothing beyond: a texel on each side, and the gap between its end and its lane's border."""
    assert there[inside(line) & hidden].mean() > 0.97
    around = cv2.dilate(line.astype(np.uint8), np.ones((5, 7), np.uint8)).astype(bool)
    assert not (there & ~around).any()
    assert there.sum(axis=0).max() <= line.sum(axis=0).max() + 2


@settings(max_examples=40, deadline=None)
@given(
    thick=st.floats(0.3, 0.6),
    slope=st.floats(-0.1, 0.1),
    at=st.floats(5, 35),
    grain=st.floats(0.0, 0.05),
    blur=st.sampled_from([0.0, 1.0]),
    seen=st.floats(1.75, 3.5),
    side=st.sampled_from([-1, 1]),
    seed=st.integers(0, 9),
)
def test_a_line_goes_on_to_the_border_of_its_lane(
    thick: float, slope: float, at: float, grain: float, blur: float, seen: float, side: int, seed: int
) -> None:
    """To the kerb or to the middle, from a hole that it touches on one side."""
    line = stop_line(thick, slope=slope, at=at)
    hidden = rectangle((at - 2, at + 3), (0.5, 6.9 - seen) if side < 0 else (3.1 + seen, 9.0))
    made, there = continued(painted(line, grain, seed, blur), hidden)
    assert_completed(line, hidden, there)
    assert abs(float(made[there & line].mean()) - LEVEL) < 0.05


@settings(max_examples=25, deadline=None)
@given(
    thick=st.floats(0.3, 0.6),
    slope=st.floats(-0.1, 0.1),
    first=st.floats(4.0, 4.4),
    width=st.floats(0.3, 1.4),
    grain=st.floats(0.0, 0.05),
    seed=st.integers(0, 9),
)
def test_a_line_is_closed_that_is_seen_on_both_sides_of_the_hole(
    thick: float, slope: float, first: float, width: float, grain: float, seed: int
) -> None:
    line = stop_line(thick, slope=slope)
    hidden = rectangle((18, 24), (first, first + width))
    made, there = continued(painted(line, grain, seed), hidden)
    assert_completed(line, hidden, there)
    assert abs(float(made[there & line].mean()) - LEVEL) < 0.05


def test_paint_goes_on_with_its_grain_and_without_a_seam() -> None:
    line, grain = stop_line(), 0.03
    hidden = rectangle((18, 24), (0, 4.6))
    detail = painted(line, grain)
    made, there = continued(detail, hidden)
    invented, seen = inside(line) & there, inside(line) & ~hidden
    assert 0.7 * grain < made[..., 0][invented].std() < 1.3 * grain
    whole = np.where(hidden[..., None], made, detail)[..., 0]
    rows = inside(line).any(axis=1)
    seam = round(4.6 * PER_M)
    # Columns beside the seam differ as those elsewhere do.
    step = np.abs(np.diff(np.where(rows[:, None], whole, 0).sum(axis=0) / rows.sum()))
    assert step[seam - 1] < 3 * np.median(step[seam + 5 : seam + 40])
    assert abs(whole[invented].mean() - whole[seen].mean()) < 0.01


@pytest.mark.parametrize("seed", range(3))
def test_worn_paint_goes_on_as_worn(seed: int) -> None:
    """It has lost a quarter of its paint, in spots of 8 cm."""
    line = stop_line(0.5)
    spots = np.random.default_rng(seed).random((ROWS // 2, COLUMNS // 2)).repeat(2, axis=0).repeat(2, axis=1) < 0.25
    hidden = rectangle((18, 24), (0, 4.6))
    detail = painted(line & ~spots)
    made, there = continued(detail, hidden)
    assert there[inside(line) & hidden].mean() > 0.9
    seen, invented = detail[..., 0][inside(line) & ~hidden], made[..., 0][inside(line) & hidden]
    assert abs(seen.mean() - invented.mean()) < 0.05 and invented.std() > 0.5 * seen.std()


@pytest.mark.parametrize("gap", [0.1, 0.5, 1.2])
def test_a_line_before_a_crossing_goes_on_and_its_bars_do_not(gap: float) -> None:
    """At the usual distance, and as close as the streets of ``sample_scenes`` have it: bars hide one edge half of the way."""
    line, bars = stop_line(), np.zeros_like(road())
    for k in range(8):
        bars |= rectangle((20.2 + gap, 23.7 + gap), (3.25 + k, 3.75 + k))
    hidden = rectangle((18, 20.2 + gap / 2), (1, 4.8))
    _, there = continued(painted(line | bars), hidden)
    assert_completed(line, hidden, there)


@pytest.mark.parametrize("dash, period", [(2.5, 6.0), (1.5, 5.0), (3.0, 9.0)])
def test_a_line_ends_at_a_broken_line(dash: float, period: float) -> None:
    """Which a median does not show, as there is more asphalt than paint."""
    line, dashes = stop_line(), np.zeros_like(road())
    for first in np.arange(0.7, 40, period):
        dashes |= rectangle((first, first + dash), (MIDDLE - 0.06, MIDDLE + 0.06))
    hidden = rectangle((18, 23), (5.2, 9))
    _, there = continued(painted(line | dashes), hidden, line=np.zeros_like(dashes))
    assert_completed(line, hidden, there)


def test_a_line_that_was_seen_to_end_before_the_kerb_ends_there() -> None:
    line = stop_line(across=(3.4, 6.9))
    hidden = rectangle((18, 23), (3.5, 5.0))
    _, there = continued(painted(line), hidden)
    assert_completed(line, hidden, there)


def test_each_of_two_lines_goes_on() -> None:
    lines = stop_line(at=12) | stop_line(at=30, across=(7.1, 10.9))
    hidden = rectangle((10, 14), (1, 4.5)) | rectangle((28, 33), (9.2, 12))
    _, there = continued(painted(lines), hidden)
    assert_completed(lines, hidden, there)


def test_mirrored_streets_are_filled_alike() -> None:
    line, hidden = stop_line(slope=0.05), rectangle((18, 24), (1, 4.7))
    detail = painted(line, 0.02)
    _, there = continued(detail, hidden)
    _, across = continued(
        detail[:, ::-1], hidden[:, ::-1], on=road()[:, ::-1], line=np.ascontiguousarray(middle_line()[:, ::-1])
    )
    _, along = continued(detail[::-1], hidden[::-1])
    assert there.sum() > 300
    for turned in (across[:, ::-1], along[::-1]):
        assert (turned ^ there).sum() < 0.15 * there.sum()


@pytest.mark.parametrize("radius", [np.inf, 30.0, -30.0])
def test_a_straight_line_in_a_bend_is_completed_in_the_chart(radius: float) -> None:
    """Painted straight in the world, 3 degrees off the street's normal; the chart is filled as it is in a run."""
    chart = sunny_chart(None)[0]
    path = chart.ground.path
    along = path.start + path.step * np.arange(len(path.heading))
    heading = path.heading + along / radius
    steps = path.step * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    nodes = path.nodes[0] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps[:-1], axis=0)])
    chart = replace(chart, ground=replace(chart.ground, path=replace(path, heading=heading, nodes=nodes)))
    s, t = chart.coordinates()
    plan = chart.world(*(i.ravel() for i in np.indices(chart.source.shape)))[:, :2].reshape(*chart.source.shape, 2)
    row = int(np.abs(s - 14).argmin())
    at, beside = plan[row, np.abs(t).argmin()], plan[row, np.abs(t - 1).argmin()]
    across = (beside - at) / np.linalg.norm(beside - at)
    turned = np.array([[np.cos(0.05), -np.sin(0.05)], [np.sin(0.05), np.cos(0.05)]]) @ across
    normal = np.array([turned[1], -turned[0]])
    line = (np.abs((plan - at) @ normal) < 0.2) & (t > -1.7) & (t < 1.6)
    street = np.random.default_rng(0).normal(0.4, 0.01, (*line.shape, 1)).repeat(3, axis=2).astype(np.float32)
    street[:, np.abs(t - 1.72) < 0.07] = street[line] = 0.75
    side = (t < -1.8) | (t > 5.2)
    street[:, side] = 0.6
    hidden = (s > 12)[:, None] & (s < 17)[:, None] & (t > -3) & (t < -0.2)
    chart = replace(
        chart,
        label=np.tile(side, (len(s), 1)).astype(np.int16),
        color=np.where(hidden[..., None], 0, street).astype(np.float32),
        source=np.where(hidden, OUTSIDE, OBSERVED).astype(np.uint8),
        nearest=np.full_like(chart.nearest, 5.0),
    )
    filled = fill_chart(chart, hidden).color.mean(axis=2)
    assert (filled > 0.6)[inside(line) & hidden].mean() > 0.95
    around = cv2.dilate(line.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
    on_road = hidden & ~around & (t > -1.6)
    assert (filled > 0.6)[on_road].mean() < 0.01
