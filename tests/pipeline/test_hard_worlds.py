"""Drives through worlds that are not the street of the model: nothing breaks, and charts do no harm there.

The other worlds, which take longer, are in ``benchmarks/quality/``.
"""

from __future__ import annotations

from pathlib import Path

from sample_scenes.box_worlds import BUILDING, CAR, PERSON, WALL, Box, World, straight
from tests.hard_worlds import (
    BRICK,
    PLASTER,
    RED,
    STONE,
    WHITE,
    assert_harmless,
    bend_ground,
    facade,
    outcome,
    pavement,
    quarter_turn,
)


def test_a_turn_of_six_metres_is_a_street(tmp_path: Path) -> None:
    houses = [
        facade((-14, 0.5), (5.5, 18), PLASTER),
        facade((-14, 13), (-8, -5.5), BRICK),
        facade((11.5, 14), (-5.5, 25), STONE),
    ]
    car = Box((6.1, -0.1, 0.7), (3.8, 1.7, 1.4), CAR, RED, yaw=45.0, removed=True)
    done = outcome(tmp_path, World([*houses, car], bend_ground), quarter_turn(6.0, 5.0, 3.4, 1.9))
    assert_harmless(done, 3500)
    assert done.assumed["the way is one street"].holds
    assert done.assumed["facades stand along the street"].holds


def test_a_corridor_is_no_worse_for_charts(tmp_path: Path) -> None:
    walls = [
        Box((6.0, 1.6, 1.3), (16.0, 0.2, 2.6), WALL, PLASTER),
        Box((6.0, -1.6, 1.3), (16.0, 0.2, 2.6), WALL, BRICK),
        Box((14.1, 0.0, 1.3), (0.2, 3.4, 2.6), WALL, STONE),
        Box((6.0, 0.0, 2.7), (16.4, 3.4, 0.2), BUILDING, WHITE),
    ]
    person = Box((6.5, -0.6, 0.85), (0.35, 0.5, 1.7), PERSON, RED, removed=True)
    done = outcome(tmp_path, World([*walls, person], pavement), straight(0.0, 4.5, 8))
    assert_harmless(done, 3000)
    assert done.assumed["the camera drives"].found == "4.5 m of way"
    # Its walls are no houses.
    assert not done.assumed["facades stand along the street"].holds
