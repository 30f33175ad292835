"""Drives through worlds that are not the street of the model: nothing breaks, and charts do no harm there.

The other worlds, which take longer, are in ``tests/slow/``.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.hard_drives import DRAFT
from tests.hard_worlds import (
    BRICK,
    HOUSES,
    PLASTER,
    RED,
    STONE,
    WHITE,
    assert_harmless,
    bend_ground,
    facade,
    orbit,
    outcome,
    pavement,
    quarter_turn,
    with_stop,
)
from tests.worlds.box_worlds import BUILDING, CAR, PERSON, TRUCK, WALL, Box, Lens, World, make_box_world, straight
from unveil_core.pipeline.run import run
from unveil_core.workspace.assumptions import recorded_assumptions

TRAIN = 16
PARKED = Box((9.0, -2.6, 0.7), (4.0, 1.8, 1.4), CAR, RED, removed=True)


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
    sky = done.assumed["the sky is above"]
    assert not sky.holds
    assert sky.message() in done.said


def test_a_stop_with_noise_lengthens_no_way(tmp_path: Path) -> None:
    """At the end of the way: there the path is prolonged, and noise would bend it by metres."""
    done = outcome(tmp_path, World([*HOUSES, PARKED]), with_stop(straight(0.0, 6.0, 7, y=0.3), 6, 5))
    assert_harmless(done, 5000)
    assert done.assumed["the way is one street"].holds
    assert done.assumed["the camera drives"].found == "6.0 m of way"


def test_an_orbit_is_filled_as_without_charts(tmp_path: Path) -> None:
    houses = [facade((-14, 14), (9, 11), PLASTER), facade((-14, 14), (-11, -9), BRICK)]
    car = Box((0.0, 0.0, 0.7), (3.6, 1.7, 1.4), CAR, RED, removed=True)
    done = outcome(tmp_path, World([*houses, car], pavement), orbit(4.5, 12))
    assert done.unchanged
    assert done.removed_px > 10000
    assert done.ours == pytest.approx(done.plain, abs=1e-6)
    street = done.assumed["the way is one street"]
    assert not street.holds
    assert street.message() in done.said
    assert "without charts" in street.message()
    # Without a chart nobody asks.
    assert "the sun shines" not in done.assumed


def test_an_overcast_street_has_no_sun(tmp_path: Path) -> None:
    done = outcome(tmp_path, World([*HOUSES, PARKED]), straight(0.0, 6.0, 7, y=0.3))
    assert_harmless(done, 3000)
    sun = done.assumed["the sun shines"]
    assert sun.message() in done.said
    assert sun.instead == (
        "what is dark within 2 m of a removed object counts as its shadow, as far as it is darker there than around footprints "
        "planted elsewhere, and ends there"
    )
    for name in (
        "the sky is above",
        "paint and kerbs run along the street",
        "walls of houses are parallel to the street",
    ):
        assert done.assumed[name].holds, name


def test_a_sun_that_was_given_is_not_called_tested(tmp_path: Path) -> None:
    drive = make_box_world(tmp_path / "drive", World([*HOUSES, PARKED]), straight(0.0, 6.0, 7, y=0.3))
    workspace = run(drive, tmp_path / "workspace", replace(DRAFT, shadows="135,40"), until="inpaint")
    stages = json.loads((workspace.root / "workspace.json").read_text())["stages"]
    assert stages["inpaint"]["sun"] == {"azimuth_deg": 135.0, "elevation_deg": 40.0, "given": True}
    (sun,) = (a for _, a in recorded_assumptions(stages) if a.name == "the sun shines")
    assert sun.found == "azimuth 135, elevation 40 degrees, as given, not tested"


def test_behind_a_lorry_of_eighteen_metres_the_street_goes_on(tmp_path: Path) -> None:
    lorry = Box((18.0, -3.0, 2.0), (18.0, 2.5, 4.0), TRUCK, WHITE, removed=True)
    done = outcome(tmp_path, World([*HOUSES, lorry]), straight(0.0, 28.0, 8, y=0.4))
    assert_harmless(done, 6000)
    assert done.assumed["the way is one street"].holds
    assert done.assumed["facades stand along the street"].found == "on 2 of 2 sides, completed on 1"


def test_a_rig_that_looks_all_around_is_one_street(tmp_path: Path) -> None:
    van = Box((5.0, 2.6, 1.2), (5.0, 2.0, 2.4), CAR, WHITE, removed=True)
    yaws = {"front": 0.0, "left": 70.0, "right": -70.0, "rear": 180.0}
    lenses = [Lens(name, yaw, size=(64, 44), focal=40.0) for name, yaw in yaws.items()]
    done = outcome(tmp_path, World([*HOUSES, van]), straight(0.0, 8.0, 5, y=-0.8, lenses=lenses))
    assert_harmless(done, 6000)
    assert done.assumed["the way is one street"].holds
    assert done.assumed["the camera drives"].found == "8.0 m of way"


def test_a_train_that_is_longer_than_a_vehicle_is_named(tmp_path: Path) -> None:
    train = Box((16.0, -3.2, 1.8), (30.0, 2.5, 3.6), TRAIN, WHITE, removed=True)
    drive = make_box_world(tmp_path / "drive", World([*HOUSES, train]), straight(0.0, 28.0, 8, y=0.4), rays=6000)
    events: list[dict[str, Any]] = []
    run(drive, tmp_path / "workspace", DRAFT, until="remove", reporter=events.append)
    (line,) = [str(e["message"]) for e in events if "one vehicle" in str(e.get("message"))]
    found = re.search(r"train \d+: (\d+\.\d) m long\)", line)
    assert found is not None
    # Of its ends the drive shows less.
    assert 25 < float(found[1]) < 31
