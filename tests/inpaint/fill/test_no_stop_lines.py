"""What is as bright as a stop line and none, and lines of which too little is known: all stays as it was seen."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.inpaint.painted_lane import (
    COLUMNS,
    KERBS,
    LEVEL,
    MIDDLE,
    PER_M,
    ROWS,
    continued,
    metres,
    painted,
    rectangle,
    road,
    stop_line,
)
from unveil_core.base.types import Mask
from unveil_core.inpaint.fill.stop_lines import continue_stop_lines


def bars_along() -> Mask:
    """A crossing of this street."""
    return np.any([rectangle((18.5, 22), (3.25 + k, 3.75 + k)) for k in range(8)], axis=0)


def bars_across() -> Mask:
    """A crossing of the street that joins: its bars lie across this one."""
    return np.any([rectangle((17 + k, 17.5 + k), (3.2, 6.8)) for k in range(5)], axis=0)


def bays() -> Mask:
    return np.any([rectangle((3 + k * 5.6, 3.12 + k * 5.6), (3.1, 5.4)) for k in range(7)], axis=0)


def dashes_to_give_way() -> Mask:
    return np.any([rectangle((19.8, 20.2), (3.1 + k * 0.75, 3.6 + k * 0.75)) for k in range(5)], axis=0)


def teeth() -> Mask:
    """Triangles, as before a road with priority."""
    s, t = metres()
    return np.any(
        [np.abs(t - 3.5 - 0.7 * k) < 0.3 * np.clip(1 - np.abs(s - 19.7) / 0.3, 0, None) for k in range(5)], axis=0
    )


def arrow() -> Mask:
    """Straight on, 5 m long."""
    s, t = metres()
    return rectangle((17, 20.5), (4.92, 5.08)) | (
        (np.abs(t - 5) < 0.45 * np.clip((22 - s) / 1.5, 0, None)) & (s > 20.5) & (s < 22)
    )


def letters(text: str) -> Mask:
    """1.6 m long and 0.65 m wide, as they are written on lanes, with strokes about 0.3 m thick along the street."""
    sheet = np.zeros((60, 60 * len(text)), np.uint8)
    cv2.putText(sheet, text, (4, 52), cv2.FONT_HERSHEY_SIMPLEX, 1.8, 255, 7)
    across = np.flatnonzero(sheet.any(axis=0))
    sheet = sheet[sheet.any(axis=1)][:, across[0] : across[-1] + 1]
    sheet = cv2.resize(sheet, (round(0.65 * len(text) * PER_M), round(1.6 * PER_M)))
    result = np.zeros((ROWS, COLUMNS), dtype=bool)
    row, column = round(19.2 * PER_M), round(3.6 * PER_M)
    result[row : row + sheet.shape[0], column : column + sheet.shape[1]] = sheet[::-1] > 127
    return result


def patch() -> Mask:
    """Lighter asphalt."""
    return rectangle((19, 20.2), (3.2, 6.5))


def manhole() -> Mask:
    s, t = metres()
    return np.hypot(s - 20, t - 5) < 0.32


NO_LINES = {
    "bars along": bars_along(),
    "bars across": bars_across(),
    "bays": bays(),
    "dashes to give way": dashes_to_give_way(),
    "teeth": teeth(),
    "arrow": arrow(),
    "BUS": letters("BUS"),
    "STOP": letters("STOP"),
    "TEL": letters("TEL"),
    "30": letters("30"),
    "patch": patch(),
    "manhole": manhole(),
    "thin line": stop_line(0.15),
    "thick band": stop_line(0.9),
    "oblique line": stop_line(0.4, slope=0.4),
}


@settings(max_examples=150, deadline=None)
@given(
    name=st.sampled_from(sorted(NO_LINES)),
    s=st.floats(16, 22),
    t=st.floats(1, 6.5),
    long=st.floats(0.4, 5),
    wide=st.floats(0.5, 4),
    blur=st.sampled_from([0.0, 1.0, 2.0]),
    seed=st.integers(0, 9),
)
def test_what_is_no_stop_line_is_not_continued(
    name: str, s: float, t: float, long: float, wide: float, blur: float, seed: int
) -> None:
    """Wherever the hole lies."""
    hidden = rectangle((s, s + long), (t, t + wide))
    _, there = continued(painted(NO_LINES[name], 0.03, seed, blur), hidden)
    assert not there.any()


def test_a_bright_slab_of_the_sidewalk_is_not_continued() -> None:
    """Its row looks like a line; it lies beyond the kerb."""
    slab = stop_line(0.4, across=(0.2, 2.8))
    _, there = continued(painted(slab), rectangle((18, 22), (1.9, 3.5)))
    assert not there.any()


@pytest.mark.parametrize("lit", [1, -1])
def test_borders_of_light_are_not_continued(lit: int) -> None:
    """A step of brightness; a narrow one, before and behind which the street differs."""
    s, _ = metres()
    light = 0.3 * (lit * (s - 20) > 0) + 0.1 * stop_line(0.4) + np.zeros((ROWS, COLUMNS))
    detail = painted(np.zeros_like(road())) + light[..., None].astype(np.float32)
    _, there = continued(detail, rectangle((18, 22), (1, 4.6)))
    assert not there.any()


def test_a_strip_of_sun_in_what_is_taken_for_shade_is_not_continued() -> None:
    """Asphalt of 0.4 divided by what the sky alone gives: yellow, and as bright as paint."""
    strip = stop_line(0.4)
    detail = painted(np.zeros_like(strip))
    detail[strip] += 0.4 * (1 / np.array([0.45, 0.5, 0.6], dtype=np.float32) - 1)
    _, there = continued(detail, rectangle((18, 22), (1, 4.6)))
    assert not there.any()


@pytest.mark.parametrize("seen", [0.5, 1.0, 1.3])
def test_of_a_line_of_which_little_is_seen_nothing_is_told(seen: float) -> None:
    line = stop_line()
    _, there = continued(painted(line), rectangle((18, 22), (1, 6.9 - seen)))
    assert not there.any()


def test_faint_bands_are_not_continued() -> None:
    """A strip of concrete, a third as bright as paint."""
    _, there = continued(painted(stop_line()) / 3, rectangle((18, 22), (1, 4.6)))
    assert not there.any()


def test_without_a_border_in_reach_a_line_stays_as_it_was_seen() -> None:
    """A road of 8 m without a line in its middle: the line ends somewhere under the car, which ends in the other lane."""
    _, there = continued(painted(stop_line()), rectangle((18, 22), (5.0, 8)), line=np.zeros_like(road()))
    assert not there.any()
    # The kerb is in reach.
    _, there = continued(painted(stop_line()), rectangle((18, 22), (1, 5.0)), line=np.zeros_like(road()))
    assert there.any()


def test_a_line_does_not_go_on_over_the_middle_nor_beyond_the_road() -> None:
    hidden = rectangle((18, 22), (0, 4.4)) | rectangle((18, 22), (6.0, 14))
    _, there = continued(painted(stop_line()), hidden)
    across = np.flatnonzero(there.any(axis=0)) / PER_M
    assert across.min() > KERBS[0] - 0.1 and across.max() < MIDDLE
    assert there.any(axis=0)[round(KERBS[0] * PER_M) + 1 : round(4.4 * PER_M)].all()


def test_a_line_that_was_seen_to_end_is_not_longer() -> None:
    """Asphalt is seen beyond its end, 1.5 m before the kerb; the hole lies between that and the kerb, or over the end."""
    line = stop_line(across=(4.5, 6.9))
    for across in ((1, 3.9), (3.8, 4.6)):
        _, there = continued(painted(line), rectangle((18, 22), across))
        assert not there.any()


def test_a_line_behind_which_another_lies_stays() -> None:
    lines = stop_line(at=20) | stop_line(at=21)
    _, there = continued(painted(lines), rectangle((18, 23), (1, 4.6)))
    assert not there.any()


@pytest.mark.parametrize("seen", ["nothing", "everything"])
def test_nothing_is_made_up_where_nothing_or_all_was_seen(seen: str) -> None:
    _, there = continued(painted(stop_line()), np.full((ROWS, COLUMNS), seen == "nothing"))
    assert not there.any()


def test_a_chart_smaller_than_a_line_is_no_matter() -> None:
    known = np.ones((12, 9), dtype=bool)
    detail = np.full((12, 9, 3), LEVEL, dtype=np.float32)
    _, share = continue_stop_lines(detail, known, ~known, known, ~known, texels_per_m=PER_M)
    assert not share.any()
