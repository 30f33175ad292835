"""What houses usually show at a height: medians of their own, and a plinth like the neighbours'."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.inpaint.facade.usual import PLINTH_M, usual_colors

PER_M = 10.0
WALLS = np.array([[0.5, 0.45, 0.3], [0.3, 0.35, 0.45]], dtype=np.float32)
PLINTH = np.float32(0.2)


def row_of_houses() -> tuple[np.ndarray, np.ndarray]:
    """Two houses of 10 m, 3 m high, on a plinth of half a metre: colours (A, B, 3) and the plaster's (A, 3)."""
    wall = np.repeat(WALLS, 100, axis=0)
    color = np.repeat(wall[:, None], 30, axis=1)
    color[:, :5] = PLINTH
    return color, wall


def test_a_house_shows_what_most_of_it_shows_at_a_height() -> None:
    color, wall = row_of_houses()
    truth = color.copy()
    color[30:40, :20] = 0.05  # a door
    usual, told = usual_colors(color, np.ones(color.shape[:2], dtype=bool), wall, PER_M)
    assert told.all()
    np.testing.assert_allclose(usual, truth)


def test_where_a_house_tells_nothing_a_neighbours_plinth_does_and_its_plaster_does_not() -> None:
    color, wall = row_of_houses()
    known = np.ones(color.shape[:2], dtype=bool)
    known[:100, :12] = False
    usual, told = usual_colors(np.where(known[..., None], color, 0.0), known, wall, PER_M)
    near = np.s_[40:100]  # of the second house so much is no farther away than AROUND_M
    assert told[near, :5].all() and not told[near, 5:12].any() and told[near, 12:].all()
    np.testing.assert_allclose(usual[near, :5], PLINTH)
    assert not told[:15, :12].any()


def test_what_is_higher_than_a_plinth_is_not_taken_over() -> None:
    color, wall = row_of_houses()
    color[:, : round(2 * PLINTH_M * PER_M)] = PLINTH
    known = np.ones(color.shape[:2], dtype=bool)
    known[:100, :20] = False
    told = usual_colors(np.where(known[..., None], color, 0.0), known, wall, PER_M)[1]
    low = round(PLINTH_M * PER_M)
    assert told[40:100, :low].all() and not told[40:100, low:20].any()


@given(st.integers(1, 60), st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_what_is_told_lies_among_what_was_seen(rows: int, columns: int, seed: int) -> None:
    generator = np.random.default_rng(seed)
    color = generator.random((rows, columns, 3), dtype=np.float32)
    known = generator.random((rows, columns)) < 0.5
    wall = np.broadcast_to(generator.random(3, dtype=np.float32), (rows, 3))
    usual, told = usual_colors(color, known, wall, PER_M)
    assert not told[:, ~known.any(axis=0)].any()
    for height in np.flatnonzero(told.any(axis=0)):
        own = color[known[:, height], height]
        found = usual[told[:, height], height]
        assert (found >= own.min(axis=0)).all() and (found <= own.max(axis=0)).all()
