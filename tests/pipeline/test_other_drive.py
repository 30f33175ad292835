"""A workspace with results is not given another drive without a word."""

from __future__ import annotations

import hashlib
import shutil
from pathlib import Path

import pytest

from tests.drives.tiny_drive import edit, make_tiny_drive
from unveil_core.app.cli import main
from unveil_core.workspace.workspace import Workspace


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    drive = make_tiny_drive(tmp_path / "street")
    assert main(["import", str(drive), "-o", str(tmp_path / "w")]) == 0
    return tmp_path / "w"


def digest(root: Path) -> dict[str, str]:
    return {str(p): hashlib.sha256(p.read_bytes()).hexdigest() for p in root.rglob("*") if p.is_file()}


def test_another_drive_is_refused_and_taken_where_it_is_to_replace(
    workspace: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other, before = make_tiny_drive(tmp_path / "other", offset=(3, 0, 0)), digest(workspace)
    for verb in (["import"], ["run", "--until", "choose"]):
        capsys.readouterr()
        assert main([verb[0], str(other), "-o", str(workspace), *verb[1:]]) == 2
        said = capsys.readouterr().err
        assert "has results of another drive, " in said and "street" in said and "--replace" in said
        assert said.count("\n") == 1 and digest(workspace) == before
    assert main(["import", str(other), "-o", str(workspace), "--replace"]) == 0
    assert Workspace.open(workspace).state()["drive"] == str(other)
    assert main(["import", str(other), "-o", str(workspace)]) == 0


def test_the_same_drive_by_another_name_or_in_another_place_is_no_other(workspace: Path, tmp_path: Path) -> None:
    assert main(["import", str(tmp_path / "street"), "-o", str(workspace)]) == 0
    assert main(["import", str(tmp_path / "street"), "-o", str(workspace), "--remove", "car"]) == 0
    shutil.move(tmp_path / "street", tmp_path / "moved")
    assert main(["import", str(tmp_path / "moved"), "-o", str(workspace)]) == 0
    # The drive of the same name may have changed: that is what running again is for.
    edit(tmp_path / "moved/transforms.json", lambda d: d["frames"].pop())
    assert main(["import", str(tmp_path / "moved"), "-o", str(workspace)]) == 0
    shutil.move(tmp_path / "moved", tmp_path / "gone")
    other = make_tiny_drive(tmp_path / "other")
    (tmp_path / "other/images/00.png").write_bytes((tmp_path / "other/images/01.png").read_bytes())
    assert main(["import", str(other), "-o", str(workspace)]) == 2


def test_a_workspace_without_results_takes_any_drive(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path / "street")
    workspace = Workspace.create(tmp_path / "w")
    workspace.update(drive="/nowhere/else")
    assert main(["import", str(drive), "-o", str(tmp_path / "w")]) == 0
