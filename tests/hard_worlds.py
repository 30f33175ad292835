"""Drives through worlds that are not the street of the model, and what a run makes of them."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tests.hard_drives import DRAFT, unchanged_outside
from tests.worlds.box_worlds import (
    BUILDING,
    ROAD,
    SIDEWALK,
    Box,
    Lens,
    Way,
    World,
    make_box_world,
)
from unveil_core.base.pictures.decoding import read_image, read_label_image
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
        assumed: by name; said: the notices of the run.
        unchanged: whether all frames are there, and equal the photographs where nothing was removed.
        removed_px: pixels that were removed, of all frames; ours, plain: PSNR there, with and without charts.
    """

    assumed: dict[str, Assumption]
    said: tuple[str, ...]
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
    events: list[dict[str, Any]] = []
    workspace = run(drive, folder / "workspace", DRAFT, until="deliver", reporter=events.append)
    stages = json.loads((workspace.root / "workspace.json").read_text())["stages"]
    ours, count = removed_psnr(workspace.root, drive)
    copy = Workspace.open(shutil.copytree(workspace.root, folder / "plain", ignore=shutil.ignore_patterns(".lock")))
    run_stages(
        copy, [replace(stage_named("inpaint"), run=partial(inpaint_with, charts=False), variant="plain")], DRAFT, drive
    )
    plain, _ = removed_psnr(copy.root, drive)
    found = {a.name: a for _, a in recorded_assumptions(stages)}
    said = tuple(str(e["message"]) for e in events if e.get("level") == "notice")
    return Outcome(found, said, unchanged_outside(workspace.root, drive), count, ours, plain)


def assert_harmless(done: Outcome, least_px: int) -> None:
    """Nothing but what was removed is changed, and there charts are no worse than none."""
    assert done.unchanged
    assert done.removed_px > least_px
    assert done.ours >= done.plain + LEAST_GAIN_DB, f"{done.ours:.2f} dB, without charts {done.plain:.2f} dB"
    for name in ("lengths are in metres", "the camera drives", "the ground was seen", "labels tell the ground"):
        assert done.assumed[name].holds, name
    # Boxes cast no shadows here.
    assert not done.assumed["the sun shines"].holds


def orbit(radius: float, count: int) -> Way:
    """A way to the left around (0, 0), with a camera that looks at it, 1.6 m over the ground."""
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    places = [(float(radius * np.cos(a)), float(radius * np.sin(a)), 1.6) for a in angles]
    return Way(places, [float(np.degrees(a)) + 90 for a in angles], [Lens(yaw=90.0)])


def with_stop(way: Way, at: int, count: int) -> Way:
    """The way with ``count`` more frames at one of its places, where poses are off by 1 cm along each axis and 0.2 degrees."""
    generator = np.random.default_rng(0)
    order = sorted([*range(len(way.places)), *[at] * count])
    noise = [generator.normal(size=4) * (0.01, 0.01, 0.01, 0.2) * (k == at) for k in order]
    places, headings = [way.places[k] for k in order], [way.headings[k] for k in order]
    return Way(places, headings, way.lenses, [list(map(float, n)) for n in noise])


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
