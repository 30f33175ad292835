"""What is known of a plane is carried as far as the plane itself goes on, and no farther."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from unveil_core.geometry.fields.covariance import ladder, measured_covariance
from unveil_core.geometry.fields.kriging import kriged

TEXEL = 0.08
SHAPE = (400, 120)


def plane(rng: np.random.Generator, along: float, across: float) -> np.ndarray:
    """(A, B, 3) smooth chance over so many texels, with a mean of 0.5 and a deviation of 0.1."""
    noise = rng.normal(0, 1, (*SHAPE, 1)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), sigmaX=across, sigmaY=along)[..., None]
    return np.repeat(0.5 + 0.1 * smooth / smooth.std(), 3, axis=2).astype(np.float32)


def hole(rows: int, columns: int) -> np.ndarray:
    """(A, B) in the middle of the plane."""
    mask = np.zeros(SHAPE, dtype=bool)
    row, column = SHAPE[0] // 2, SHAPE[1] // 2
    mask[row - rows // 2 : row + rows // 2, column - columns // 2 : column + columns // 2] = True
    return mask


def test_a_covariance_is_measured_in_spite_of_holes() -> None:
    rng = np.random.default_rng(0)
    values = plane(rng, 12.0, 12.0) - 0.5
    weight = (rng.random(SHAPE) < 0.7).astype(np.float32)
    found = measured_covariance(values, weight, *ladder(5, endless=True))
    kernel = found.kernel(SHAPE)
    # A Gaussian blur of chance: its covariance is a Gaussian of sqrt(2) of the width.
    for lag in (0, 10, 20, 30):
        true = 0.01 * np.exp(-0.25 * (lag / 12.0) ** 2)
        assert abs(kernel[lag, 0] - true) < 0.0015
        assert abs(kernel[0, lag] - true) < 0.0015
    assert found.noise < 0.001


def test_stripes_along_the_street_are_carried_through_a_long_hole() -> None:
    rng = np.random.default_rng(1)
    stripes = plane(rng, 1e-2, 6.0)[:1].repeat(SHAPE[0], axis=0) + rng.normal(0, 0.01, (*SHAPE, 3)).astype(np.float32)
    wanted = hole(200, 40)
    found = kriged(stripes.astype(np.float32), ~wanted, TEXEL)
    assert np.abs(found.all - stripes)[wanted].mean() < 0.02


def test_patches_of_light_are_carried_no_farther_than_they_are_large() -> None:
    """In the middle of a hole much larger than its patches a plane is what it is on the mean."""
    rng = np.random.default_rng(2)
    patches = plane(rng, 8.0, 8.0)
    wanted = hole(200, 90)
    found = kriged(patches, ~wanted, TEXEL).all
    middle = found[SHAPE[0] // 2 - 40 : SHAPE[0] // 2 + 40, SHAPE[1] // 2 - 10 : SHAPE[1] // 2 + 10]
    assert middle.std() < 0.03
    assert abs(float(middle.mean()) - 0.5) < 0.05


def test_it_is_better_than_the_nearest_known_and_than_the_mean() -> None:
    rng = np.random.default_rng(3)
    values = plane(rng, 30.0, 10.0)
    wanted = hole(60, 60)
    known = np.where(wanted[..., None], 0, values).astype(np.float32)
    found = kriged(known, ~wanted, TEXEL).all
    filled = cv2.inpaint((known[..., 0] * 255).astype(np.uint8), wanted.astype(np.uint8), 3, cv2.INPAINT_TELEA) / 255.0
    error = np.abs(found - values)[wanted].mean()
    assert error < 0.7 * np.abs(filled - values[..., 0])[wanted].mean()
    assert error < 0.7 * np.abs(values - 0.5)[wanted].mean()


@pytest.mark.parametrize("share", [0.0, 1e-4])
def test_of_hardly_anything_known_the_mean_is_carried(share: float) -> None:
    rng = np.random.default_rng(4)
    values = plane(rng, 30.0, 10.0)
    found = kriged(values, rng.random(SHAPE) < share, TEXEL).all
    assert np.isfinite(found).all()
    assert np.abs(found - 0.5).max() < 0.5


def test_one_colour_stays_that_colour_and_a_single_texel_is_no_error() -> None:
    flat = np.full((*SHAPE, 3), 0.3, dtype=np.float32)
    assert np.abs(kriged(flat, ~hole(100, 50), TEXEL).all - 0.3).max() < 1e-5
    assert kriged(flat[:1, :1], np.ones((1, 1), dtype=bool), TEXEL).all.shape == (1, 1, 3)
