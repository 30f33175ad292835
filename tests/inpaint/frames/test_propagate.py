"""What a keyframe invents is what all others show; each frame for itself, and the other order, differ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from tests.inpaint.walls import before_wall, task_of, wall_without
from unveil_core.base.parallel import threads
from unveil_core.inpaint.frames import holes as frame_holes
from unveil_core.inpaint.frames import propagate
from unveil_core.inpaint.frames.holes import Hole, background_layers, hole_in_frame, open_hole
from unveil_core.inpaint.frames.keyframes import plan_keyframes
from unveil_core.inpaint.frames.propagate import Painted, RemainingScene, propagate_inpainting
from unveil_core.surfels.sky import Sky

WINDOW = (-0.6, 0.6, -0.6, 0.6)
PAINTS = ((250, 40, 40), (40, 250, 40), (40, 40, 250), (250, 250, 40), (40, 250, 250), (250, 40, 250))
WALL = wall_without(WINDOW)
SKY = Sky(torch.zeros(3, 8, 16), np.eye(3))


class Painter:
    """An inpainter whose every call has a colour of its own, so that a pixel tells who invented it."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, image: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
        self.calls += 1
        return np.where(mask[..., None], np.uint8(PAINTS[self.calls - 1]), image)


def paint(cameras, times, order: str, given=None) -> tuple[list[Painted], list[Hole], Painter]:  # type: ignore[no-untyped-def]
    tasks = [task_of(camera, WINDOW) for camera in cameras]
    holes = [open_hole(task, WALL, None) for task in tasks]
    plan = None if order == "independent" else plan_keyframes(holes, times, order=order, given=given)
    painter = Painter()
    painted: dict[int, Painted] = {}
    scene = RemainingScene(WALL, SKY, None, 1)
    with threads(1):  # this painter counts its calls
        seeds = propagate_inpainting(tasks, scene, painter, painted.setdefault, plan=plan)  # type: ignore[arg-type]
    assert seeds is not None and len(painted) == len(tasks)
    return [painted[i] for i in range(len(tasks))], holes, painter


def inner_colors(painted: list[Painted], holes: list[Hole]) -> NDArray[np.float64]:
    """(N, 3) mean colour of each frame's hole."""
    return np.stack([p.image[h.mask].mean(axis=0) for p, h in zip(painted, holes, strict=True)])


