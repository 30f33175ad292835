"""Where a shot may be written: never into somebody's drive, nor where all of somebody's files lie."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from blender_addon.formats.shot.place import NoPlace, check_place, shot_folder
from tests.drives.tiny_drive import make_tiny_drive


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    home = tmp_path / "users/me"
    home.mkdir(parents=True)
    monkeypatch.setattr(Path, "home", lambda: home)
    return home


def test_neither_a_disk_nor_the_home_folder(home: Path) -> None:
    for folder in (Path("/"), home, home.parent):
        with pytest.raises(NoPlace, match="Not for a shot"):
            check_place(folder)
    (home / "link").symlink_to(home)
    with pytest.raises(NoPlace, match="the home folder"):
        check_place(home / "link")
    check_place(home / "shots/sh010/drive")


@pytest.mark.parametrize("replace", [False, True])
def test_no_drive_of_somebody_whatever_is_to_be_replaced(tmp_path: Path, replace: bool) -> None:
    make_tiny_drive(tmp_path / "drive")
    before = {p: p.read_bytes() for p in (tmp_path / "drive").rglob("*") if p.is_file()}
    for place in ("drive", "drive/images", "drive/shots/new"):
        with pytest.raises(NoPlace, match="Not for a shot"), shot_folder(tmp_path / place, mend="", replace=replace):
            raise AssertionError
    assert before == {p: p.read_bytes() for p in (tmp_path / "drive").rglob("*") if p.is_file()}


@pytest.mark.parametrize("name", ["workspace.json", "sparse/0", "data_2d_raw", "image_2", "transforms_train.json"])
def test_drives_of_all_kinds_count(tmp_path: Path, name: str) -> None:
    (tmp_path / "d" / name).mkdir(parents=True)
    for place in ("d", "d/below"):
        with pytest.raises(NoPlace, match="Not for a shot"):
            check_place(tmp_path / place)


def test_a_shot_of_earlier_is_one(tmp_path: Path) -> None:
    (tmp_path / "transforms.json").write_text(json.dumps({"generator": "Unveil in Blender"}))
    check_place(tmp_path)
    with pytest.raises(NoPlace, match="it lies in"):
        check_place(tmp_path / "another")
    (tmp_path / "sparse/0").mkdir(parents=True)
    with pytest.raises(NoPlace, match="a drive"):
        check_place(tmp_path)
