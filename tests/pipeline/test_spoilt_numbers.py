"""Whole runs on drives whose numbers are extreme: each ends with frames that are whole, and with finite scenes.

Several things are wrong with each drive at once, so that few runs show them all.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.hard_drives import make_tiny_drive, replace_images, unchanged_outside
from tests.small_street import CAR, ROAD, pose_at
from unveil_core.base.errors import SelectionError
from unveil_core.base.files import read_json
from unveil_core.drives import open_drive
from unveil_core.drives.points import read_points
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.surfels.ply import read_surfels
from unveil_core.workspace.workspace import Workspace

FEW = RunSettings(quality="draft", iterations=20, splats=1500)
"""What a scene looks like is for other tests."""
SHRINK = 4


def ply_of(points: np.ndarray, path: Path) -> None:
    """Points as any program may write them, NaN and all; :func:`write_points` would not."""
    head = "".join(f"property double {axis}\n" for axis in "xyz")
    text = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n{head}end_header\n"
    path.write_bytes(text.encode() + points.astype("<f8").tobytes())


def check_whole(workspace: Workspace, path: Path) -> None:
    """All frames are delivered, the photographs themselves where nothing was removed; scenes and figures are finite."""
    assert unchanged_outside(workspace.root, path)
    for scene in (workspace.surfels_full, workspace.surfels_empty):
        found = read_surfels(scene)
        for values in (found.means, found.quats, found.log_scales, found.opacity_logits, found.sh):
            assert bool(torch.isfinite(values).all())
    for file in workspace.root.rglob("*.json"):
        json.loads(file.read_text(), parse_constant=lambda name, file=file: pytest.fail(f"{file}: {name}"))  # type: ignore[misc]
    for file in workspace.root.rglob("*.npz"):
        with np.load(file) as arrays:
            for name in arrays.files:
                assert arrays[name].dtype.kind not in "fc" or not np.isinf(arrays[name]).any(), (file, name)


def test_black_and_white_frames_cameras_in_a_wall_and_points_that_are_no_numbers_or_many_times_one(
    tmp_path: Path,
) -> None:
    in_wall, under_ground = pose_at(3.0), pose_at(4.0)
    in_wall[1, 3] += 8.0
    under_ground[2, 3] = -1.0
    path = make_tiny_drive(tmp_path / "d", [pose_at(x) for x in (0, 1, 2)] + [in_wall, under_ground], shrink=SHRINK)
    replace_images(path, "images", lambda image, i: np.full_like(image, (0, 255)[i]) if i < 2 else image)
    points = read_points(path.parent / "points.ply").positions
    points = np.repeat(points[::4], 3, axis=0)
    for nowhere in (np.nan, np.inf):
        ply_of(np.concatenate([points, [[0, 0, nowhere]]]), path.parent / "points.ply")
        (told,) = open_drive(path).notices
        assert told == f"points.ply: 1 of {len(points) + 1} points are NaN or infinite and are left out"
    ply_of(np.concatenate([points, [[3e4, 0, 0]]]), path.parent / "points.ply")
    check_whole(run(path, tmp_path / "w", FEW), path)


def test_one_frame_of_which_everything_is_removed(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path / "d", [pose_at(0)], shrink=SHRINK)
    replace_images(path, "semantics", lambda labels, _: np.full_like(labels, CAR))
    workspace = run(path, tmp_path / "w", FEW, yes=True)
    check_whole(workspace, path)
    assert len(list((workspace.root / "frames").rglob("*.png"))) == 1


def test_cameras_at_one_place_with_all_points_behind_them_and_nothing_to_remove(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path / "d", [pose_at(0)] * 3, shrink=SHRINK)
    replace_images(path, "semantics", lambda labels, _: np.where(labels == CAR, ROAD, labels).astype(np.uint8))
    points = read_points(path.parent / "points.ply").positions
    ply_of(points * (-1, 1, 1) - (5, 0, 0), path.parent / "points.ply")
    with pytest.raises(SelectionError) as caught:
        run(path, tmp_path / "w", FEW)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "w").exists()
    # One car in one frame, of which no point is.
    replace_images(path, "semantics", lambda labels, i: np.where(labels == ROAD, CAR, labels) if i == 1 else labels)
    workspace = run(path, tmp_path / "w", FEW)
    check_whole(workspace, path)
    assert read_json(workspace.selection_json)
