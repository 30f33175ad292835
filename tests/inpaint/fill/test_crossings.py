"""Bars of zebra crossings, continued into what nobody saw."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unveil_core.base.types import Float32, Mask
from unveil_core.inpaint.fill.crossings import continue_crossings

PER_M = 25
ROWS, COLUMNS = 40 * PER_M, 14 * PER_M
ROAD, SIDEWALK = 0, 1
KERBS = (2 * PER_M, 12 * PER_M)


def crossing(first_m: float, bars: int, period: float = 1.0, width: float = 0.5) -> tuple[Float32, Mask]:
    """Detail of a crossing of 3.5 m from row 15 m on, and where its bars lie."""
    bar = np.zeros((ROWS, COLUMNS), dtype=bool)
    for k in range(bars):
        start = round((first_m + k * period) * PER_M)
        bar[15 * PER_M : round(18.5 * PER_M), start : start + round(width * PER_M)] = True
    detail = np.random.default_rng(0).normal(0, 0.02, (ROWS, COLUMNS, 3)) + 0.3 * bar[..., None]
    return detail.astype(np.float32), bar


def ground() -> np.ndarray:
    kind = np.full((ROWS, COLUMNS), SIDEWALK, dtype=np.int16)
    kind[:, KERBS[0] : KERBS[1]] = ROAD
    return kind


def continued(detail: Float32, known: Mask, line: Mask | None = None) -> tuple[Float32, Mask]:
    line = np.zeros_like(known) if line is None else line
    seen = np.where(known[..., None], detail, 0).astype(np.float32)
    made, share = continue_crossings(seen, known, ~known, ground(), line, texels_per_m=PER_M)
    assert not share[known].any()
    return made, share > 0.5


@settings(max_examples=15, deadline=None)
@given(period=st.floats(0.8, 1.4), share=st.floats(0.4, 0.6), hidden=st.integers(1, 3), bars=st.integers(6, 7))
def test_bars_that_a_row_of_cars_hides_are_continued_to_the_kerb(
    period: float, share: float, hidden: int, bars: int
) -> None:
    """As far from the hidden kerb as from the one that is seen, at any usual distance from each other."""
    first = 7 - ((bars - 1 + share) * period) / 2
    detail, bar = crossing(first, bars, period, share * period)
    known = np.ones_like(bar)
    known[:, round((first + (bars - hidden - 0.1) * period) * PER_M) :] = False
    made, there = continued(detail, known)
    # A texel on either side of a bar may be left: of a narrow one a fifth.
    inside = cv2.erode(bar.astype(np.uint8), np.ones((1, 3), np.uint8)).astype(bool)
    assert there[inside & ~known].mean() > 0.85
    assert there[bar & ~known].mean() > 0.8
    assert there[~bar].mean() < 0.002
    assert abs(float(made[there].mean()) - 0.3) < 0.05


def test_bars_end_at_the_line_beside_the_parked_cars() -> None:
    detail, bar = crossing(5.05, 5)
    line, known = np.zeros_like(bar), np.ones_like(bar)
    beside = round(9.8 * PER_M)  # a bay of 2.2 m
    line[:, beside : beside + 3] = True
    known[:, round(7.8 * PER_M) :] = False
    known[:, : round(4.8 * PER_M)] = False  # the other side is hidden, too
    _, there = continued(detail, known, line)
    assert there[bar & ~known].mean() > 0.85
    assert not there[:, beside:].any()


def test_a_line_in_the_middle_does_not_end_a_crossing_that_lies_around_it() -> None:
    """Its other end, beside bays of 2.2 m, is seen; on this side a lorry stands from the middle to the kerb."""
    detail, bar = crossing(4.45, 7)
    line, known = np.zeros_like(bar), np.ones_like(bar)
    middle = round(7.7 * PER_M)
    line[:, middle - 1 : middle + 2] = True
    known[:, round(7.3 * PER_M) :] = False
    made, there = continued(detail, known, line)
    assert there[bar & ~known].mean() > 0.7  # no more bars are made up than are seen
    assert there[~bar].mean() < 0.002


def test_a_bar_of_which_half_is_seen_says_where_one_edge_is() -> None:
    detail, bar = crossing(2.75, 6)
    known = np.ones_like(bar)
    known[:, round(5.08 * PER_M) :] = False  # within the third
    _, there = continued(detail, known)
    inside = cv2.erode(bar.astype(np.uint8), np.ones((1, 3), np.uint8)).astype(bool)
    assert there[inside & ~known].mean() > 0.9
    assert there[~bar].mean() < 0.002


def test_what_one_row_takes_for_a_bar_is_none() -> None:
    detail, bar = crossing(4.75, 5)
    known = np.ones_like(bar)
    detail[16 * PER_M : round(16.4 * PER_M), round(2.75 * PER_M) : round(3.25 * PER_M)] += 0.3  # a sheet of paper
    known[16 * PER_M : 19 * PER_M, round(3.4 * PER_M) : round(4.4 * PER_M)] = False
    _, there = continued(detail, known)
    assert not there.any()


@pytest.mark.parametrize("seen_m, ends", [(0.05, True), (0.02, False)])
def test_a_narrow_strip_of_asphalt_where_a_bar_should_be_ends_the_crossing(seen_m: float, ends: bool) -> None:
    """3.5 m along the street, a tenth of a bar wide; narrower it may be that of the bar's border."""
    detail, bar = crossing(5.0, 3)
    known = np.ones_like(bar)
    known[:, round((8.0 + seen_m) * PER_M) :] = False
    known[:, : round(4.9 * PER_M)] = False
    _, there = continued(detail, known)
    assert there[:, round(8.5 * PER_M) :].any() != ends


