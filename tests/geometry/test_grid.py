"""Points in the cells of a grid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from unveil_core.geometry.grid import PointGrid, rising

PLACES = arrays(np.float64, st.tuples(st.integers(1, 12), st.just(3)), elements=st.floats(-50, 50))


@given(PLACES, arrays(np.float64, 3, elements=st.floats(-60, 60)), st.floats(0, 80))
def test_the_grid_misses_no_near_point(points: np.ndarray, place: np.ndarray, reach: float) -> None:
    found = PointGrid(points, 7.0).near(place, reach)
    assert (np.diff(found) > 0).all()
    gap = np.linalg.norm(points - place, axis=1)
    assert set(np.flatnonzero(gap < reach * (1 - 1e-12)).tolist()) <= set(found.tolist())
    assert (np.linalg.norm((points - place)[found, :2], axis=1) <= reach + 7.0 * np.sqrt(2)).all()


@given(st.lists(st.integers(-1000, 1000), min_size=1, max_size=60, unique=True), st.sampled_from([1, 10**9]))
def test_numbers_far_apart_and_close_together_are_put_in_order(numbers: list[int], spread: int) -> None:
    index = np.array(numbers, dtype=np.int64) * spread
    assert rising(index).tolist() == sorted(index.tolist())


@pytest.mark.parametrize("count, spread", [(0, 1.0), (1, 1.0), (500, 3.0), (4000, 20_000.0), (4000, 30.0)])
def test_cells_and_order_are_those_of_sorting(count: int, spread: float) -> None:
    """Many more cells than the table begins with, negative ones among them."""
    points = np.random.default_rng(count).uniform(-spread, spread, (count, 3))
    grid = PointGrid(points, 7.0)
    places = np.floor(points[:, :2] / 7.0).astype(np.int64)
    cells, of_point = np.unique(places, axis=0, return_inverse=True)
    assert np.array_equal(grid.middles, (cells + 0.5) * 7.0)
    assert np.array_equal(grid.order, np.argsort(of_point.ravel(), kind="stable"))
    assert np.array_equal(grid.first, np.searchsorted(np.sort(of_point.ravel()), np.arange(len(cells))))
    some = np.random.default_rng(1).random(len(cells)) < 0.3
    assert np.array_equal(grid.of_cells(some), np.flatnonzero(some[of_point.ravel()]))
