"""Where points do not tell an object's shape its outline is followed from frame to frame."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.small_street import FRAMES, make_small_street
from unveil_core.marking.asked.prompts import Prompt, Prompts
from unveil_core.marking.carrying import carried
from unveil_core.marking.following import followed
from unveil_core.marking.outline import Outliner, object_outline
from unveil_core.marking.seeds import Seeds
from unveil_core.marking.space.opened import Opened, opened
from unveil_core.marking.space.scene_points import ScenePoints, scene_points
from unveil_core.pipeline.settings import RunSettings

CLICKED = 3


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> tuple[Opened, ScenePoints, list[np.ndarray]]:
    """The street, its points, and the pixels (H, W) of the car in each frame."""
    path = make_small_street(tmp_path_factory.mktemp("street") / "street")
    space = opened(path, RunSettings())
    truth = [cv2.imread(str(path.parent / f"truth/removed/{i:02d}.png"), 0) > 0 for i in range(FRAMES)]
    return space, scene_points(space.drive), truth


def together(found: list[np.ndarray], truth: list[np.ndarray]) -> float:
    """Intersection over union of all frames."""
    return float((np.stack(found) & np.stack(truth)).sum() / (np.stack(found) | np.stack(truth)).sum())


def outliner(space: Opened) -> Outliner:
    def outline(v: int, seeds: Seeds | None, prompt: Prompt | None) -> np.ndarray:
        return object_outline(space.image(v), seeds, prompt)

    return outline


@pytest.mark.parametrize("points_on_it", [True, False])
def test_an_outline_of_one_frame_is_found_in_the_others(
    points_on_it: bool, street: tuple[Opened, ScenePoints, list[np.ndarray]]
) -> None:
    """By the distance of points, or by where the foot meets the ground."""
    space, points, truth = street
    if not points_on_it:
        points = replace(points, over=np.zeros(len(points.positions)))
    prompts = Prompts("car", {CLICKED: Prompt(matte=truth[CLICKED])})
    found = followed(space.drive, space.image, points, prompts, outliner(space))
    assert (found[CLICKED] == truth[CLICKED]).all()
    assert together(list(found), truth) > 0.75


def test_points_of_photographs_do_not_tell_a_shape(street: tuple[Opened, ScenePoints, list[np.ndarray]]) -> None:
    """On a drive of ``unveil solve`` the outline of the picture counts, wherever its points lie."""
    space, points, truth = street
    prompts = Prompts("car", {CLICKED: Prompt(matte=truth[CLICKED])})
    measured, found = (
        carried(space.drive, space.image, replace(points, measured=m), prompts, outliner(space)) for m in (True, False)
    )
    assert (np.stack(found) != np.stack(measured)).any() and together(list(found), truth) > 0.75


def test_a_drive_of_a_solve_has_no_measured_points(tmp_path: Path) -> None:
    path = make_small_street(tmp_path / "street")
    assert opened(path, RunSettings()).measured
    (path.parent / "solve.json").write_text("{}")
    assert not opened(path, RunSettings()).measured and not opened(path.parent, RunSettings()).measured
