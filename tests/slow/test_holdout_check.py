"""The check on real footage as a whole: from a drive to figures, by the command line."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest

from tests.small_street import make_small_street
from unveil_core.app.cli import main
from unveil_core.base.pictures.decoding import read_image, read_label_image
from unveil_core.drives.imported import read_imported
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

QUICK = RunSettings(quality="draft", iterations=50, splats=5000, adapt=False)


@pytest.fixture(scope="module")
def footage(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    folder = tmp_path_factory.mktemp("footage")
    return run(make_small_street(folder / "street"), folder / "ws", QUICK, until="inpaint")


@pytest.fixture(scope="module")
def said(footage: Workspace) -> str:
    """What the command prints of the check."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main(["evaluate", str(footage.root), "--holdout-masks", "--cars", "1"]) == 0
    return out.getvalue()


@pytest.fixture(scope="module")
def checked(footage: Workspace, said: str) -> Path:
    return footage.root.with_name("ws_holdout") / "holdout"


def test_the_command_prints_the_figures(said: str) -> None:
    assert "behind the cars" in said and "Telea" in said and "car 1, " in said and "flicker" in said


def test_the_street_behind_the_car_comes_back(checked: Path) -> None:
    found = json.loads((checked / "holdout.json").read_text())
    methods = found["regions"]["removed"]["methods"]
    assert set(methods) == {"ours", "render", "telea", "shift_map"}
    assert methods["ours"]["psnr"] > 17 and methods["ours"]["psnr"] > methods["telea"]["psnr"]
    (car,) = found["cars"]
    assert car["pixels"] == found["regions"]["removed"]["pixels"] > 500
    assert found["outside"]["changed"] < 0.1 and found["flicker"]["pairs"] >= 2


def test_the_run_saw_nothing_behind_the_car(checked: Path, footage: Workspace) -> None:
    """Not in a photograph, not by a truth, and the delivery differs from both where the car was."""
    drive, before = read_imported(checked / "workspace/drive"), read_imported(footage.drive_dir)
    assert drive.truth_root is None
    leaked = 0
    for frame, real in zip(drive.frames, before.frames, strict=True):
        number = read_label_image(checked / "cars" / frame.camera_name / f"{frame.name}.png")
        covered = number > 0
        image, photograph = read_image(frame.image_path), read_image(real.image_path)
        assert np.array_equal(image[~covered], photograph[~covered])
        leaked += int((image == photograph)[covered].all(axis=1).sum())
        assert (read_label_image(frame.semantic_path)[covered] == 13).all()
        removed = read_label_image(checked / "workspace/masks/removed" / frame.camera_name / f"{frame.name}.png")
        assert (removed[covered] == 255).all()
    assert leaked < 20
    assert (checked / "pictures").is_dir() and list((checked / "pictures").glob("*.png"))


def test_the_workspace_itself_is_left_alone(footage: Workspace, checked: Path) -> None:
    assert footage.state()["settings"]["quality"] == "draft" and not (footage.root / "frames").exists()
    assert json.loads((footage.root / "selection.json").read_text())["removed"] == ["car"]


def test_again_goes_on_where_it_was(footage: Workspace, checked: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = json.loads((checked / "holdout.json").read_text())
    assert main(["evaluate", str(footage.root), "--holdout-masks", "--cars", "1", "--json"]) == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    ran = [e["stage"] for e in events if e.get("message") == "started"]
    assert "reconstruct" not in ran and any(e.get("stage") == "holdout" for e in events)
    assert {**events[-1]["holdout"], "seconds": 0} == {**before, "seconds": 0}
