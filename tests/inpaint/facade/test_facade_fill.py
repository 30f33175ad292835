"""A facade with windows at even distances, one colour of plaster per house, a plinth, and gaps that parked cars leave in it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unveil_core.inpaint.facade.facade_fill import fill_facade

PER_M = 25.0
PLASTER = (np.array([0.40, 0.33, 0.18]), np.array([0.25, 0.32, 0.45]))
PANE, PLINTH, DOOR = np.array([0.15, 0.16, 0.18]), np.array([0.2, 0.2, 0.21]), np.array([0.35, 0.08, 0.1])


def facade(length: float = 24.0, change: float = 12.0, door: float = 16.9) -> np.ndarray:
    """(A, B, 3) six metres high; windows of 1.2 m every 3 m, a house of another colour from ``change`` on, with a door."""
    s, h = np.meshgrid(np.arange(0, length, 1 / PER_M), np.arange(0, 6, 1 / PER_M), indexing="ij")
    color = np.where((s < change)[..., None], *PLASTER)
    color[(s % 3 < 1.2) & ((h % 3) > 1) & ((h % 3) < 2.4)] = PANE
    color[(s > door) & (s < door + 1.0) & (h < 2.2)] = DOOR
    color[h < 0.5] = PLINTH
    return color.astype(np.float32)


def gap(shape: tuple[int, ...], *parts: tuple[float, float, float]) -> np.ndarray:
    """Texels below a height between two places along the street."""
    s, h = np.meshgrid(*(np.arange(n) / PER_M for n in shape[:2]), indexing="ij")
    return np.any([(s >= a) & (s < b) & (h < top) for a, b, top in parts], axis=0)


@pytest.mark.parametrize("place", [2.0, 5.4, 7.3])
def test_a_gap_below_windows_gets_the_other_half_of_them(place: float) -> None:
    truth = facade()
    hidden = gap(truth.shape, (place, place + 3.2, 1.8))
    color, filled, *_ = fill_facade(np.where(hidden[..., None], 0, truth), ~hidden, hidden, texels_per_m=PER_M)
    assert filled[hidden].mean() > 0.99
    assert np.array_equal(color[~hidden], truth[~hidden])
    error = np.sqrt(((color - truth) ** 2)[hidden].mean())
    plain = np.sqrt(((PLASTER[0] - truth) ** 2)[hidden].mean())
    assert error < 0.04 < 0.5 * plain


def test_another_houses_windows_come_in_this_ones_plaster() -> None:
    """Of the second house only a strip is known below; its windows are those of the first."""
    truth = facade(door=100.0)
    hidden = gap(truth.shape, (12.5, 24.0, 1.8))
    color, filled, *_ = fill_facade(np.where(hidden[..., None], 0, truth), ~hidden, hidden, texels_per_m=PER_M)
    inside = gap(truth.shape, (14.0, 23.0, 1.8)) & filled
    assert inside.sum() > 0.9 * gap(truth.shape, (14.0, 23.0, 1.8)).sum()
    assert np.sqrt(((color - truth) ** 2)[inside].mean()) < 0.05
    pane = inside & (np.abs(truth - PANE) < 1e-3).all(axis=2)
    assert np.median(np.abs(color - PANE)[pane]) < 0.03


def test_behind_a_lorry_a_house_keeps_the_colour_of_its_plaster() -> None:
    """All that is known over the gap are panes, which are no plaster, and tell nothing of its colour."""
    truth = facade(change=100.0, door=100.0)
    hidden = gap(truth.shape, (5.0, 13.0, 4.4))
    known = ~hidden
    known[:, int(5.3 * PER_M) :] = False
    color, filled, *_ = fill_facade(np.where(known[..., None], truth, 0), known, hidden, texels_per_m=PER_M)
    assert filled[hidden].all()
    own = np.stack([PLASTER[0], PANE, PLINTH])
    apart = np.abs(color[hidden][:, None] - own).max(axis=2).min(axis=1)
    assert (apart > 0.03).mean() < 0.01


def test_a_door_is_not_put_under_a_window() -> None:
    truth = facade()
    hidden = gap(truth.shape, (18.0, 19.6, 1.6))
    color, *_ = fill_facade(np.where(hidden[..., None], 0, truth), ~hidden, hidden, texels_per_m=PER_M)
    red = (color[..., 0] > 2 * color[..., 1]) & hidden
    assert red.sum() == 0


def test_a_house_whose_foot_nobody_saw_gets_its_neighbours_plinth() -> None:
    """Of the first house nothing is seen below its windows; the second one, of grey plaster, stands on a plinth of darker grey,
    which is no plaster and does not become yellow."""
    truth = facade(door=100.0)
    truth[np.isclose(truth, PLASTER[1], atol=1e-6).all(axis=2)] = 0.45
    foot = np.isclose(truth, PLINTH, atol=1e-6).all(axis=2)
    truth[foot] = 0.38
    hidden = gap(truth.shape, (0.0, 12.0, 0.9))
    color, filled, *_ = fill_facade(np.where(hidden[..., None], 0, truth), ~hidden, hidden, texels_per_m=PER_M)
    inside = gap(truth.shape, (5.0, 11.0, 0.9))
    assert filled[inside].all()
    assert np.median(np.abs(color - 0.38)[inside & foot]) < 0.02
    assert np.median(np.abs(color - PLASTER[0])[inside & ~foot]) < 0.02


def test_a_window_half_hidden_gets_its_other_half_though_no_other_is_seen_to_the_ground() -> None:
    """All but a door is hidden below; that the door alone is seen down to the ground does not put it under windows."""
    truth = facade(change=100.0, door=10.9)
    truth[np.isclose(truth, DOOR, atol=1e-6).all(axis=2)] = dark = np.array([0.21, 0.2, 0.16])
    deep, shallow = gap(truth.shape, (3.0, 5.0, 1.8)), gap(truth.shape, (0.0, 10.9, 0.7), (11.9, 24.0, 0.7))
    hidden = deep | shallow
    color, *_ = fill_facade(np.where(hidden[..., None], 0, truth), ~hidden, hidden, texels_per_m=PER_M)
    door = np.isclose(color, dark, atol=0.02).all(axis=2) & deep
    assert door.sum() < 0.02 * deep.sum()
    pane = deep & np.isclose(truth, PANE, atol=1e-6).all(axis=2)
    assert np.median(np.abs(color - PANE)[pane]) < 0.03


def test_no_lit_window_is_made_up() -> None:
    """At dusk one house has lit windows on its ground floor, and nothing of that is seen of the other."""
    truth = facade(door=100.0) * 0.4
    s, h = np.meshgrid(*(np.arange(n) / PER_M for n in truth.shape[:2]), indexing="ij")
    lit = np.isclose(truth, 0.4 * PANE, atol=1e-6).all(axis=2) & (s > 12) & (h < 3)
    truth[lit] = 1.0
    hidden = gap(truth.shape, (0.0, 11.9, 2.7))
    color, filled, *_ = fill_facade(np.where(hidden[..., None], 0, truth), ~hidden, hidden, texels_per_m=PER_M)
    assert filled[hidden].all()
    assert (color[hidden].min(axis=1) > 0.5).mean() < 0.02
    beside = gap(truth.shape, (18.0, 19.0, 1.6))
    color, *_ = fill_facade(np.where(beside[..., None], 0, truth), ~beside, beside, texels_per_m=PER_M)
    assert np.median(color[beside & lit]) > 0.8, "of a lit window that is half seen the rest is lit"


def test_where_nothing_is_known_nothing_is_invented() -> None:
    truth = facade()
    everything = np.ones(truth.shape[:2], dtype=bool)
    color, filled, *_ = fill_facade(np.zeros_like(truth), ~everything, everything, texels_per_m=PER_M)
    assert not filled.any()
    color, filled, *_ = fill_facade(truth, everything, ~everything, texels_per_m=PER_M)
    assert not filled.any() and np.array_equal(color, truth)


@settings(deadline=None, max_examples=8)
@given(
    st.lists(st.tuples(st.floats(0, 20), st.floats(0.1, 5), st.floats(0.2, 5.9)), min_size=1, max_size=3),
    st.floats(0.2, 2.0),
)
def test_what_is_filled_was_wanted_and_is_a_colour(parts: list[tuple[float, float, float]], bright: float) -> None:
    truth = np.clip(facade() * np.float32(bright), 0, 1)
    hidden = gap(truth.shape, *((a, a + b, top) for a, b, top in parts))
    color, filled, *_ = fill_facade(np.where(hidden[..., None], 0, truth), ~hidden, hidden, texels_per_m=PER_M)
    assert not (filled & ~hidden).any()
    assert np.isfinite(color).all() and color.min() >= 0 and color.max() <= 1
    assert np.array_equal(color[~filled], np.where(hidden[..., None], 0, truth)[~filled])


def test_what_is_seen_between_two_cars_is_not_repeated_as_a_comb() -> None:
    """A lamp and its foot before the house, in a gap of 80 cm, which is all that is known below."""
    truth = facade(change=100.0, door=100.0)
    hidden = gap(truth.shape, (0.0, 10.6, 1.0), (11.4, 24.0, 1.0))
    seen = np.where(hidden[..., None], 0, truth)
    seen[int(10.9 * PER_M) : int(11.1 * PER_M), :25] = 0.02
    color, filled, *_ = fill_facade(seen, ~hidden, hidden, texels_per_m=PER_M)
    lamps = (color.max(axis=2) < 0.05) & hidden & filled
    assert lamps.sum() < 0.01 * hidden.sum()


def test_below_all_that_is_known_a_house_is_plaster() -> None:
    """A parked row hides the lowest metre and a half of all houses, and the lower half of their windows."""
    truth = facade(door=100.0)
    hidden = gap(truth.shape, (0.0, 24.0, 1.5))
    color, filled, *_ = fill_facade(np.where(hidden[..., None], 0, truth), ~hidden, hidden, texels_per_m=PER_M)
    assert filled[hidden].all()
    s = np.arange(len(truth)) / PER_M
    for house, plaster in zip(((s > 2) & (s < 11), (s > 14) & (s < 22)), PLASTER, strict=True):
        assert np.abs(color[house][:, :30] - plaster).max() < 0.02


def test_a_bright_streak_at_a_houses_far_edge_does_not_brighten_what_is_copied() -> None:
    """A lorry hides a house to its eaves but for its first 10 m, and a streak of the sky's white at the far edge."""
    truth = facade(change=100.0, door=100.0)
    hidden = gap(truth.shape, (10.0, 24.0, 6.0))
    streak = hidden & ~gap(truth.shape, (0.0, 24.0, 5.8)) & ~gap(truth.shape, (0.0, 11.0, 6.0))
    streak[int(13.0 * PER_M) :] = False
    seen = np.where(hidden[..., None], 0, truth)
    seen[streak] = 0.9
    color, filled, *_ = fill_facade(seen, ~hidden | streak, hidden & ~streak, texels_per_m=PER_M)
    inside = filled & ~gap(truth.shape, (0.0, 10.5, 6.0))
    assert inside.sum() > 0.5 * hidden.sum()
    own = np.stack([PLASTER[0], PANE, PLINTH])
    apart = np.abs(color[inside][:, None] - own).max(axis=2).min(axis=1)
    assert (apart > 0.05).mean() < 0.05


def test_bricks_of_another_house_are_no_texture_of_plaster() -> None:
    """Of the smooth house nothing is known below; its windows come from the brick one, the bricks do not."""
    truth = facade(door=100.0)
    rows, columns = np.indices(truth.shape[:2])
    wall = np.isclose(truth, PLASTER[1], atol=1e-6).all(axis=2)
    truth[wall & ((rows // 6 + columns // 3) % 2 == 0)] *= 0.7
    hidden = gap(truth.shape, (0.0, 11.5, 1.8))
    color, filled, *_ = fill_facade(np.where(hidden[..., None], 0, truth), ~hidden, hidden, texels_per_m=PER_M)
    smooth = np.isclose(truth, PLASTER[0], atol=1e-6).all(axis=2) & gap(truth.shape, (1.0, 10.0, 1.8))
    assert filled[smooth].all()
    bricks = np.std(np.log(truth[wall].mean(axis=1)))
    near = np.abs(color - PLASTER[0]).max(axis=2) < 0.15
    assert near[smooth].mean() > 0.8
    assert np.std(np.log(color[smooth & near].mean(axis=1))) < 0.5 * bricks
