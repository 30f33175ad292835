"""Starting surfels of a street that only images place."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ground.test_street import drive_on_circle, street_points
from tests.remove.test_regions import surfels_at
from unveil_core.base.types import Float64
from unveil_core.drives.cityscapes import CITYSCAPES
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.level_ground import on_level_ground
from unveil_core.semantics.classes import LabelSet
from unveil_core.surfels.surfels import Surfels

LABELS = LabelSet.cityscapes([CITYSCAPES.index("road"), CITYSCAPES.index("car")])
ROAD, CAR = 0, 1
GRADE = 0.03


def sunk(share: float, radius: float = 60.0) -> tuple[Surfels, Float64]:
    """Surfels of a street with a grade, of which a share sank, and a car on it; and how far each lies over the street."""
    rng = np.random.default_rng(2)
    ground = street_points(radius, GRADE)[::4]
    ground = ground[np.abs(ground @ (0, 0, 1)) < 10]
    low = (rng.uniform(size=len(ground)) < share) * rng.uniform(0.1, 0.8, len(ground))
    off = rng.normal(0, 0.05 if share else 0.005, len(ground)) - low
    car = ground[:50] + (0, 0, 0.2)
    means = np.concatenate([ground + off[:, None] * (0, 0, 1), car])
    labels = np.concatenate([np.full(len(ground), ROAD), np.full(len(car), CAR)])
    return surfels_at(means, labels), np.concatenate([off, np.full(len(car), 0.2)])


def test_sunk_surfels_of_the_ground_are_put_on_it() -> None:
    surfels, over = sunk(0.4)
    level = on_level_ground(surfels, LABELS, drive_on_circle(60.0, GRADE))
    road = surfels.labels.numpy() == ROAD
    moved = (level.means - surfels.means).numpy()
    left = over + moved[:, 2]
    assert np.percentile(np.abs(over[road]), 90) > 0.4
    assert np.percentile(np.abs(left[road]), 90) < 0.13  # kerbs of 12 cm are in the street, and a parabola has none
    assert np.abs(moved[:, :2]).max() < 0.05  # downwards and upwards only, on a slope of 3 %
    assert np.array_equal(level.means[~road], surfels.means[~road])
    assert np.array_equal(level.quats[~road], surfels.quats[~road])
    up = level.normals().numpy()[road][np.abs(moved[road, 2]) > 0]
    assert np.abs(up[:, 2]).min() > 0.99


@pytest.mark.parametrize("why", ["points agree", "no class is ground", "an orbit"])
def test_what_is_no_noisy_street_stays(why: str) -> None:
    surfels, _ = sunk(0.0 if why == "points agree" else 0.4)
    cameras: list[Camera] = drive_on_circle(60.0, GRADE)
    labels = LABELS
    if why == "no class is ground":
        labels = LabelSet.keep_remove()
    if why == "an orbit":
        cameras = drive_on_circle(6.0, 0.0, frames=40)
    assert on_level_ground(surfels, labels, cameras) is surfels
