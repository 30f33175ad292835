"""An exported drive is imported again: the same cameras, pixels and points."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.exports.conftest import Street
from tests.exports.street import HEIGHT, LARGER, LENS, WIDTH, WORLD
from unveil_core.app.cli import main
from unveil_core.drives import open_drive
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.exports.mapping.cloud import street_points


def test_unveil_opens_the_same_cameras_lenses_times_and_points(street: Street) -> None:
    found, drive = open_drive(street.exported("nerfstudio")), street.job.drive
    assert [(f.camera_name, f.name, f.timestamp) for f in found.frames] == [
        (f.camera_name, f.name, f.timestamp) for f in drive.frames
    ]
    for ours, theirs in zip(drive.frames, found.frames, strict=True):
        assert ours.footage is not None and theirs.distortion is not None
        assert theirs.camera.intrinsics == ours.footage.camera.intrinsics
        assert (theirs.camera.width, theirs.camera.height) == (WIDTH * LARGER, HEIGHT * LARGER)
        np.testing.assert_allclose(theirs.distortion.coefficients, LENS["coefficients"])
        there = WORLD.camera_to_world(ours.camera)
        np.testing.assert_allclose(theirs.camera.centre, there.centre, atol=1e-8)
        np.testing.assert_allclose(theirs.camera.forward, there.forward, atol=1e-12)
        delivered = street.root / f"frames/front/{ours.name}.png"
        picture = cv2.imread(str(theirs.image_path), cv2.IMREAD_UNCHANGED)
        assert picture.dtype == np.uint16
        np.testing.assert_array_equal(picture, cv2.imread(str(delivered), cv2.IMREAD_UNCHANGED))
    cloud = street_points(street.job).cloud
    np.testing.assert_allclose(found.points.positions, WORLD.to_world(cloud.positions), atol=1e-9)
    np.testing.assert_array_equal(found.points.colors, cloud.colors)


def test_imported_again_it_has_the_scale_and_up_of_before(street: Street, tmp_path: Path) -> None:
    again = import_drive(open_drive(street.exported("nerfstudio")), tmp_path / "drive")
    drive = street.job.drive
    assert again.to_world.scale == pytest.approx(WORLD.scale)
    np.testing.assert_allclose(again.to_world.up, WORLD.up, atol=1e-9)
    for ours, theirs in zip(drive.frames, again.frames, strict=True):
        centres = WORLD.to_world(ours.camera.centre), again.to_world.to_world(theirs.camera.centre)
        np.testing.assert_allclose(*centres, atol=1e-6)
        forward = again.to_world.directions_to_world(theirs.camera.forward)
        np.testing.assert_allclose(forward, WORLD.directions_to_world(ours.camera.forward), atol=1e-9)


def test_a_failed_export_leaves_the_one_before(street: Street, tmp_path: Path) -> None:
    workspace = tmp_path / "workspace"
    shutil.copytree(street.root, workspace)
    command = ["export", str(workspace), "--to", "nerfstudio", "-o", str(tmp_path / "out")]
    assert main(command) == 0
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "out").rglob("*") if p.is_file()}
    (workspace / "frames/front/0002.png").unlink()
    assert main(command) == 2
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "out").rglob("*") if p.is_file()} == before
    (tmp_path / "out/nerfstudio/export.json").unlink()
    assert main(command) == 2  # it might be anybody's now
    told = json.loads((tmp_path / "out/nerfstudio/transforms.json").read_text())
    assert len(told["frames"]) == 3
