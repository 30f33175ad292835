"""Clean pictures in a dataset's own layout: the project's own reader opens the tree and finds them, all else is the dataset's."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from tests.drives.formats.street.all_formats import WRITERS
from tests.drives.formats.street.street import tiny_street
from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.app.cli import main
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.files import write_image_atomic
from unveil_core.base.pictures.decoding import read_image_as_it_is
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive
from unveil_core.drives.imported import read_imported
from unveil_core.workspace.files import frame_file

KINDS = {
    "PandaSet": "pandaset",
    "KITTI raw": "kitti",
    "KITTI odometry": "kitti",
    "KITTI-360": "kitti",
    "nuScenes": "nuscenes",
}
PATCH = (slice(4, 12), slice(6, 20))
CLEAN = (40, 200, 90)


def written(name: str, folder: Path) -> Path:
    """A small drive in the dataset's released encoding; what is opened."""
    folder.mkdir()
    return WRITERS[name](folder, tiny_street())


def delivered(place: Path, workspace: Path) -> Drive:
    """Import a drive, and deliver its frames as they are, but for a patch in each but the first."""
    assert main(["import", str(place), "-o", str(workspace), "--yes", "--poses", "given"]) == 0
    drive = read_imported(workspace / "drive", points=False)
    for k, frame in enumerate(drive.frames):
        picture = read_image_as_it_is(frame.image_path if frame.footage is None else frame.footage.path).copy()
        if k:
            picture[PATCH] = CLEAN if picture.ndim == 3 else CLEAN[0]
        write_image_atomic(frame_file(workspace / "frames", frame), picture)
    return drive


@pytest.mark.parametrize("name", KINDS)
def test_the_reader_finds_the_clean_pictures(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = written(name, tmp_path / "data")
    before = {p: p.read_bytes() for p in sorted((tmp_path / "data").rglob("*")) if p.is_file()}
    imported = delivered(place, tmp_path / "ws")
    command = ["export", str(tmp_path / "ws"), "--to", KINDS[name], "-o", str(tmp_path / "out")]
    assert main(command) == 0
    made = tmp_path / "out" / KINDS[name]
    told = json.loads((made / "export.json").read_text())
    own, copy = open_drive(place, DriveOptions()), open_drive(made / told["drive"], DriveOptions())
    assert len(told["clean"]) == len(imported.frames) and "photographs are clean" in capsys.readouterr().err
    for k, (mine, theirs) in enumerate(zip(own.frames, copy.frames, strict=True)):
        assert (mine.name, mine.camera_name) == (theirs.name, theirs.camera_name)
        assert mine.image_path.name == theirs.image_path.name
        assert np.array_equal(mine.camera.world_to_camera, theirs.camera.world_to_camera)
        there, here = read_image_as_it_is(mine.image_path), read_image_as_it_is(theirs.image_path)
        assert here.shape == there.shape and here.dtype == there.dtype
        assert theirs.image_path.read_bytes()[:3] == mine.image_path.read_bytes()[:3]  # PNG, or JPEG
        if not k:
            assert theirs.image_path.samefile(mine.image_path)  # nothing was removed
            continue
        lossy = mine.image_path.suffix == ".jpg"
        wanted = there.copy()
        wanted[PATCH] = CLEAN if there.ndim == 3 else CLEAN[0]
        error = np.abs(here.astype(int) - wanted)
        assert error.mean() < 3 if lossy else not error.any()
        assert not theirs.image_path.samefile(mine.image_path)
    for mine, theirs in zip(own.sweeps, copy.sweeps, strict=True):
        assert theirs.path.samefile(mine.path)
        assert np.array_equal(mine.read().positions, theirs.read().positions)
    assert main(command) == 0  # in the place of the one before
    assert {p: p.read_bytes() for p in before} == before


@pytest.mark.parametrize("name", KINDS)
def test_links_that_lead_out_of_the_dataset_are_left_out(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = written(name, tmp_path / "data")
    delivered(place, tmp_path / "ws")
    home = tmp_path / "home"
    (home / "photos").mkdir(parents=True)
    (home / "key").write_text("private key")
    (home / "photos/me.jpg").write_text("private picture")
    (place / "key.txt").symlink_to(home / "key")
    (place / "more").symlink_to(home / "photos", target_is_directory=True)
    assert main(["export", str(tmp_path / "ws"), "--to", KINDS[name], "-o", str(tmp_path / "out")]) == 0
    assert "links that lead out of the dataset are left out: key.txt, more" in capsys.readouterr().err
    found = [p for p in (tmp_path / "out").rglob("*") if p.is_file()]
    assert found and not any(p.read_bytes().startswith(b"private") for p in found)
    assert not any(p.is_symlink() for p in (tmp_path / "out").rglob("*"))


def test_another_dataset_is_told_with_the_way_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    delivered(written("KITTI raw", tmp_path / "data"), tmp_path / "ws")
    capsys.readouterr()
    assert main(["export", str(tmp_path / "ws"), "--to", "nuscenes", "-o", str(tmp_path / "out")]) == 2
    assert "Not a drive of nuScenes: it is KITTI raw (use --to kitti)" in capsys.readouterr().err
    delivered(make_tiny_drive(tmp_path / "tiny"), tmp_path / "other")
    capsys.readouterr()
    assert main(["export", str(tmp_path / "other"), "--to", "kitti", "-o", str(tmp_path / "out")]) == 2
    assert "it is transforms.json (use --to nerfstudio, colmap or png)" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_dataset_that_is_gone_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    delivered(written("PandaSet", tmp_path / "data"), tmp_path / "ws")
    (tmp_path / "data").rename(tmp_path / "elsewhere")
    assert main(["export", str(tmp_path / "ws"), "--to", "pandaset", "-o", str(tmp_path / "out")]) == 2
    assert "Not found: the drive that the workspace was made from" in capsys.readouterr().err


def test_frames_that_are_not_delivered_yet_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = written("PandaSet", tmp_path / "data")
    assert main(["import", str(place), "-o", str(tmp_path / "ws"), "--yes"]) == 0
    assert main(["export", str(tmp_path / "ws"), "--to", "pandaset", "-o", str(tmp_path / "out")]) == 2
    assert "run `unveil deliver`" in capsys.readouterr().err and not (tmp_path / "out/pandaset").exists()


def test_where_no_hard_link_can_be_made_there_are_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise OSError

    delivered(written("PandaSet", tmp_path / "data"), tmp_path / "ws")
    monkeypatch.setattr(os, "link", fails)
    assert main(["export", str(tmp_path / "ws"), "--to", "pandaset", "-o", str(tmp_path / "out")]) == 0
    links = [p for p in (tmp_path / "out").rglob("*") if p.is_symlink()]
    assert links and all(p.resolve().is_file() for p in links)
    monkeypatch.setattr(os, "symlink", fails)
    assert main(["export", str(tmp_path / "ws"), "--to", "pandaset", "-o", str(tmp_path / "copies")]) == 0
    files = [p for p in (tmp_path / "copies").rglob("*") if p.is_file()]
    assert len(files) > len(links) and not any(p.is_symlink() for p in files)
