"""Surfels take the colours of the pixels that show them, as far as a view does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from tests.optimize.test_reoptimize import CAMERA, wall
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.target_colours import coloured_by
from unveil_core.surfels.initialize import SH_C0
from unveil_core.surfels.surfels import Surfels, concatenate


def colours(surfels: Surfels) -> np.ndarray:
    """(N, 3) levels of 255, from ahead."""
    found: np.ndarray = 255 * (0.5 + SH_C0 * surfels.sh[:, 0].numpy())
    return found


def test_those_asked_for_take_the_mean_of_the_pixels_and_all_others_stay() -> None:
    scene = wall(4.0)
    left = scene.means[:, 0].numpy() < 0
    pictures = [np.full((24, 32, 3), level, np.uint8) for level in (60, 100)]
    done = coloured_by(scene, left, [(CAMERA, picture) for picture in pictures], near=0.2)
    assert np.abs(colours(done)[left] - 80).max() < 1
    assert torch.equal(done.sh[~left], scene.sh[~left])


def test_a_near_view_tells_more_than_a_far_one() -> None:
    scene = wall(4.0)
    pose = np.eye(4)
    pose[2, 3] = 4.0  # twice as far
    far = Camera(32, 24, 30.0, 30.0, 16.0, 12.0, pose)
    views = [(CAMERA, np.full((24, 32, 3), 100, np.uint8)), (far, np.full((24, 32, 3), 200, np.uint8))]
    done = coloured_by(scene, np.ones(len(scene), bool), views, near=0.2)
    assert np.abs(np.median(colours(done)) - 120) < 1


def test_what_is_hidden_or_outside_stays_as_it_is() -> None:
    front, back = wall(4.0), wall(8.0)
    beside = replace(front, means=front.means + torch.tensor([100.0, 0, 0]))
    scene = concatenate([front, back, beside])
    done = coloured_by(scene, np.ones(len(scene), bool), [(CAMERA, np.full((24, 32, 3), 250, np.uint8))], near=0.2)
    found = colours(done).reshape(3, -1, 3)
    assert np.abs(found[0] - 250).max() < 1 and np.abs(found[2] - 128).max() < 1
    assert np.abs(np.median(found[1]) - 128) < 1
