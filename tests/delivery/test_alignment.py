"""A small shift of one photograph against another."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from unveil_core.delivery.alignment import MOST_PX, find_shift, shift_planes
from unveil_core.geometry.images import sample_at


def texture(seed: int = 0) -> np.ndarray:
    grain = np.random.default_rng(seed).normal(0, 1, (160, 240)).astype(np.float32)
    return np.clip(128 + 400 * cv2.GaussianBlur(grain, (0, 0), 3.0), 0, 255)


def positions(count: int = 3000) -> np.ndarray:
    return np.random.default_rng(2).uniform((20, 20), (220, 140), (count, 2))


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.4, -0.3), (-2.3, 1.2), (3.1, 0.8)])
def test_a_shift_is_found_in_another_light(shift: tuple[float, float]) -> None:
    picture, at = texture(), positions()
    shown = 0.8 * sample_at(picture, at + shift, cv2.INTER_CUBIC)[:, 0] + 15
    noisy = shown + np.random.default_rng(3).normal(0, 3, len(at)).astype(np.float32)
    np.testing.assert_allclose(find_shift(shift_planes(picture), at, noisy), shift, atol=0.1)


def test_what_stands_elsewhere_does_not_pull() -> None:
    picture, at = texture(), positions()
    shown = sample_at(picture, at + (1.0, 0.5), cv2.INTER_CUBIC)[:, 0]
    shown[::6] = 5.0  # a sixth shows something else
    np.testing.assert_allclose(find_shift(shift_planes(picture), at, shown), (1.0, 0.5), atol=0.1)


def test_no_shift_is_better_than_one_that_does_not_help() -> None:
    at = positions()
    plain = np.full((160, 240), 90.0, np.float32)
    assert (find_shift(shift_planes(plain), at, np.full(len(at), 60.0, np.float32)) == 0).all()
    other = sample_at(texture(7), at)[:, 0]
    found = find_shift(shift_planes(texture(8)), at, other)
    assert np.abs(found).max() <= MOST_PX
    error = [np.abs((other - sample_at(texture(8), at + s)[:, 0])[1::2]).mean() for s in (found, np.zeros(2))]
    assert error[0] < error[1] + 1.0
