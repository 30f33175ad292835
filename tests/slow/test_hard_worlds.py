"""Drives through worlds that are not the street of the model: nothing breaks, and charts do no harm there."""

from __future__ import annotations

from pathlib import Path

from tests.hard_worlds import BRICK, HOUSES, PLASTER, RED, STONE, WHITE, assert_harmless, facade, outcome, pavement
from tests.worlds.box_worlds import CAR, TRUCK, Box, Lens, World, straight


def test_behind_a_lorry_of_eighteen_metres_the_street_goes_on(tmp_path: Path) -> None:
    lorry = Box((21.0, -3.0, 2.0), (18.0, 2.5, 4.0), TRUCK, WHITE, removed=True)
    done = outcome(tmp_path, World([*HOUSES, lorry]), straight(0.0, 33.0, 10, y=0.4))
    assert_harmless(done, 10000)
    assert done.assumed["the way is one street"].holds
    assert done.assumed["facades stand along the street"].found == "on 2 of 2 sides, completed on 1"


def test_a_left_camera_beside_a_van_sees_behind_it(tmp_path: Path) -> None:
    van = Box((8.0, 2.6, 1.2), (5.0, 2.0, 2.4), CAR, WHITE, removed=True)
    lenses = [Lens("front"), Lens("left", yaw=70.0, aside=0.5, size=(64, 44), focal=40.0)]
    done = outcome(tmp_path, World([*HOUSES, van]), straight(0.0, 12.0, 7, y=-0.8, lenses=lenses))
    assert_harmless(done, 8000)
    assert done.ours > done.plain + 3
    assert done.assumed["the way is one street"].holds
    assert done.assumed["facades stand along the street"].found == "on 2 of 2 sides, completed on 1"


def test_a_courtyard_has_walls_where_the_street_would_go_on(tmp_path: Path) -> None:
    walls = [
        facade((-5, 15), (6, 7), PLASTER),
        facade((-5, 15), (-7, -6), BRICK),
        facade((14, 15), (-6, 6), STONE),
        facade((-5, -4), (-6, 6), STONE),
    ]
    car = Box((9.0, -2.6, 0.7), (4.0, 1.8, 1.4), CAR, RED, removed=True)
    done = outcome(tmp_path, World([*walls, car], pavement), straight(0.0, 6.0, 9, y=0.3))
    assert_harmless(done, 5000)
    assert done.assumed["the camera drives"].found == "6.0 m of way"
    assert done.assumed["facades stand along the street"].found == "on 2 of 2 sides, completed on 1"
