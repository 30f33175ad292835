"""An exported drive is imported again: the same cameras, pixels and points. And it is read by the rules of nerfstudio, in single
precision, and where nerfstudio is installed by its own parser."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.exports.cameras.test_colmap import pixels_of, rig, shown_points
from tests.exports.conftest import Street
from tests.exports.readers.nerfstudio import NerfView, read_as_nerfstudio
from tests.exports.street import HEIGHT, LARGER, LENS, WIDTH, WORLD
from tests.exports.variants import BROWN, FISHEYE, RATIONAL, Entry, variant
from unveil_core.app.cli import main
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.camera_path import read_camera_path
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.exports.job import Job
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
        there, again = WORLD.camera_to_world(ours.camera), found.to_world.camera_to_world(theirs.camera)
        np.testing.assert_allclose(again.centre, there.centre, atol=1e-8)
        np.testing.assert_allclose(again.forward, there.forward, atol=1e-12)
        delivered = street.root / f"frames/front/{ours.name}.png"
        picture = cv2.imread(str(theirs.image_path), cv2.IMREAD_UNCHANGED)
        assert picture.dtype == np.uint16
        np.testing.assert_array_equal(picture, cv2.imread(str(delivered), cv2.IMREAD_UNCHANGED))
    cloud = street_points(street.job).cloud
    world = found.to_world.to_world(found.points.positions)
    np.testing.assert_allclose(world, WORLD.to_world(cloud.positions), atol=1e-8)
    assert np.abs(found.points.positions).max() < 100 < np.abs(world).max()
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


def exported(job: Job, out: Path, *options: str) -> Path:
    assert main(["export", str(job.workspace.root), "--to", "nerfstudio", "-o", str(out), *options]) == 0
    return out / "nerfstudio"


def with_lenses(*lenses: dict[str, Any] | None) -> Any:
    """An edit: a rig of two cameras with these lenses, in turns."""

    def edit(number: int, entry: Entry) -> None:
        if len(lenses) > 1:
            rig(number, entry)
        entry["footage"]["distortion"] = lenses[number % len(lenses)]

    return edit


CASES = {
    "pinhole": (with_lenses(None), "perspective", []),
    "brown": (with_lenses(BROWN), "perspective", []),
    "fisheye": (with_lenses(FISHEYE), "fisheye", []),
    "rational": (with_lenses(RATIONAL), "perspective", ["front"]),
    "a rig of fisheyes": (with_lenses(FISHEYE, {**FISHEYE, "coefficients": [0.1, 0, 0, 0]}), "fisheye", []),
    "brown beside pinhole": (with_lenses(BROWN, None), "perspective", []),
    "fisheye beside brown": (with_lenses(FISHEYE, BROWN), "perspective", ["front"]),
    "fisheye beside rational": (with_lenses(FISHEYE, RATIONAL), "perspective", ["front", "rear"]),
}
"""Edit of the workspace, the kind of all cameras there, and the cameras whose lens had to go."""


def check(views: list[NerfView], job: Job, folder: Path, flattened: list[str]) -> None:
    """Points lie in the pictures where the footage, or its undistorted picture, has them."""
    document = json.loads((folder / "transforms.json").read_text())
    sources = {folder / f["file_path"]: f for f in document["frames"]}
    some, shift = shown_points(job), np.array(document["shift"])
    there = job.drive.to_world.to_world(some) - shift
    for view in views:
        frame = next(f for f in job.drive.frames if f.timestamp == sources[view.picture]["timestamp"])
        picture = cv2.imread(str(view.picture), cv2.IMREAD_UNCHANGED)
        assert picture.shape[1::-1] == view.size
        found = view.pixels(there)
        if frame.camera_name in flattened:
            assert not view.coefficients.any()
            local = some @ frame.camera.world_to_camera[:3, :3].T + frame.camera.world_to_camera[:3, 3]
            expected = local[:, :2] / local[:, 2:] * view.numbers[:2] + view.numbers[2:]
        else:
            expected = pixels_of(frame, some)
            delivered = cv2.imread(str(job.delivered(frame)), cv2.IMREAD_UNCHANGED)
            np.testing.assert_array_equal(picture, delivered)
        inside = ((expected > 0) & (expected < view.size)).all(axis=1)
        assert inside.sum() > 20
        np.testing.assert_allclose(found[inside], expected[inside], atol=0.02)


@pytest.mark.parametrize("name", CASES)
def test_points_lie_where_nerfstudio_draws_them(name: str, street: Street, tmp_path: Path) -> None:
    edit, kind, flattened = CASES[name]
    job = variant(street, tmp_path / "workspace", edit)
    folder = exported(job, tmp_path)
    views = read_as_nerfstudio(folder)
    assert len(views) == 3 and {v.kind for v in views} == {kind}
    assert json.loads((folder / "export.json").read_text())["undistorted"] == flattened
    check(views, job, folder, flattened)


def test_a_lens_that_had_to_go_is_told(street: Street, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exported(variant(street, tmp_path / "workspace", with_lenses(RATIONAL)), tmp_path)
    said = capsys.readouterr().err
    assert "nerfstudio: pictures of front are undistorted, for it does not know their lens" in said


def test_all_lenses_go_where_that_is_asked_for(street: Street, tmp_path: Path) -> None:
    job = variant(street, tmp_path / "workspace", with_lenses(FISHEYE, BROWN))
    folder = exported(job, tmp_path, "--undistorted")
    check(read_as_nerfstudio(folder), job, folder, ["front", "rear"])
    assert json.loads((folder / "transforms.json").read_text())["camera_model"] == "PINHOLE"


PARSE = """
import json, sys
from pathlib import Path
from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig
found = NerfstudioDataParserConfig(
    data=Path(sys.argv[1]), load_3D_points=False, orientation_method="none", center_method="none", auto_scale_poses=False,
    eval_mode="all", downscale_factor=1,
).setup().get_dataparser_outputs("train")
c = found.cameras
print("found" + json.dumps({
    "files": [str(p) for p in found.image_filenames], "kind": [int(k) for k in c.camera_type.flatten()],
    "numbers": [[float(v.flatten()[i]) for v in (c.fx, c.fy, c.cx, c.cy)] for i in range(len(c))],
    "coefficients": c.distortion_params.tolist(), "poses": c.camera_to_worlds.tolist(),
}))
"""


@pytest.mark.parametrize("name", CASES)
def test_nerfstudios_own_parser_reads_the_same(name: str, street: Street, tmp_path: Path) -> None:
    """It needs much of what nerfstudio installs: it runs where somebody has that."""
    if find_spec("nerfstudio") is None:
        pytest.skip("nerfstudio is not installed")
    edit, kind, _ = CASES[name]
    folder = exported(variant(street, tmp_path / "workspace", edit), tmp_path)
    done = subprocess.run([sys.executable, "-c", PARSE, str(folder)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found, views = json.loads(done.stdout.split("found", 1)[1]), read_as_nerfstudio(folder)
    assert found["files"] == [str(v.picture) for v in views]
    assert set(found["kind"]) == {{"perspective": 1, "fisheye": 2}[kind]}
    np.testing.assert_array_equal(found["numbers"], [v.numbers for v in views])
    np.testing.assert_array_equal(found["coefficients"], [v.coefficients for v in views])
    np.testing.assert_array_equal(found["poses"], [v.pose[:3] for v in views])


def test_its_cameras_are_a_path_to_render_along(street: Street) -> None:
    drive = street.job.drive
    views = read_camera_path(street.exported("nerfstudio") / "transforms.json", drive)
    for view, frame in zip(views, drive.frames, strict=True):
        np.testing.assert_allclose(view.camera.centre, frame.camera.centre, atol=1e-6)


@pytest.mark.parametrize("shift", ["far", [1, 2], [0, 0, float("1e999")], [[1], [2], [3]]])
def test_a_shift_that_is_none_is_one_line(shift: object, street: Street, tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    shutil.copytree(street.exported("nerfstudio"), folder)
    document = json.loads((folder / "transforms.json").read_text())
    (folder / "transforms.json").write_text(json.dumps({**document, "shift": shift}))
    with pytest.raises(DriveError, match="Not three numbers: shift"):
        open_drive(folder)
