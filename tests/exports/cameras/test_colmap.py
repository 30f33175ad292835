"""The COLMAP model as pycolmap reads it, in a process of its own: its libraries and torch's do not always agree."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from tests.exports.conftest import Street
from tests.exports.street import FRAMES, HEIGHT, LARGER, LENS, WIDTH, WORLD
from unveil_core.app.cli import main
from unveil_core.drives import open_drive
from unveil_core.exports.mapping.cloud import street_points

READ = """
import json, sys, pycolmap
model = pycolmap.Reconstruction(sys.argv[1])
def pose(image):
    found = image.cam_from_world
    return (found() if callable(found) else found).matrix().tolist()
cameras = {k: [c.model.name, c.width, c.height, list(c.params)] for k, c in model.cameras.items()}
images = {i.name: [i.camera_id, pose(i)] for i in model.images.values()}
points = [[list(p.xyz), list(map(int, p.color))] for _, p in sorted(model.points3D.items())]
json.dump({"cameras": cameras, "images": images, "points": points}, sys.stdout)
"""


def test_unveil_opens_it_again(street: Street, tmp_path: Path) -> None:
    assert main(["export", str(street.root), "--to", "colmap", "-o", str(tmp_path / "out")]) == 0
    drive = open_drive(tmp_path / "out/colmap")
    assert [f.name for f in drive.frames] == [f.name for f in street.job.drive.frames]
    there = np.array([WORLD.camera_to_world(f.camera).centre for f in street.job.drive.frames])
    found = np.array([f.camera.centre for f in drive.frames])
    np.testing.assert_allclose(found - found[0], there - there[0], atol=1e-2)
    assert len(drive.points.positions) == len(street_points(street.job).cloud.positions) and drive.points.measured


def test_pycolmap_reads_the_same_cameras_and_points(street: Street) -> None:
    if find_spec("pycolmap") is None:
        pytest.skip("pycolmap is not installed")
    folder = street.exported("colmap")
    done = subprocess.run([sys.executable, "-c", READ, str(folder / "sparse/0")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout[done.stdout.index("{") :])
    ((model, width, height, numbers),) = found["cameras"].values()
    frame = street.job.drive.frames[0]
    assert frame.footage is not None
    c = frame.footage.camera
    assert (model, width, height) == ("OPENCV", WIDTH * LARGER, HEIGHT * LARGER)
    np.testing.assert_allclose(numbers, [c.fx, c.fy, c.cx, c.cy, *LENS["coefficients"][:4]], rtol=1e-12)
    assert sorted(found["images"]) == [f"front/{i:04d}.png" for i in range(FRAMES)]
    for own in street.job.drive.frames:
        pose = np.array(found["images"][f"front/{own.name}.png"][1])
        expected = WORLD.camera_to_world(own.camera).world_to_camera[:3]
        np.testing.assert_allclose(pose[:, :3], expected[:, :3], atol=1e-9)
        np.testing.assert_allclose(-pose[:, :3].T @ pose[:, 3], -expected[:, :3].T @ expected[:, 3], atol=1e-2)
    cloud = street_points(street.job).cloud
    np.testing.assert_allclose([p[0] for p in found["points"]], WORLD.to_world(cloud.positions), atol=1e-6)
    np.testing.assert_array_equal([p[1] for p in found["points"]], cloud.colors)
