"""What a lateral offset looks like, and where that is taken from when it is hidden."""

from __future__ import annotations

import numpy as np

from unveil_core.inpaint.chart.lateral_profile import lateral_profile

WINDOW, HOP = 125, 100


def street(rows: int = 1600, columns: int = 60) -> np.ndarray:
    """Dark and light stripes along the street."""
    stripe = np.where((np.arange(columns) // 10) % 2 == 0, 0.3, 0.6)
    return np.broadcast_to(stripe[None, :, None], (rows, columns, 3)).astype(np.float32).copy()


def test_what_is_hidden_here_is_taken_from_farther_along() -> None:
    color = street()
    usable = np.ones(color.shape[:2], dtype=bool)
    usable[500:900, 20:40] = False
    color[~usable] = 9.0
    median, level = lateral_profile(color, usable, window=WINDOW, hop=HOP)
    assert np.allclose(median, street(), atol=1e-3)
    assert np.allclose(level, street()[..., 0], atol=1e-3)


def test_right_beside_what_is_known_a_far_place_knows_less() -> None:
    color = street()
    color[1200:, 50:] = 1.0
    usable = np.ones(color.shape[:2], dtype=bool)
    usable[:1200, 50:] = False
    median, _ = lateral_profile(color, usable, window=WINDOW, hop=HOP)
    assert np.allclose(median[:700, 50:55], 0.3 * (49 // 10 % 2 == 0) + 0.6 * (49 // 10 % 2 == 1), atol=1e-3)
    # Nearer to the place it is believed.
    assert np.allclose(median[1100:, 50:], 1.0, atol=1e-3)


def test_offsets_that_nobody_saw_take_the_nearest_and_an_unseen_street_is_grey() -> None:
    color = street()
    usable = np.zeros(color.shape[:2], dtype=bool)
    median, _ = lateral_profile(color, usable, window=WINDOW, hop=HOP)
    assert (median == 0.5).all()
    usable[:, 12:18] = True
    median, level = lateral_profile(color, usable, window=WINDOW, hop=HOP)
    assert np.allclose(median, 0.6) and np.isfinite(level).all()


def test_far_beyond_what_was_seen_an_offset_is_what_it_mostly_is() -> None:
    """The last thing that was seen of it, a car's underside taken for road, does not go on to the horizon."""
    color = np.full((600, 8, 3), 0.5, np.float32)
    color[260:300, 3] = 0.05
    usable = np.zeros((600, 8), bool)
    usable[:300] = True
    median, level = lateral_profile(color, usable, window=40, hop=20)
    assert (median[280, 3] < 0.1).all()
    assert np.allclose(median[500:], 0.5)
    assert np.allclose(level[500:], 0.5)


def test_beyond_the_last_line_that_was_seen_the_street_goes_on_without_it() -> None:
    """A row of parked cars hides all beyond an edge line: the lane goes on, not the line's white."""
    color = np.full((600, 90, 3), 0.4, np.float32)
    color[:, 40:44] = 0.9
    usable = np.zeros(color.shape[:2], dtype=bool)
    usable[:, 10:44] = True
    median, level = lateral_profile(color, usable, window=WINDOW, hop=HOP)
    assert np.allclose(median[:, 44:], 0.4) and np.allclose(level[:, 44:], 0.4)
    assert np.allclose(median[:, :10], 0.4) and np.allclose(median[:, 40:44], 0.9)


def test_a_line_that_is_seen_for_three_metres_is_the_colour_of_its_offset() -> None:
    """Between two lorries: too little of any window, and all that is known of the offset."""
    color = np.full((1600, 40, 3), 0.4, np.float32)
    color[:, 20:23] = 0.8
    usable = np.ones((1600, 40), bool)
    usable[:, 15:] = False
    usable[700:775, 15:] = True
    median, level = lateral_profile(color, usable, window=500, hop=200)
    assert np.allclose(median, color, atol=1e-3)
    assert np.allclose(level[:, 21], 0.8, atol=1e-3)
