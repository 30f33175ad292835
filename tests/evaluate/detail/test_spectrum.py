"""What the bands of the spectrum say of blur, grain and the region's border."""

from __future__ import annotations

import numpy as np
import pytest

from tests.evaluate.detail.pictures import HEIGHT, WIDTH, blurred, grained, road
from unveil_core.evaluate.detail.spectrum import BANDS_PX, Spectrum


def holes(seed: int) -> np.ndarray:
    """(H, W) a region of scattered rectangles."""
    rng, mask = np.random.default_rng(seed), np.zeros((HEIGHT, WIDTH), dtype=bool)
    for _ in range(6):
        row, column = rng.integers(0, HEIGHT - 40), rng.integers(0, WIDTH - 40)
        mask[row : row + rng.integers(12, 90), column : column + rng.integers(12, 90)] = True
    return mask


def ratios(region: np.ndarray, picture: np.ndarray, truth: np.ndarray) -> np.ndarray:
    spectrum = Spectrum(region)
    return np.sqrt(np.divide(spectrum.energies(picture), spectrum.energies(truth)))


def wave(length_px: float) -> np.ndarray:
    """(H, W, 3) stripes of this wavelength, 40 levels up and down."""
    levels = 128 + 40 * np.sin(2 * np.pi * (np.arange(WIDTH) + 0.25) / length_px)
    return np.broadcast_to(np.round(levels)[None, :, None], (HEIGHT, WIDTH, 3)).astype(np.uint8)


@pytest.mark.parametrize("seed", range(4))
def test_equal_pictures_have_equal_bands_and_blur_takes_most_of_the_finest(seed: int) -> None:
    picture, region = grained(road(), 12.0, seed), holes(seed)
    assert (ratios(region, picture, picture) == 1).all()
    for sigma in (0.6, 1.0, 2.0):
        found = ratios(region, blurred(picture, sigma), picture)
        assert (np.diff(found) > 0).all() and found[0] < 0.75


@pytest.mark.parametrize("seed", range(4))
def test_noise_raises_the_finest_band_most_and_by_its_strength(seed: int) -> None:
    picture, region = grained(blurred(road(), 3.0), 4.0, seed), holes(seed)
    found = [ratios(region, grained(picture, levels, 9), picture) for levels in (2.0, 6.0, 12.0)]
    assert (np.diff(found, axis=0) > 0).all() and (np.asarray(found) > 1).all()
    assert all(of[0] == of.max() for of in found)


@pytest.mark.parametrize("number", range(len(BANDS_PX)))
def test_a_wave_is_in_its_own_band(number: int) -> None:
    energies = Spectrum(np.ones((HEIGHT, WIDTH), dtype=bool)).energies(wave(BANDS_PX[number] / 2**0.5))
    assert int(np.argmax(energies)) == number and energies[number] > 0.4 * sum(energies)


@pytest.mark.parametrize("seed", range(4))
def test_what_lies_beyond_the_region_does_not_count(seed: int) -> None:
    picture, region = grained(road(), 12.0, seed), holes(seed)
    other = np.where(region[..., None], picture, 255 - picture)
    assert Spectrum(region).energies(other) == Spectrum(region).energies(picture)
    flat = np.where(region[..., None], np.uint8(90), picture)
    assert Spectrum(region).energies(flat) == pytest.approx((0.0,) * len(BANDS_PX), abs=1e-3)


def test_an_empty_region_has_no_energy_and_another_size_is_refused() -> None:
    empty = Spectrum(np.zeros((HEIGHT, WIDTH), dtype=bool))
    assert empty.energies(road()) == (0.0,) * len(BANDS_PX)
    with pytest.raises(ValueError, match="does not fit"):
        empty.energies(road()[1:])
