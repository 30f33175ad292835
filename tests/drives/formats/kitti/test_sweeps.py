"""The motion of a vehicle is taken out of its sweeps."""

from __future__ import annotations

import numpy as np
import pytest

from tests.drives.formats.kitti.files import apply, rigid, rotation
from unveil_core.drives.formats.kitti.sweeps import Motion, motion_to, motions, turn_seconds, untwisted

AROUND = np.array([[10.0, 0, 1], [0, 10, 1], [0, -10, 1], [-10, 0.001, 1], [-10, -0.001, 1]])
"""Ahead, left, right, and behind from either side."""


def test_what_lies_to_the_left_is_measured_first() -> None:
    ahead = Motion(shift=np.array([20.0, 0, 0]))
    moved = untwisted(AROUND, ahead, ahead, 0.1) - AROUND
    assert moved[:, 0] == pytest.approx([0, -0.5, 0.5, -1, 1], abs=1e-3) and not moved[:, 1:].any()


def test_each_half_of_the_turn_has_its_own_motion() -> None:
    before, after = Motion(shift=np.array([20.0, 0, 0])), Motion(rotation=np.array([0, 0, 0.8]))
    moved = untwisted(AROUND, before, after, 0.1)
    assert moved[1] == pytest.approx([-0.5, 10, 1])
    assert moved[2] == pytest.approx(rotation(z=0.8 * 0.025) @ AROUND[2])
    assert np.array_equal(untwisted(AROUND, Motion(), Motion()), AROUND)


def test_motion_leads_from_pose_to_pose() -> None:
    here, there = rigid(rotation(z=0.5), (100, 50, 3)), rigid(rotation(z=0.55, x=0.01), (101, 50.4, 3.1))
    forward, back = motion_to(here, there, 0.1), motion_to(there, here, -0.1)
    origin = np.zeros((1, 3))
    assert apply(here, origin + 0.1 * forward.shift) == pytest.approx(apply(there, origin))
    assert forward.rotation == pytest.approx(back.rotation, abs=1e-6) and forward.rotation[2] == pytest.approx(
        0.5, abs=0.01
    )


def test_ends_and_gaps_take_the_motion_that_is_known() -> None:
    poses = {n: rigid(np.eye(3), (0.1 * n * n, 0, 0)) for n in (0, 1, 2, 40)}
    numbers = sorted(poses)
    speeds = [[m.shift[0] for m in motions(n, poses, numbers, [])] for n in numbers]
    assert np.allclose(speeds, [[1, 1], [1, 3], [3, 3], [0, 0]])
    twice = [0.0, 0.19, 0.38]
    assert motions(0, poses, numbers, twice)[1].shift[0] == pytest.approx(0.1 / 0.19)


def test_implausible_turns_are_not_believed() -> None:
    assert turn_seconds(5.0, 5.103) == pytest.approx(0.103)
    assert {turn_seconds(None, 5.0), turn_seconds(5.0, 4.0), turn_seconds(0.0, 5.0)} == {0.1}
