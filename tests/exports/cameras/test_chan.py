"""Nuke's camera track: SciPy's rotations rebuild the poses from it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.exports.conftest import Street
from tests.exports.street import FRAMES, WORLD
from unveil_core.exports.cameras.chan import nuke_angles


@given(angles=st.tuples(st.floats(-80, 80), st.floats(-170, 170), st.floats(-170, 170)))
def test_angles_are_those_of_the_order_zxy(angles: tuple[float, float, float]) -> None:
    x, y, z = angles
    rotation = Rotation.from_euler("zxy", [z, x, y], degrees=True)  # about fixed axes, z first
    np.testing.assert_allclose(np.degrees(nuke_angles(rotation.as_matrix()[None])[0]), angles, atol=1e-6)


def test_the_track_has_the_poses_the_field_of_view_and_what_it_cannot_hold_beside_it(street: Street) -> None:
    folder = street.exported("chan")
    rows = np.loadtxt(folder / "front.chan")
    told = json.loads((folder / "export.json").read_text())
    assert rows[:, 0].tolist() == [1001, 1002, 1003] and len(rows) == FRAMES
    turn, shift = np.array(told["coordinates"]["rotation_to_drive"]), np.array(told["coordinates"]["shift"])
    for row, frame in zip(rows, street.job.drive.frames, strict=True):
        there = WORLD.camera_to_world(frame.camera)
        np.testing.assert_allclose(turn @ (row[1:4] + shift), there.centre, atol=1e-6)
        looks = Rotation.from_euler("zxy", row[[6, 4, 5]], degrees=True).as_matrix()
        np.testing.assert_allclose(turn @ -looks[:, 2], there.forward, atol=1e-7)
        np.testing.assert_allclose(turn @ -looks[:, 1], there.world_to_camera[1, :3], atol=1e-7)
        assert frame.footage is not None
        tangent = frame.footage.camera.height / 2 / frame.footage.camera.fy
        assert np.tan(np.radians(row[7] / 2)) == pytest.approx(tangent)
    assert np.abs(rows[:, 1:4]).max() < 100  # Nuke draws in single precision
    camera = told["cameras"]["front"]
    assert camera["frames"]["1002"] == {"source": "0001", "timestamp": pytest.approx(100.1)}
    assert camera["lens"]["coefficients"][0] == -0.05
