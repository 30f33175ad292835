"""A facade with windows at even distances, one colour of plaster per house, a plinth, and gaps that parked cars leave in it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unveil_core.inpaint.facade.wall_fill import WallFill, fill_wall

TEXEL = 0.04
PLASTER = (np.array([0.40, 0.33, 0.18]), np.array([0.25, 0.32, 0.45]))
PANE, PLINTH = np.array([0.15, 0.16, 0.18]), np.array([0.2, 0.2, 0.21])


def facade(length: float = 24.0, change: float = 12.0) -> np.ndarray:
    """(A, B, 3) six metres high; windows of 1.2 m every 3 m, a house of another colour from ``change`` on."""
    s, h = np.meshgrid(np.arange(0, length, TEXEL), np.arange(0, 6, TEXEL), indexing="ij")
    color = np.where((s < change)[..., None], *PLASTER)
    color[(s % 3 < 1.2) & ((h % 3) > 1) & ((h % 3) < 2.4)] = PANE
    color[h < 0.5] = PLINTH
    return color.astype(np.float32)


def gap(shape: tuple[int, ...], *parts: tuple[float, float, float]) -> np.ndarray:
    """Texels below a height between two places along the street."""
    s, h = np.meshgrid(*(np.arange(n) * TEXEL for n in shape[:2]), indexing="ij")
    return np.any([(s >= a) & (s < b) & (h < top) for a, b, top in parts], axis=0)


def filled_again(truth: np.ndarray, hidden: np.ndarray) -> WallFill:
    return fill_wall(np.where(hidden[..., None], 0, truth).astype(np.float32), ~hidden, hidden, texel=TEXEL)


@pytest.mark.parametrize("place", [2.0, 5.4, 7.3])
def test_a_gap_below_windows_gets_the_other_half_of_them(place: float) -> None:
    truth = facade()
    hidden = gap(truth.shape, (place, place + 3.2, 1.8))
    color, filled, opened = filled_again(truth, hidden)
    assert np.array_equal(filled, hidden) and not opened.any()
    assert np.array_equal(color[~hidden], truth[~hidden])
    error = np.sqrt(((color - truth) ** 2)[hidden].mean())
    plain = np.sqrt(((PLASTER[0] - truth) ** 2)[hidden].mean())
    assert error < 0.05 < 0.6 * plain


def test_a_wall_and_its_plinth_go_on_in_their_own_colours() -> None:
    """Without windows, so that nothing but height and house tells of a colour."""
    truth = facade()
    truth[np.isclose(truth, PANE, atol=1e-6).all(axis=2)] = np.nan
    truth = np.where(np.isnan(truth), np.where((np.arange(len(truth)) * TEXEL < 12)[:, None, None], *PLASTER), truth)
    hidden = gap(truth.shape, (3.0, 8.0, 1.5), (14.0, 19.0, 1.5))
    color, *_ = filled_again(truth.astype(np.float32), hidden)
    assert np.abs(color - truth)[hidden].mean() < 0.02


def test_over_a_gap_that_reaches_the_eaves_the_sky_goes_on() -> None:
    truth = facade(change=100.0)
    sky = ~gap(truth.shape, (0.0, 24.0, 4.0))
    hidden = gap(truth.shape, (9.0, 15.0, 6.0))
    seen = np.where(hidden[..., None] | sky[..., None], 0, truth).astype(np.float32)
    color, filled, opened = fill_wall(seen, ~hidden & ~sky, hidden, sky & ~hidden, texel=TEXEL)
    assert np.array_equal(filled | opened, hidden) and not (filled & opened).any()
    assert (opened != sky)[hidden].mean() < 0.06
    assert np.abs(color[filled] - truth[filled]).mean() < 0.06


def test_what_stands_before_one_place_does_not_come_again_everywhere() -> None:
    """A lamp and its foot before the house, in a gap of 80 cm, which is all that is known below."""
    truth = facade(change=100.0)
    hidden = gap(truth.shape, (0.0, 10.6, 1.0), (11.4, 24.0, 1.0))
    truth[round(10.9 / TEXEL) : round(11.1 / TEXEL), :25] = 0.02
    color, filled, _ = filled_again(truth, hidden)
    lamps = (color.max(axis=2) < 0.08) & filled
    assert lamps.sum() < 0.02 * hidden.sum()


def test_where_nothing_is_known_nothing_is_invented() -> None:
    truth = facade()
    everything = np.ones(truth.shape[:2], dtype=bool)
    for known, wanted in ((~everything, everything), (everything, ~everything)):
        color, filled, opened = fill_wall(truth, known, wanted, texel=TEXEL)
        assert not filled.any() and not opened.any() and np.array_equal(color, truth)


@settings(deadline=None, max_examples=6)
@given(
    st.lists(st.tuples(st.floats(0, 20), st.floats(0.1, 5), st.floats(0.2, 5.9)), min_size=1, max_size=3),
    st.floats(0.2, 2.0),
)
def test_what_is_filled_was_wanted_and_is_a_colour(parts: list[tuple[float, float, float]], bright: float) -> None:
    truth = np.clip(facade() * np.float32(bright), 0, 1)
    hidden = gap(truth.shape, *((a, a + b, top) for a, b, top in parts))
    color, filled, _ = filled_again(truth, hidden)
    assert np.array_equal(filled, hidden)
    assert np.isfinite(color).all() and color.min() >= 0 and color.max() <= 1
    assert np.array_equal(color[~filled], truth[~filled])
