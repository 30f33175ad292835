"""The table of formats, and what becomes of a wrong wish."""

from __future__ import annotations

import json
import shutil
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import torch

from docs.generate import ROOT
from tests.exports.conftest import Street
from tests.plain_ply import read_plain_ply
from unveil_core.app.cli import main
from unveil_core.base.errors import Cancelled
from unveil_core.exports.job import Job
from unveil_core.exports.registry import EXTRA, FORMATS, place_of
from unveil_core.exports.whole import TOLD
from unveil_core.exports.writing import export
from unveil_core.surfels.ply import write_surfels
from unveil_core.surfels.scene_edit import NOT_SHORTENED, SceneEdit, write_edit
from unveil_core.workspace.files import save_array
from unveil_core.workspace.workspace import Workspace


def test_each_optional_library_is_in_the_extra_and_each_format_tells_all() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    wanted = {"pxr": "usd-core", "av": "av", "laspy": "laspy", "lazrs": "laspy[lazrs]", "xatlas": "xatlas"}
    for one in FORMATS.values():
        assert one.what and one.read_back and one.lost and (not one.modules or one.library)
        for module in one.modules:
            assert any(line.startswith(wanted[module]) for line in extras[EXTRA]), one.name
    results = [one.result for one in FORMATS.values()]
    assert len(set(results)) == len(results)


def test_a_missing_library_is_one_line_that_names_the_extra(
    street: Street, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "laspy", None)  # as Python finds what is not installed
    assert main(["export", str(street.root), "--to", "las", "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "Not installed: laspy, which las needs (pip install '.[exports]'" in error
    assert error.count("\n") == 1 and not (tmp_path / "out").exists()


def test_several_formats_at_once_and_events(street: Street, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["export", str(street.root), "--to", "chan,splat-ply,png", "-o", str(tmp_path / "out"), "--json"]
    assert main(command) == 0
    *events, last = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert [Path(p).name for p in last["files"]] == ["chan", "empty_splats.ply", "png"]
    assert {e["stage"] for e in events} == {"export"} and events[-1]["done"] == events[-1]["total"] == 3
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert names == {"chan", "empty_splats.ply", "empty_splats.ply.json", "png"}
    assert main(command) == 0  # an export takes the place of the one before
    assert {p.name for p in (tmp_path / "out").iterdir()} == names


def test_a_folder_of_something_else_stays(street: Street, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "png").mkdir()
    (tmp_path / "png/mine.txt").write_text("dear")
    assert main(["export", str(street.root), "--to", "splat-ply,png", "-o", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "png/mine.txt: Not written by Unveil, and so not replaced (move it, or name another place" in error
    assert error.count("\n") == 1
    assert [p.name for p in tmp_path.rglob("*")] == ["png", "mine.txt"]


def test_one_format_after_the_other_into_one_folder(
    street: Street, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    for name in ("nerfstudio", "colmap", "png", "colmap"):
        assert main(["export", str(street.root), "--to", name, "-o", str(out)]) == 0
    (out / "sparse").mkdir()  # somebody's own model beside ours
    for file in ("images.txt", "cameras.txt"):
        shutil.copy(out / "colmap/sparse/0" / file, out / "sparse" / file)
    assert main(["export", str(street.root), "--to", "png", "-o", str(out)]) == 2
    assert "out: Not for results: a drive" in capsys.readouterr().err


def test_cancelled_halfway_nothing_is_left(street: Street, tmp_path: Path) -> None:
    def stop(done: int, total: int, message: str = "", **metrics: float) -> None:
        if done == 2:
            raise Cancelled

    job = Job(Workspace.open(street.root), progress=stop)
    for name in ("nerfstudio", "exr"):
        with pytest.raises(Cancelled):
            export(job, [(FORMATS[name], place_of(FORMATS[name], job, tmp_path / "out"))])
    assert list(tmp_path.iterdir()) == []


def test_a_single_file_may_be_named_and_must_have_its_suffix(
    street: Street, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", str(street.root), "--to", "spz", "-o", str(tmp_path / "a/scene.spz")]) == 0
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["scene.spz", "scene.spz.json"]
    assert main(["export", str(street.root), "--to", "spz", "-o", str(tmp_path / "b/scene.ply")]) == 2
    assert (
        "scene.ply: Not the suffix of spz (name it .spz)" in capsys.readouterr().err and not (tmp_path / "b").exists()
    )


def test_the_full_street_has_its_cars(street: Street, tmp_path: Path) -> None:
    assert main(["export", str(street.root), "--to", "splat-ply", "--state", "full", "-o", str(tmp_path)]) == 0
    vertex = read_plain_ply(tmp_path / "full_splats.ply")
    assert set(vertex["instance"]) == {0, 1, 2, 3}


def test_a_scene_that_is_not_there_is_told_before_anything_is_written(
    tmp_path: Path, street: Street, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(street.root, tmp_path / "workspace", ignore=shutil.ignore_patterns("surfels"))
    out = tmp_path / "out"
    assert main(["export", str(tmp_path / "workspace"), "--to", "png,spz", "-o", str(out)]) == 2
    error = capsys.readouterr().err
    assert "empty.ply: Not made yet: the empty scene (run `unveil reoptimize`)" in error and not out.exists()


def test_each_folder_tells_what_it_is(street: Street) -> None:
    for name in ("chan", "png", "objects-json", "nerfstudio"):
        assert json.loads((street.exported(name) / TOLD).read_text())["format"] == name


@pytest.mark.parametrize("box", [{"centre": [0, 0], "size": [1, 1, 1], "yaw": 0}, {"centre": 3}, "a box", [1]])
def test_a_damaged_list_of_objects_is_one_line(
    box: object, street: Street, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    workspace = tmp_path / "workspace"
    shutil.copytree(street.root, workspace)
    entries = json.loads((workspace / "instances.json").read_text())
    entries[0]["box"] = box
    (workspace / "instances.json").write_text(json.dumps(entries))
    assert main(["export", str(workspace), "--to", "objects-json", "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "instances.json: Not a list of objects" in error and "run `unveil instances` again" in error
    assert error.count("\n") == 1 and not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["splat-ply", "spz", "splat-gltf", "usd-splats", "usd-points"])
def test_a_scene_of_nothing_is_a_file_of_nothing(name: str, street: Street, tmp_path: Path) -> None:
    for module in FORMATS[name].modules:
        pytest.importorskip(module)
    workspace = tmp_path / "workspace"
    shutil.copytree(street.root, workspace)
    none = np.zeros(0, dtype=np.int64)
    write_surfels(street.job.scene.select(torch.from_numpy(none)), workspace / "surfels/full.ply")
    write_surfels(street.job.scene.select(torch.from_numpy(none)), workspace / "surfels/empty.ply")
    save_array(none, workspace / "surfels/instances.npy")
    write_edit(SceneEdit.removing(none.astype(bool), NOT_SHORTENED), workspace / "surfels/edit.npz")
    assert main(["export", str(workspace), "--to", name, "-o", str(tmp_path)]) == 0
    assert place_of(FORMATS[name], street.job, tmp_path).stat().st_size > 0
