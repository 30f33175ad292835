"""The ground of a street whose points are noisy, as without a LiDAR."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.ground.test_street import PATH, street_points
from unveil_core.base.types import Float64
from unveil_core.ground import street_fit
from unveil_core.ground.plain_fit import NOISY_M, cross_profile, height_noise, plain_heights
from unveil_core.ground.street_fit import fit_street_heights


def true_height(s: Float64, t: Float64) -> Float64:
    """A crest, and a crossfall of two per cent to both sides."""
    return 1.5 * np.sin(s / 25) - 0.002 * np.square(t)


def noisy_points(share: float, seed: int = 0) -> tuple[Float64, Float64]:
    """Street coordinates of surfels, of which a share sank, all of those far to the left, and of measured points, some of which lie
    on cars."""
    rng = np.random.default_rng(seed)
    s, t = rng.uniform(0, 60, 20_000), rng.uniform(-7, 7, 20_000)
    sunk = (rng.uniform(size=len(s)) < share) | ((t > 4.5) & (rng.uniform(size=len(s)) < 0.9))
    h = true_height(s, t) + rng.normal(0, 0.05, len(s)) - sunk * rng.uniform(0.1, 0.8, len(s))
    at, aside = rng.uniform(0, 60, 400), rng.uniform(-7, 7, 400)
    on_car = rng.uniform(size=400) < 0.2
    measured = true_height(at, aside) + rng.normal(0, 0.03, 400) + on_car * rng.uniform(0.3, 1.0, 400)
    return np.column_stack([s, t, h]), np.column_stack([at, aside, measured])


def errors(ground: street_fit.Ground) -> Float64:
    s, t = (g.ravel() for g in np.meshgrid(np.arange(3, 57, 1.5), np.arange(-6.5, 7, 0.5)))
    return np.abs(ground.height_at(s, t) - true_height(s, t))


@pytest.mark.parametrize(("measured", "most"), [(True, 0.06), (False, 0.15)])
def test_sunk_surfels_do_not_pull_the_street_down(measured: bool, most: float, monkeypatch: pytest.MonkeyPatch) -> None:
    surfels, sure = (PATH.to_world(p) for p in noisy_points(0.4))
    ground = fit_street_heights(PATH, surfels, sure=sure if measured else None)
    assert np.percentile(errors(ground), 90) < most
    monkeypatch.setattr(street_fit, "NOISY_M", np.inf)
    assert np.percentile(errors(fit_street_heights(PATH, surfels, sure=sure)), 90) > 0.3


@given(grade=st.floats(-0.3, 0.3), noise=st.floats(0.0, 0.03))
@settings(max_examples=20, deadline=None)
def test_a_steep_street_is_not_noisy(grade: float, noise: float) -> None:
    rng = np.random.default_rng(1)
    s, t = rng.uniform(0, 40, 8000), rng.uniform(-4, 4, 8000)
    clean = np.column_stack([s, t, grade * s + rng.normal(0, noise, len(s))])
    assert height_noise(clean) < NOISY_M
    assert height_noise(clean + np.array([0, 0, 1]) * rng.normal(0, 0.15, (len(s), 1))) > NOISY_M


def test_where_points_are_right_kerbs_stay() -> None:
    points = street_points(60.0, 0.03)
    assert height_noise(PATH.to_street(points)) < 0.02
    ground = fit_street_heights(PATH, points, sure=points + (0, 0, 1))  # which nobody asks
    height = ground.height_at(np.full(2, 20.0), np.array([3.5, 4.5]))
    assert abs(height[1] - height[0] - 0.12) < 0.03


def test_without_points_nothing_is_noisy() -> None:
    assert height_noise(np.zeros((0, 3))) == 0
    assert height_noise(np.array([[1.0, 0, 0], [1.1, 0, 5.0]])) == 0


def test_the_height_stays_beyond_what_counts() -> None:
    surfels, sure = noisy_points(0.2)
    s, t = np.arange(0.0, 60.0), np.array([-30.0, -8.0, 0.0, 8.0, 30.0])
    height = plain_heights(surfels, sure, s, t, np.zeros(60))
    assert np.array_equal(height[:, 0], height[:, 1]) and np.array_equal(height[:, 3], height[:, 4])


def test_the_cross_profile_has_the_kerbs_of_all_that_agree() -> None:
    rng = np.random.default_rng(5)
    t = rng.uniform(-6, 6, 8000)
    kerbs = np.where(t > 4, 0.14, np.where(t < -3, 0.1, 0.0))
    over = kerbs + rng.normal(0, 0.02, len(t)) + (rng.uniform(size=len(t)) < 0.2) * rng.uniform(0.1, 2.0, len(t))
    offsets = np.arange(-8.0, 8.01, 0.2)
    found = cross_profile(np.column_stack([t, over]), offsets)
    clear = (np.abs(offsets - 4) > 0.15) & (np.abs(offsets + 3) > 0.15)
    truth = np.where(offsets > 4, 0.14, np.where(offsets < -3, 0.1, 0.0))
    assert np.abs(found - truth)[clear].max() < 0.015
    assert not cross_profile(np.zeros((5, 2)), offsets).any()