def by_place(image: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """An inpainter whose colour tells the hole, whoever asks first."""
    rows, columns = np.nonzero(mask)
    told = (int(rows.sum()) % 251, int(columns.sum()) % 251, len(rows) % 251)
    return np.where(mask[..., None], np.array(told, np.uint8), image)


def test_frames_that_are_begun_together_are_what_they_are_one_after_the_other() -> None:
    # The user's keyframe looks past the window: the first frame of the others invents it, and those begun with it must not.
    cameras = [*(before_wall(0.15 * i, 4.0 - 0.3 * i) for i in range(4)), before_wall(9.0, 4.0)]
    tasks = [task_of(camera, WINDOW) for camera in cameras]
    holes = [open_hole(task, WALL, None) for task in tasks]
    plan = plan_keyframes(holes, range(5), order="reverse", given=[4])
    scene, found = RemainingScene(WALL, SKY, None, 1), []
    for count in (1, 3):
        painted: dict[int, Painted] = {}
        with threads(count):
            seeds = propagate_inpainting(tasks, scene, by_place, painted.setdefault, plan=plan)  # type: ignore[arg-type]
        assert seeds is not None and sorted(painted) == list(range(5))
        found.append((painted, seeds))
    (alone, own), (together, theirs) = found
    assert all(np.array_equal(own.arrays()[name], theirs.arrays()[name]) for name in own.arrays())
    for i in range(5):
        assert np.array_equal(alone[i].image, together[i].image)
        assert np.array_equal(alone[i].origin, together[i].origin)


@pytest.mark.parametrize(("order", "first"), [("reverse", 2), ("forward", 0)])
def test_a_place_is_invented_once(order: str, first: int) -> None:
    cameras = [before_wall(0.1 * i, 4.0 - 0.3 * i) for i in range(3)]
    painted, holes, _ = paint(cameras, [0, 1, 2], order)
    assert min(len(h.depth) for h in holes) > 200
    assert painted[first].invented.sum() > 200
    assert all(p.invented.sum() < 20 for i, p in enumerate(painted) if i != first)
    assert np.abs(inner_colors(painted, holes) - PAINTS[0]).max() < 25


def test_alone_every_frame_invents_for_itself() -> None:
    cameras = [before_wall(0.1 * i, 4.0 - 0.3 * i) for i in range(3)]
    painted, holes, painter = paint(cameras, [0, 1, 2], "independent")
    assert painter.calls == 3
    assert np.array_equal(inner_colors(painted, holes), np.array(PAINTS[2::-1], dtype=float))
    assert all(np.array_equal(p.invented, h.mask) for p, h in zip(painted, holes, strict=True))


def test_the_cameras_of_a_rig_show_the_same() -> None:
    cameras = [before_wall(x + 0.1 * i, 4.0) for x in (-0.4, 0.4) for i in range(2)]
    painted, holes, _ = paint(cameras, [0, 1, 0, 1], "reverse")
    assert sum(p.invented.sum() > 20 for p in painted) == 1
    assert np.abs(inner_colors(painted, holes) - PAINTS[0]).max() < 25


def test_what_is_far_is_left_to_the_frames_that_come_near(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (frame_holes, propagate):
        monkeypatch.setattr(module, "CARRIED_M", 3.0)
    near, far = before_wall(0.0, 2.0), before_wall(0.0, 4.0)
    # The far one comes first in the order, and would have invented it for both.
    painted, holes, _ = paint([near, far], [0, 1], "reverse")
    assert holes[1].mask.sum() == 0 and holes[0].mask.sum() > 200
    assert painted[0].invented.sum() > 200 and painted[1].invented.sum() < 20
    assert np.abs(painted[1].image[34:38, 46:50] - np.array(PAINTS[0], float)).max() < 25


def test_what_nobody_comes_near_is_invented_by_each_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (frame_holes, propagate):
        monkeypatch.setattr(module, "CARRIED_M", 3.0)
    tasks = [task_of(before_wall(0.1 * k, 4.0), WINDOW) for k in range(2)]
    plan = plan_keyframes([open_hole(task, WALL, None) for task in tasks], [0, 1], order="reverse")
    painted: dict[int, Painted] = {}
    scene = RemainingScene(WALL, SKY, None, 1)
    assert propagate_inpainting(tasks, scene, Painter(), painted.setdefault, plan=plan) is None  # type: ignore[arg-type]
    assert all(p.invented.sum() > 200 for p in painted.values()) and len(painted) == 2


def test_what_is_deferred_to_a_sharper_view_comes_from_there() -> None:
    """The last frame sees the whole window from afar, an earlier one its middle from nearby."""
    near, far = before_wall(0.0, 1.0), before_wall(0.0, 6.0)
    painted, holes, _ = paint([near, far], [0, 1], "reverse")
    assert holes[0].mask.sum() > 1000
    middle = painted[1].image[34:38, 46:50].astype(float)
    assert np.abs(middle - painted[0].image[34:38, 46:50].mean(axis=(0, 1))).max() < 30


def test_what_given_keyframes_do_not_show_is_invented_once_all_the_same() -> None:
    """The only keyframe looks past the window; the next in turn takes its place."""
    cameras = [before_wall(0.0, 4.0), before_wall(0.1, 3.7), before_wall(9.0, 4.0)]
    painted, holes, painter = paint(cameras, [0, 1, 2], "reverse", given=(2,))
    assert not holes[2].mask.any() and not painted[2].invented.any()
    assert painted[1].invented.sum() > 200 and painted[0].invented.sum() < 20
    # Frames that are begun at once are painted in any order; which paint is kept is that of the frame whose turn comes first.
    shown = inner_colors(painted[:2], holes[:2])
    assert np.abs(shown - shown[1]).max() < 25 and np.abs(np.array(PAINTS) - shown[1]).max(axis=1).min() < 25


def test_a_hole_has_the_depth_and_the_area_of_what_it_is_in_and_ends_at_the_sky() -> None:
    task = task_of(before_wall(0.0, 4.0), WINDOW)
    empty = hole_in_frame(task, background_layers(task, WALL, None))
    sky = np.zeros_like(empty)
    sky[:36] = True
    assert empty[:36].any()
    hole = open_hole(replace(task, sky=sky), WALL, None)
    assert np.array_equal(hole.mask, empty & ~sky) and np.abs(hole.depth - 4.0).max() < 0.3
    assert hole.area().sum() == pytest.approx(0.72, rel=0.15)
