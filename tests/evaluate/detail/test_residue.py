"""What counts as left behind of a removed object."""

from __future__ import annotations

import numpy as np
import pytest

from tests.evaluate.detail.pictures import HEIGHT, WIDTH, grained, road
from unveil_core.evaluate.detail.residue import find_residue, nearest_object
from unveil_core.geometry.images import smoothed

CAR = (slice(80, 160), slice(200, 320))
RED = (170, 30, 30)


@pytest.fixture
def crowded() -> np.ndarray:
    picture = road()
    picture[CAR] = RED
    return picture


def where() -> np.ndarray:
    mask = np.zeros((HEIGHT, WIDTH), dtype=bool)
    mask[CAR] = True
    return mask


def found(clean: np.ndarray, crowded: np.ndarray) -> np.ndarray:
    return find_residue(*(smoothed(p) for p in (clean, crowded, road())), where(), patch_px=16)


def test_a_perfect_street_has_none_and_an_untouched_one_is_all(crowded: np.ndarray) -> None:
    assert not found(road(), crowded).any()
    assert not found(grained(road(), 4.0), crowded).any()
    assert (found(crowded, crowded) == where()).mean() > 0.999
    assert (found(grained(crowded, 4.0), crowded) == where()).mean() > 0.999


def test_a_patch_is_found_where_it_is_and_a_speck_is_not(crowded: np.ndarray) -> None:
    clean = road()
    clean[100:110, 220:240] = RED
    left = found(clean, crowded)
    assert left[102:108, 222:238].all()
    assert left.sum() <= 200
    speck = road()
    speck[100:103, 220:223] = RED
    assert not found(speck, crowded).any()


def test_a_wrong_filling_is_not_residue(crowded: np.ndarray) -> None:
    clean = road()
    clean[CAR] = (60, 60, 140)
    assert not found(clean, crowded).any()


def test_an_object_of_the_streets_colour_cannot_be_told() -> None:
    grey = road()
    grey[CAR] += 12
    assert not found(grey, grey).any()


def test_shadows_and_borders_belong_to_the_nearest_object() -> None:
    instances = np.zeros((HEIGHT, WIDTH), dtype=np.int64)
    instances[100:120, 50:80], instances[100:120, 200:240] = 7, 3
    owner = nearest_object(instances)
    assert owner[110, 60] == 7 and owner[130, 60] == 7 and owner[110, 130] == 7
    assert owner[110, 150] == 3 and owner[250, 380] == 3
    assert not nearest_object(np.zeros((4, 4), dtype=np.int64)).any()