def test_a_bar_half_of_which_was_seen_is_whole() -> None:
    detail, bar = crossing(2.75, 9)
    known = np.ones_like(bar)
    known[16 * PER_M : 22 * PER_M, 6 * PER_M : 8 * PER_M] = False
    _, there = continued(detail, known)
    assert there[bar & ~known].mean() > 0.85
    assert not there[~bar].any()


@pytest.mark.parametrize("seen", ["two bars", "dashes", "a long grating"])
def test_what_is_no_crossing_is_not_continued(seen: str) -> None:
    detail, bar = crossing(2.75, 2 if seen == "two bars" else 9)
    if seen == "dashes":
        detail, bar = crossing(2.75, 3, period=3.0, width=0.12)
    if seen == "a long grating":
        detail = np.repeat(detail[16 * PER_M : 17 * PER_M], 40, axis=0)
    known = np.ones_like(bar)
    known[:, 8 * PER_M :] = False
    _, there = continued(detail, known)
    assert not there.any()


def test_bars_that_are_seen_to_end_are_not_continued_behind_that() -> None:
    detail, bar = crossing(3.75, 4)
    known = np.ones_like(bar)
    known[:, round(9.5 * PER_M) :] = False
    _, there = continued(detail, known)
    assert not there.any()


def test_a_line_along_the_street_ends_before_a_crossing() -> None:
    """It lies between two bars that a lorry hides, and goes on on both sides of the crossing."""
    detail, bar = crossing(4.45, 7)
    line, known = np.zeros_like(bar), np.ones_like(bar)
    line[:, round(7.1 * PER_M) : round(7.2 * PER_M)] = True
    known[:, round(6.8 * PER_M) :] = False
    paint = np.where(line[..., None], np.float32(0.25), np.float32(0)).repeat(3, axis=2)
    seen = np.where(known[..., None], detail, 0).astype(np.float32)
    made, share = continue_crossings(seen, known, ~known, ground(), line, paint, texels_per_m=PER_M)
    on_crossing = bar.any(axis=1, keepdims=True)
    inside = cv2.erode(np.broadcast_to(on_crossing, bar.shape).astype(np.uint8), np.ones((5, 1), np.uint8)).astype(bool)
    assert np.allclose(made[line & inside], -0.25)
    assert (share[line & inside] == 1).all()
    assert not share[line & ~on_crossing].any()
