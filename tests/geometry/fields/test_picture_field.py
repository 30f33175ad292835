"""A field over a picture is found from the same places seen at several pixels, whatever the places themselves are."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.geometry.fields.picture_field import PictureField, fit_fields

SIZE, TOP = (320, 200), 80.0
PLACES, TIMES = 1500, 6


def vignetting(pixels: np.ndarray, strength: float = 0.8) -> np.ndarray:
    """(N, 1) darker towards the corners, brighter towards the horizon."""
    away = np.hypot(pixels[:, 0] / SIZE[0] - 0.5, pixels[:, 1] / SIZE[1] - 0.5)
    return (-strength * away**2 + 0.3 * (1 - (pixels[:, 1] - TOP) / (SIZE[1] - TOP)))[:, None]


def seen(
    rng: np.random.Generator, factor, outliers: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:  # type: ignore[no-untyped-def]
    """Number of each look's place, its pixel, what it shows, and its weight."""
    place = np.repeat(np.arange(PLACES), TIMES)
    pixels = rng.uniform((0, TOP), SIZE, (len(place), 2))
    shown = rng.normal(0, 1, PLACES)[place, None] + factor(pixels) + rng.normal(0, 0.02, (len(place), 1))
    wrong = rng.random(len(place)) < outliers
    shown[wrong] += rng.uniform(-2, 2, (int(wrong.sum()), 1))
    return place, pixels, shown, np.ones(len(place))


def difference(field: PictureField, factor) -> np.ndarray:  # type: ignore[no-untyped-def]
    """At a grid of pixels, field less factor, without what is the same everywhere."""
    x, y = np.meshgrid(np.linspace(5, SIZE[0] - 5, 20), np.linspace(TOP + 5, SIZE[1] - 5, 20))
    pixels = np.stack([x.ravel(), y.ravel()], axis=1)
    left = field.at(pixels) - factor(pixels)
    return left - left.mean()


@pytest.mark.parametrize("outliers", [0.0, 0.15])
def test_the_field_is_found_up_to_a_constant(outliers: float) -> None:
    place, pixels, shown, weight = seen(np.random.default_rng(0), vignetting, outliers)
    start = PictureField.flat(SIZE, TOP, 1)
    (field,) = fit_fields([start], np.zeros(len(place), np.int64), place, pixels, shown, weight)
    assert np.abs(difference(start, vignetting)).max() > 0.3
    assert np.abs(difference(field, vignetting)).max() < 0.05


def test_two_cameras_that_see_the_same_places_have_each_their_own() -> None:
    rng = np.random.default_rng(1)
    place, pixels, shown, weight = seen(rng, lambda p: np.zeros((len(p), 1)))
    camera = rng.integers(0, 2, len(place))
    factors = (vignetting, lambda p: vignetting(p, -0.4) + 0.2)
    for k, factor in enumerate(factors):
        shown[camera == k] += factor(pixels[camera == k])
    fields = fit_fields([PictureField.flat(SIZE, TOP, 1)] * 2, camera, place, pixels, shown, weight)
    for field, factor in zip(fields, factors, strict=True):
        assert np.abs(difference(field, factor)).max() < 0.06
    middle = np.array([[160.0, 140.0]])
    between = float(fields[1].at(middle)[0, 0] - fields[0].at(middle)[0, 0])
    assert between == pytest.approx(float((factors[1](middle) - factors[0](middle))[0, 0]), abs=0.05)


def test_what_each_place_shows_once_tells_nothing() -> None:
    rng = np.random.default_rng(2)
    pixels = rng.uniform((0, TOP), SIZE, (500, 2))
    shown, number = vignetting(pixels), np.arange(500)
    (field,) = fit_fields(
        [PictureField.flat(SIZE, TOP, 1)], np.zeros(500, np.int64), number, pixels, shown, np.ones(500)
    )
    assert np.abs(field.values).max() < 1e-6


def test_a_plane_has_the_field_at_its_pixels() -> None:
    field = PictureField(np.random.default_rng(3).normal(size=(17, 13, 3)), SIZE, TOP)
    plane = field.plane()
    assert plane.shape == (SIZE[1], SIZE[0], 3)
    np.testing.assert_allclose(plane[120, 37], field.at(np.array([[37.5, 120.5]]))[0], atol=1e-6)
    np.testing.assert_allclose(plane[0], plane[int(TOP) - 1], atol=1e-6)  # above the first row it goes on
