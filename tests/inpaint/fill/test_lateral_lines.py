"""Lines along the street are told from what lies along it by chance."""

from __future__ import annotations

import numpy as np

from unveil_core.inpaint.fill.lateral_lines import lateral_lines

TEXEL = 0.04
SHAPE = (750, 100)


def asphalt() -> np.ndarray:
    return np.random.default_rng(0).normal(0.4, 0.02, (*SHAPE, 1)).repeat(3, axis=2).astype(np.float32)


def test_a_line_goes_on_where_it_was_not_seen() -> None:
    street = asphalt()
    street[:, 40:43] += 0.3
    known = np.ones(SHAPE, dtype=bool)
    known[300:420] = False
    lines = lateral_lines(street, known, TEXEL).mean(axis=2)
    assert lines[360, 41] > 0.15
    assert abs(lines[360, 20]) < 0.02


def test_what_was_seen_through_one_gap_is_no_line() -> None:
    street = asphalt()
    known = np.zeros(SHAPE, dtype=bool)
    known[:, :60] = True
    known[350:370] = True
    street[350:370, 80:83] += 0.3
    lines = lateral_lines(street, known, TEXEL).mean(axis=2)
    assert np.abs(lines[200, 78:86]).max() < 0.15  # of 0.3
    assert np.abs(lines[500, 78:86]).max() < 0.15  # of 0.3
