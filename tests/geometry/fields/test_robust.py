"""Differences are held where chance would have them."""

from __future__ import annotations

import numpy as np

from unveil_core.geometry.fields.robust import held_near_median


def test_what_chance_makes_stays_and_what_it_does_not_is_held() -> None:
    rng = np.random.default_rng(0)
    told = rng.normal((3.0, -1.0), (0.5, 2.0), (4000, 2)).astype(np.float32)
    held = held_near_median(np.array([[3.2, -2.0], [50.0, -90.0]]), told, 0.0)
    np.testing.assert_allclose(held[0], (3.2, -2.0), rtol=1e-6)
    np.testing.assert_allclose(held[1], (3.0 + 2.5 * 0.5, -1.0 - 2.5 * 2.0), rtol=0.05)


def test_no_difference_is_held_tighter_than_the_least() -> None:
    same = np.full((100, 1), 7.0, np.float32)
    np.testing.assert_allclose(held_near_median(np.array([[9.0], [20.0]]), same, 1.0), [[9.0], [9.5]])
