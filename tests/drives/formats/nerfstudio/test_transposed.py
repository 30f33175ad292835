"""Matrices that lie on their side are turned upright where nothing else can be meant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.drives.tiny_drive import edit, make_tiny_drive
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive


def transpose(document: dict[str, Any]) -> None:
    for frame in document["frames"]:
        frame["transform_matrix"] = np.transpose(frame["transform_matrix"]).tolist()


def test_poses_are_those_that_were_meant_and_it_is_said(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path)
    right = open_drive(drive)
    edit(drive, transpose)
    turned = open_drive(drive)
    for one, two in zip(turned.frames, right.frames, strict=True):
        assert np.allclose(one.camera.world_to_camera, two.camera.world_to_camera)
    assert any("last row: they are transposed" in line for line in turned.notices)
    assert not any("transposed" in line for line in right.notices)


def test_a_camera_at_the_origin_is_turned_with_the_others(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path, offset=(0, 0, -1.6))
    right = open_drive(drive)
    assert not right.frames[0].camera.centre.any()
    edit(drive, transpose)
    for one, two in zip(open_drive(drive).frames, right.frames, strict=True):
        assert np.allclose(one.camera.world_to_camera, two.camera.world_to_camera)


@pytest.mark.parametrize("row", [[0, 0, 0, 0], [0, 0, 0, 2]])
def test_other_last_rows_are_let_alone(row: list[float], tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path)
    right = open_drive(drive)
    edit(drive, lambda d: [f["transform_matrix"].__setitem__(3, row) for f in d["frames"]])
    opened = open_drive(drive)
    assert opened.notices == right.notices
    assert np.allclose(opened.frames[1].camera.centre, right.frames[1].camera.centre)


def test_one_that_is_no_matrix_is_one_line_all_the_same(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path)
    edit(drive, transpose)
    edit(drive, lambda d: d["frames"][2].update(transform_matrix=[[1, 2], [3]]))
    with pytest.raises(DriveError, match="Not a 4x4 matrix: the pose of frame 02"):
        open_drive(drive)
