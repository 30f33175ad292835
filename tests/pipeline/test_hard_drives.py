"""Drives as they come, not as they should be: each ends in a usable scene, or in one line that names the file and the mend.

The other drives, which take longer, are in ``tests/slow/``.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.hard_drives import LINE, LONGER, check_frames, make_tiny_street, move, reconstructed, replace_points
from tests.plain_ply import read_plain_ply
from unveil_core.app.export import export_results
from unveil_core.base.errors import DriveError
from unveil_core.pipeline.run import run

UTM = np.array([687_000.0, 6_000_000.0, 520.0])


def test_utm_coordinates_cost_nothing(tmp_path: Path) -> None:
    path = make_tiny_street(tmp_path / "street", LINE)
    move(path, UTM)
    plain, moved = reconstructed(make_tiny_street(tmp_path / "plain", LINE)), reconstructed(path)
    assert abs(moved.psnr - plain.psnr) < 0.2
    assert abs(len(moved.surfels) / len(plain.surfels) - 1) < 0.02
    # What density control does hangs on last bits; where it did the same, surfels are at the same place.
    distance = torch.cdist(moved.surfels.means, plain.surfels.means).amin(dim=1)
    assert float(distance.quantile(0.9)) < 0.01
    workspace = run(path, tmp_path / "ws", LONGER, until="mesh")
    check_frames(workspace, path, 30)
    vertex = read_plain_ply(export_results(workspace, to=["ply"])[0])
    middle = [float(np.median(np.asarray(vertex[n], dtype=np.float64))) for n in "xyz"]
    assert np.abs(np.array(middle) - UTM - (12, 0, 1)).max() < 12


def test_two_frames(tmp_path: Path) -> None:
    path = make_tiny_street(tmp_path / "street", [0.0, 1.0])
    assert reconstructed(path).psnr > 22
    check_frames(run(path, tmp_path / "ws", replace(LONGER, iterations=300), until="deliver"), path, 33)


def test_a_drive_that_never_starts(tmp_path: Path) -> None:
    path = make_tiny_street(tmp_path / "street", [0.0] * 6)
    assert reconstructed(path).psnr > 26
    check_frames(run(path, tmp_path / "ws", LONGER, until="mesh"), path, 39)


def test_one_point(tmp_path: Path) -> None:
    path = make_tiny_street(tmp_path / "street", LINE)
    replace_points(path, lambda points: points[:1])
    outcome = reconstructed(path)
    assert outcome.psnr > 19 and outcome.miou > 0.6


def test_no_points_at_all_is_one_clear_line(tmp_path: Path) -> None:
    path = make_tiny_street(tmp_path / "street", LINE)
    replace_points(path, lambda points: points[:0])
    with pytest.raises(DriveError, match=r"points\.ply: holds no points \(a drive needs LiDAR or SfM points\)"):
        run(path, tmp_path / "ws")
    assert not (tmp_path / "ws").exists()
