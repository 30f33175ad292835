"""The cheapest path through a table of costs, against all paths there are."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np

from unveil_core.geometry.cheapest_path import cheapest_path

CHANGE = 0.3


def step(total: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each choice aside costs ``CHANGE``."""
    choices = np.arange(len(total))
    options = total[None] + CHANGE * np.abs(choices[:, None] - choices[None])
    return options.argmin(axis=1), options.min(axis=1)


def price(cost: np.ndarray, path: tuple[int, ...] | np.ndarray) -> float:
    steps = sum(CHANGE * abs(int(b) - int(a)) for a, b in pairwise(path))
    return float(sum(cost[row, choice] for row, choice in enumerate(path))) + steps


def test_no_path_is_cheaper() -> None:
    for seed in range(20):
        cost = np.random.default_rng(seed).random((5, 4))
        best = min(price(cost, path) for path in product(range(4), repeat=5))
        assert np.isclose(price(cost, cheapest_path(cost, step)), best)


def test_one_row() -> None:
    assert cheapest_path(np.array([[3.0, 1.0, 2.0]]), step).tolist() == [1]
