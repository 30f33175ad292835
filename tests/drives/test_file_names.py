"""A drive that would write outside of its workspace: its names are names of files before anything else sees them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.imported import read_imported
from unveil_core.drives.importing.whole_drive import import_drive


def with_cameras(path: Path, names: list[object]) -> Path:
    document = json.loads(path.read_text())
    for frame, name in zip(document["frames"], names * len(document["frames"]), strict=False):
        frame["camera"] = name
    path.write_text(json.dumps(document))
    return path


@pytest.mark.parametrize("evil", ["../../outside", "/tmp/outside", "..", "a\0b", "..\\..\\outside", "con"])
def test_a_camera_s_name_leads_nowhere(tmp_path: Path, evil: str) -> None:
    path = with_cameras(make_tiny_drive(tmp_path / "drive"), [evil])
    before = {p for p in tmp_path.rglob("*")}
    done = import_drive(open_drive(path), tmp_path / "ws/sub/drive")
    new = {p for p in tmp_path.rglob("*")} - before
    assert new and all(p.is_relative_to(tmp_path / "ws") for p in new)
    assert all(f.image_path.parent.parent == done.root / "images" for f in done.frames)
    assert [np.array(f.camera.world_to_camera).shape for f in read_imported(done.root).frames]


def test_two_names_that_become_one_stay_two_cameras(tmp_path: Path) -> None:
    path = with_cameras(make_tiny_drive(tmp_path / "drive"), ["a/b", "a_b"])
    assert {f.camera_name for f in open_drive(path).frames} == {"a_b", "a_b_2"}


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("camera", "../../x"),
        ("name", "../x"),
        ("name", 7),
        ("image", "/etc/passwd"),
        ("image", "images/../../../x.png"),
        ("semantics", ""),
    ],
)
def test_a_workspace_whose_names_lead_out_is_one_clear_line(tmp_path: Path, field: str, value: object) -> None:
    done = import_drive(open_drive(make_tiny_drive(tmp_path / "drive")), tmp_path / "ws/drive")
    path = done.root / "cameras.json"
    document = json.loads(path.read_text())
    document["frames"][0][field] = value
    path.write_text(json.dumps(document))
    with pytest.raises(DriveError, match="Not an imported drive"):
        read_imported(done.root)


def test_photographs_may_have_names_as_long_as_the_system_allows(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path / "drive")
    document = json.loads(path.read_text())
    stems = ["a b", "e\u0301🚗", "x" * 251, "🚙" * 62 + "abc"]
    for frame, stem in zip(document["frames"], stems, strict=True):
        for key in ("file_path", "semantic_path", "instance_path"):
            old = path.parent / frame[key]
            frame[key] = f"{old.parent.name}/{stem}.png"
            old.rename(path.parent / frame[key])
    path.write_text(json.dumps(document))
    import_drive(open_drive(path), tmp_path / "imported")
    frames = read_imported(tmp_path / "imported").frames
    assert len({f.name for f in frames}) == 4 and {"a b", "e\u0301🚗"} <= {f.name for f in frames}
    assert sorted(f.image_path.read_bytes() for f in frames) == sorted(
        p.read_bytes() for p in (path.parent / "images").iterdir()
    )


def test_an_import_that_is_gone_is_told_once(tmp_path: Path) -> None:
    with pytest.raises(DriveError) as told:
        read_imported(tmp_path)
    assert str(told.value) == f"{tmp_path / 'cameras.json'}: Not found (run `unveil import` again)"
