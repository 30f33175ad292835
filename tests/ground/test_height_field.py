"""Rays over hills, against a walk along each ray in a thousand small steps."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unveil_core.base.parallel import threads
from unveil_core.ground.height_field import HeightField

CELL = 0.5


def hills(seed: int, size: int = 80, steep: float = 1.5) -> HeightField:
    """Rolling ground around (0, 0)."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(*(np.arange(size) * CELL,) * 2, indexing="ij")
    height = sum(
        steep * rng.uniform(0.2, 1) * np.sin(x * rng.uniform(0.1, 0.6) + y * rng.uniform(-0.6, 0.6) + rng.uniform(0, 6))
        for _ in range(4)
    )
    return HeightField(np.eye(3), np.array([-size / 2, -size / 2]) * CELL, CELL, np.asarray(height))


def walked(field: HeightField, centre: np.ndarray, ray: np.ndarray, *, near: float, far: float) -> float:
    """The first of many depths at which the ray has come from above to below."""
    depth = np.linspace(near, far, 8000)
    place = centre + depth[:, None] * ray
    over = place[:, 2] - field.height_at(place[:, :2])
    met = np.flatnonzero((over[1:] <= 0) & (over[:-1] > 0))
    return float(depth[met[0] + 1]) if len(met) else np.inf


@given(seed=st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_rays_meet_the_first_hill(seed: int) -> None:
    field = hills(seed)
    rng = np.random.default_rng(seed + 1)
    centre = np.array([0.0, 0.0, float(field.height_at(np.zeros((1, 2)))[0]) + 1.6])
    angle = rng.uniform(0, 2 * np.pi, 40)
    rays = np.stack([np.cos(angle), np.sin(angle), rng.uniform(-0.4, 0.25, 40)], axis=1)
    found = field.first_met(centre, rays, near=0.3, far=60.0)
    expected = np.array([walked(field, centre, ray, near=0.3, far=60.0) for ray in rays])
    # A ray may graze a hill for less than a step; what both find, they find at the same place.
    assert (np.isfinite(found) == np.isfinite(expected)).mean() > 0.9
    both = np.isfinite(found) & np.isfinite(expected)
    found, expected = found[both], expected[both]
    assert (np.abs(found - expected) < 0.01 * expected + 0.02).mean() > 0.9
    assert (found > 0.98 * expected - 0.02).all()


def test_unknown_ground_is_never_met() -> None:
    flat = np.zeros((40, 40))
    flat[20:, :] = np.nan
    field = HeightField(np.eye(3), np.array([-10.0, -10.0]), CELL, flat)
    centre = np.array([-5.0, 0.0, 1.0])
    rays = np.array([[1.0, 0.0, -0.5], [1.0, 0.0, -0.1], [1.0, 0.0, 0.1], [-1.0, 0.0, -0.05]])
    found = field.first_met(centre, rays, near=0.1, far=100.0)
    assert found[0] == pytest.approx(2.0, abs=0.01)
    assert np.isinf(found[1:]).all()
    nowhere = HeightField(np.eye(3), np.zeros(2), CELL, np.full((5, 5), np.nan))
    assert np.isinf(nowhere.first_met(centre, rays, near=0.1, far=9.0)).all()


def test_the_number_of_threads_changes_nothing() -> None:
    field = hills(5)
    rng = np.random.default_rng(0)
    rays = np.column_stack([rng.normal(size=(30_000, 2)), rng.uniform(-0.4, 0.2, 30_000)])
    centre = np.array([0.0, 0.0, 5.0])

    def found(count: int) -> np.ndarray:
        with threads(count):
            return field.first_met(centre, rays, near=0.2, far=60.0)

    one = found(1)
    assert np.isfinite(one).sum() > 5000 and np.array_equal(found(4), one)
    # Two Python threads may ask at the same time.
    with ThreadPoolExecutor(2) as pool:
        assert all(np.array_equal(other, one) for other in pool.map(found, (2, 2)))


def test_heights_over_a_slope() -> None:
    x, _ = np.meshgrid(np.arange(20.0), np.arange(20.0), indexing="ij")
    field = HeightField(np.eye(3), np.zeros(2), 1.0, 0.1 * x)
    over = field.over(np.array([[5.5, 3.2, 2.0], [19.0, 19.0, 1.9], [25.0, 3.0, 2.0]]))
    assert over[:2] == pytest.approx([1.45, 0.0]) and np.isnan(over[2])
