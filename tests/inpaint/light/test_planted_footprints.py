"""What is dark near removed objects is their shadow only where planted footprints have nothing like it around them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from unveil_core.base.srgb import linear_light
from unveil_core.geometry.images import within
from unveil_core.inpaint.light.relight import BIN_M, evident_reach, object_shadows, shadows_of_removed
from unveil_core.inpaint.light.shade import Shade

PER_M = 25.0
ROWS, COLUMNS = 1500, 300


def footprints() -> np.ndarray:
    """(A, B) three parked cars in a street 60 m long and 12 m wide."""
    mask = np.zeros((ROWS, COLUMNS), bool)
    for first in (200, 650, 1150):
        mask[first : first + 110, 180:225] = True
    return mask


def blots(seed: int) -> np.ndarray:
    """(A, B) dark blots of half a metre and more all over the street, as the shade of leaves is, about a fifth of it."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(ROWS, COLUMNS)).astype(np.float32), (0, 0), 12)
    return noise > np.quantile(noise, 0.8)


@pytest.mark.parametrize("width_m", [0.6, 1.2])
def test_shadows_are_in_evidence_as_far_as_they_reach(width_m: float) -> None:
    cars = footprints()
    dark = within(cars, width_m * PER_M) & ~cars
    assert abs(evident_reach(dark, ~cars, cars, 2.0, PER_M) - width_m) <= 1.01 * BIN_M


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_what_is_dark_everywhere_is_no_evidence(seed: int) -> None:
    cars = footprints()
    assert evident_reach(blots(seed) & ~cars, ~cars, cars, 2.0, PER_M) <= BIN_M
    ring = within(cars, 0.6 * PER_M)
    assert abs(evident_reach((blots(seed) | ring) & ~cars, ~cars, cars, 2.0, PER_M) - 0.6) <= 1.01 * BIN_M


def test_no_footprint_has_no_shadow() -> None:
    nothing = np.zeros((ROWS, COLUMNS), bool)
    assert evident_reach(blots(0), ~nothing, nothing, 2.0, PER_M) == 0.0


@pytest.mark.parametrize(("length_m", "goes"), [(1.5, True), (12.0, False)])
def test_a_dark_place_that_goes_on_is_no_shadow(length_m: float, goes: bool) -> None:
    """Of the shade of a tree most lies beyond what a car may shade."""
    cars = footprints()
    end = 650
    dark = np.zeros_like(cars)
    dark[end - int(length_m * PER_M) : end, 185:220] = True
    level = np.where(dark, 0.5, 1.0).astype(np.float32)
    zone = within(cars, 2.0 * PER_M)
    shadow = object_shadows(dark, zone, within(cars, 10), np.zeros_like(cars), level, ~cars, per_m=PER_M)
    assert shadow.any() == goes
    assert not (shadow & ~dark).any()


def test_what_has_nothing_seen_around_it_stays() -> None:
    cars = footprints()
    dark = np.zeros_like(cars)
    dark[620:650, 185:220] = True
    level = np.where(dark, 0.5, 1.0).astype(np.float32)
    zone, touched, nothing = within(cars, 50), within(cars, 10), np.zeros_like(cars)
    assert object_shadows(dark, zone, touched, nothing, level, ~cars, per_m=PER_M)[dark].all()
    assert not object_shadows(dark, zone, touched, nothing, level, dark, per_m=PER_M).any()


def test_a_lane_in_the_shade_of_trees_stays_as_it_is_and_a_cars_shadow_goes() -> None:
    """The lane at the kerb lies in shade for 25 m, cars on it and off it; under an even sky each car has its own darkness."""
    cars = footprints()
    lane = np.zeros_like(cars)
    lane[:625, 150:260] = True
    own = within(cars, 0.6 * PER_M) & ~cars
    color = np.full((ROWS, COLUMNS, 3), 0.6, np.float32)
    color[lane], color[own & ~lane] = 0.3, 0.35
    shade = Shade((lane | own) & ~cars, np.ones(3, np.float32), linear_light(np.full_like(color, 0.6)))
    shadow, hopeless = shadows_of_removed(color, ~cars, shade, cars, None, reach_m=2.0, per_m=PER_M)
    assert not (shadow & lane).any()
    assert shadow[own & ~lane].mean() > 0.9
    assert not hopeless.any()
