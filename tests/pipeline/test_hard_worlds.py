"""Drives through worlds that are not the street of the model: nothing breaks, and charts do no harm there."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from sample_scenes.box_worlds import (
    BUILDING,
    CAR,
    PERSON,
    ROAD,
    SIDEWALK,
    TRUCK,
    WALL,
    Box,
    Lens,
    Way,
    World,
    make_box_world,
    straight,
)
from tests.hard_drives import DRAFT, unchanged_outside
from unveil_core.base.files import read_image, read_label_image
from unveil_core.evaluate.metrics import psnr_of_mse, squared_error
from unveil_core.pipeline.run import run, stage_named
from unveil_core.pipeline.runner import run_stages
from unveil_core.pipeline.steps.inpaint import inpaint_with
from unveil_core.workspace.assumptions import Assumption, recorded_assumptions
from unveil_core.workspace.workspace import Workspace

LEAST_GAIN_DB = -0.5
"""Against frames filled one by one, without charts: so much is chance."""
BRICK, PLASTER, STONE = (0.62, 0.36, 0.28), (0.72, 0.66, 0.5), (0.5, 0.52, 0.5)
RED, WHITE = (0.75, 0.1, 0.1), (0.85, 0.85, 0.88)


@dataclass(frozen=True)
class Outcome:
    """What a run says and does.

    Attributes:
        assumed: by name.
        unchanged: whether all frames are there, and equal the photographs where nothing was removed.
        removed_px: pixels that were removed, of all frames; ours, plain: PSNR there, with and without charts.
    """

    assumed: dict[str, Assumption]
    unchanged: bool
    removed_px: int
    ours: float
    plain: float


def removed_psnr(root: Path, drive: Path) -> tuple[float, int]:
    """PSNR of the filled frames against the empty world where something was removed, and the number of pixels there."""
    errors = []
    for true in sorted((drive.parent / "truth/images").rglob("*.png")):
        name = true.relative_to(drive.parent / "truth/images")
        gone = read_label_image(root / "masks/removed" / name) > 0
        errors.append(squared_error(read_image(root / "inpainted" / name), read_image(true))[gone])
    pooled = np.concatenate(errors)
    return psnr_of_mse(float(pooled.mean())), len(pooled)


def outcome(folder: Path, world: World, way: Way) -> Outcome:
    """A whole run through a world, and its frames filled once more without charts."""
    drive = make_box_world(folder / "drive", world, way)
    workspace = run(drive, folder / "workspace", DRAFT, until="deliver")
    stages = json.loads((workspace.root / "workspace.json").read_text())["stages"]
    ours, count = removed_psnr(workspace.root, drive)
    copy = Workspace.open(shutil.copytree(workspace.root, folder / "plain", ignore=shutil.ignore_patterns(".lock")))
    run_stages(
        copy, [replace(stage_named("inpaint"), run=partial(inpaint_with, charts=False), variant="plain")], DRAFT, drive
    )
    plain, _ = removed_psnr(copy.root, drive)
    found = {a.name: a for _, a in recorded_assumptions(stages)}
    return Outcome(found, unchanged_outside(workspace.root, drive), count, ours, plain)


def assert_harmless(done: Outcome, least_px: int) -> None:
    """Nothing but what was removed is changed, and there charts are no worse than none."""
    assert done.unchanged
    assert done.removed_px > least_px
    assert done.ours >= done.plain + LEAST_GAIN_DB, f"{done.ours:.2f} dB, without charts {done.plain:.2f} dB"
    for name in ("lengths are in metres", "the camera drives", "the ground was seen", "labels tell the ground"):
        assert done.assumed[name].holds, name
    # Boxes cast no shadows here.
    assert not done.assumed["the sun shines"].holds


def quarter_turn(radius: float, before: float, after: float, step: float) -> Way:
    """A way along x that turns to the left by a right angle from (0, 0) on, 1.6 m over the ground."""
    arc = radius * np.pi / 2
    places, headings = [], []
    for s in np.arange(-before, arc + after, step):
        angle = np.clip(s / radius, 0, np.pi / 2)
        x, y = radius * np.sin(angle) + min(s, 0), radius * (1 - np.cos(angle)) + max(s - arc, 0)
        places.append((float(x), float(y), 1.6))
        headings.append(float(np.degrees(angle)))
    return Way(places, headings)


def bend_ground(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(N,) classes along that way with a radius of 6 m: 3.5 m of road to both sides."""
    arc = np.where((x > 0) & (y < 6), np.abs(np.hypot(x, y - 6) - 6), np.inf)
    aside = np.minimum(arc, np.minimum(np.where(x <= 0, np.abs(y), np.inf), np.where(y >= 6, np.abs(x - 6), np.inf)))
    return np.where(aside < 3.5, ROAD, SIDEWALK)


def pavement(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(N,) classes where all ground is paved with slabs."""
    return np.full(x.shape, SIDEWALK)


def facade(
    x: tuple[float, float], y: tuple[float, float], color: tuple[float, float, float], height: float = 6.0
) -> Box:
    """A house with windows between these limits."""
    centre, size = ((x[0] + x[1]) / 2, (y[0] + y[1]) / 2, height / 2), (x[1] - x[0], y[1] - y[0], height)
    return Box(centre, size, BUILDING, color, windows=True)


HOUSES = (facade((-10, 60), (6.5, 9), PLASTER), facade((-10, 60), (-9, -6.5), BRICK))


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


def test_behind_a_lorry_of_eighteen_metres_the_street_goes_on(tmp_path: Path) -> None:
    lorry = Box((21.0, -3.0, 2.0), (18.0, 2.5, 4.0), TRUCK, WHITE, removed=True)
    done = outcome(tmp_path, World([*HOUSES, lorry]), straight(0.0, 33.0, 10, y=0.4))
    assert_harmless(done, 10000)
    assert done.assumed["the way is one street"].holds
    assert done.assumed["facades stand along the street"].found == "on 2 of 2 sides, completed on 1"


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
