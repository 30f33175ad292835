"""Points found in photographs, against a LiDAR that was taken away."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.importing.check import check_drive
from unveil_core.points.of_drive import found_points, lacks_points

STREET = Path(__file__).parents[2] / "sample_scenes/parked_street"


def bare_street(folder: Path, frames: str = "8:16") -> Path:
    """Some frames of the sample street, without its points."""
    folder.mkdir()
    for name in ("images", "semantics"):
        shutil.copytree(STREET / name, folder / name)
    told = json.loads((STREET / "transforms.json").read_text())
    del told["ply_file_path"]
    first, last = map(int, frames.split(":"))
    told["frames"] = [{k: v for k, v in f.items() if k != "instance_path"} for f in told["frames"][first:last]]
    (folder / "transforms.json").write_text(json.dumps(told))
    return folder


def test_they_lie_where_the_lidar_has_its_own(tmp_path: Path) -> None:
    drive = open_drive(bare_street(tmp_path / "drive"), DriveOptions())
    assert lacks_points(drive)
    check_drive(drive)
    found = found_points(drive)
    measured = open_drive(STREET).points.positions
    apart, _ = cKDTree(measured).query(found.positions)
    centres = np.stack([f.camera.centre for f in drive.frames])
    far, _ = cKDTree(centres).query(found.positions)
    near = far < 8
    assert near.sum() > 4000
    assert np.median(apart[near]) < 0.12 and (apart[near] < 0.25).mean() > 0.85  # the LiDAR's own are 15 cm apart
    assert found.colors is not None and found.colors.shape == found.positions.shape
    # The ground: as high as the LiDAR has it.
    low = near & (np.abs(found.positions[:, 2] - centres[:, 2].mean() + 1.6) < 0.3)
    _, nearest = cKDTree(measured).query(found.positions[low])
    assert abs(np.median(found.positions[low, 2] - measured[nearest, 2])) < 0.03


def test_a_matchmoves_tracks_are_too_few_and_a_sparse_model_is_not() -> None:
    drive = open_drive(STREET)
    frames = len(drive.frames)
    for each, few in ((7, True), (100, False)):
        some = drive.points.select(np.arange(each * frames))
        assert lacks_points(replace(drive, points=some, sweeps=())) is few
        assert not lacks_points(replace(drive, points=replace(some, measured=True), sweeps=()))
        classes = np.zeros(len(some.positions), np.uint8)
        assert not lacks_points(replace(drive, points=replace(some, classes=classes), sweeps=()))


def test_two_photographs_are_too_few(tmp_path: Path) -> None:
    drive = open_drive(bare_street(tmp_path / "drive", "8:10"))
    with pytest.raises(DriveError, match=r"has no points .*give LiDAR or SfM points, or 3 photographs of a camera"):
        check_drive(drive)


def test_a_camera_that_stands_shows_none(tmp_path: Path) -> None:
    drive = open_drive(bare_street(tmp_path / "drive", "8:12"))
    first = drive.frames[0]
    frames = tuple(replace(f, camera=first.camera, image_path=first.image_path) for f in drive.frames)
    with pytest.raises(
        DriveError, match="has no points, and its photographs show only .* places twice .*moving camera"
    ):
        found_points(replace(drive, frames=frames))
