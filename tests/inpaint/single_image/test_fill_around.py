"""What a hole is filled from: its own surroundings, and of these only what is of its kind."""

from __future__ import annotations

import numpy as np

from unveil_core.inpaint.single_image.registry import exemplar, fill_around

SKY, ROAD = (200, 220, 250), (70, 70, 75)


def test_over_the_horizon_nothing_is_taken_from_the_road() -> None:
    rng = np.random.default_rng(0)
    image = np.empty((80, 120, 3), np.uint8)
    image[:40], image[40:] = SKY, ROAD
    image = np.clip(image + rng.normal(0, 3, image.shape), 0, 255).astype(np.uint8)
    hole = np.zeros((80, 120), bool)
    hole[26:46, 40:80] = True
    over, road = hole.copy(), np.zeros_like(hole)
    over[40:], road[40:] = False, True
    image[hole] = (0, 200, 0)
    filled = fill_around(exemplar, image, over, road | (hole & ~over))
    assert np.abs(filled[over].astype(int) - SKY).max() < 25
    assert np.array_equal(filled[~over], image[~over])


def test_where_all_around_is_unlike_it_is_taken_all_the_same() -> None:
    image = np.full((40, 40, 3), ROAD, np.uint8)
    hole = np.zeros((40, 40), bool)
    hole[15:25, 15:25] = True
    image[hole] = 0
    filled = fill_around(exemplar, image, hole, ~hole)
    assert np.abs(filled[hole].astype(int) - ROAD).max() < 3
