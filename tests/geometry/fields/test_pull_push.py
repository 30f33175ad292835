"""Known pixels carried smoothly to where none are."""

from __future__ import annotations

import numpy as np

from unveil_core.geometry.fields.pull_push import pull_push

SHAPE = (45, 70)


def known_border(width: int = 6) -> np.ndarray:
    weight = np.ones(SHAPE, np.float32)
    weight[width:-width, width:-width] = 0
    return weight


def test_what_is_known_stays() -> None:
    values = np.random.default_rng(0).random((*SHAPE, 3)).astype(np.float32)
    np.testing.assert_allclose(pull_push(values, np.ones(SHAPE, np.float32)), values, atol=1e-6)
    found = pull_push(values, known_border())
    np.testing.assert_allclose(found[:4, :4], values[:4, :4], atol=1e-6)


def test_a_constant_reaches_everywhere() -> None:
    weight = np.zeros(SHAPE, np.float32)
    weight[3, 5] = 1
    for first in (0, 2, 30):
        found = pull_push(np.full((*SHAPE, 2), 7.0, np.float32), weight, first)
        assert found.shape == (*SHAPE, 2)
        np.testing.assert_allclose(found, 7.0, rtol=1e-4)


def test_a_ramp_goes_on_through_a_hole() -> None:
    ramp = np.broadcast_to(np.linspace(0, 100, SHAPE[1], dtype=np.float32)[None, :, None], (*SHAPE, 1))
    weight = known_border()
    found = pull_push(np.where(weight[..., None] > 0, ramp, 1e4), weight)
    inside = weight == 0
    assert np.abs(found - ramp)[inside].mean() < 8  # of 100; the nearest known pixel would be off by 20 in the mean
    assert np.abs(found - ramp)[inside].max() < 25


def test_grain_is_averaged_over_the_first_grids() -> None:
    noise = np.random.default_rng(1).normal(0, 1, (*SHAPE, 1)).astype(np.float32)
    everywhere = np.ones(SHAPE, np.float32)
    rough, smooth = (pull_push(noise, everywhere, first).std() for first in (0, 3))
    assert smooth < 0.25 * rough
