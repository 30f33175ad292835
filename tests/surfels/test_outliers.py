"""Strays of a LiDAR are told from its points, near and far."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.surfels.outliers import lonely_points


def street(count: int) -> np.ndarray:
    """Ground, two walls and a pole, sparser with the distance from the origin, as a LiDAR leaves them."""
    generator = np.random.default_rng(0)
    along = 3 * np.exp(generator.uniform(0, np.log(15), 3 * count)).reshape(3, count)
    across, up = generator.uniform(-5, 5, count), generator.uniform(-1.5, 4, (2, count))
    ground = np.stack([along[0], across, np.full(count, -1.5)], axis=1)
    walls = [np.stack([along[i + 1], np.full(count, y), up[i]], axis=1) for i, y in enumerate((-5.0, 5.0))]
    pole = np.stack([np.full(60, 12.0), np.full(60, 3.0), np.linspace(-1.5, 3, 60)], axis=1)
    return np.concatenate([ground, *walls, pole])


def test_displaced_points_are_lonely_and_a_clean_street_is_not() -> None:
    clean, origin = street(6000), np.zeros((1, 3))
    assert lonely_points(clean, origin)[1].mean() < 0.01
    generator = np.random.default_rng(1)
    moved = generator.random(len(clean)) < 0.1
    points = clean + moved[:, None] * generator.normal(0, 2.0, clean.shape)
    far = moved & (np.linalg.norm(points - clean, axis=1) > 1)
    lonely = lonely_points(points, origin)[1]
    assert lonely[far].mean() > 0.8
    assert lonely[~moved].mean() < 0.02


def test_spacing_is_that_of_a_grid() -> None:
    grid = np.stack([*np.meshgrid(np.arange(20) * 0.1, np.arange(20) * 0.1), np.zeros((20, 20))], -1).reshape(-1, 3)
    spacing, lonely = lonely_points(grid, np.zeros((1, 3)))
    assert np.median(spacing) == pytest.approx(0.1)
    assert not lonely.any()


@pytest.mark.parametrize("count", [1, 3, 30])
def test_a_handful_of_points_is_no_cloud(count: int) -> None:
    generator = np.random.default_rng(2)
    spacing, lonely = lonely_points(generator.normal(size=(count, 3)), np.zeros((1, 3)))
    assert (spacing > 0).all() and not lonely.any()
