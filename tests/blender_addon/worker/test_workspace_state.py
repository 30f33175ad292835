"""The states of stages as the panel reads them agree with what ``unveil status`` says."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from blender_addon.worker.workspace_state import STAGES, read
from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.app.cli import main
from unveil_core.pipeline.graph import STAGES as CORE_STAGES
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.status import stage_states
from unveil_core.workspace.workspace import Workspace


@pytest.fixture
def root(tmp_path: Path) -> Path:
    drive = make_tiny_drive(tmp_path / "drive")
    assert main(["import", str(drive), "-o", str(tmp_path / "ws")]) == 0
    for verb in ("segment", "choose"):
        assert main([verb, str(tmp_path / "ws")]) == 0
    return tmp_path / "ws"


def states(root: Path, wanted: dict[str, object] | None = None) -> dict[str, str]:
    return {name: stage.state for name, stage in read(root, wanted).stages.items()}


def test_the_stages_are_those_of_the_core() -> None:
    assert list(STAGES) == [stage.name for stage in CORE_STAGES]


def test_a_stage_run_anew_with_other_settings_makes_stale_what_follows(root: Path) -> None:
    before = read(root)
    assert {before.stages[n].state for n in ("import", "objects", "segment", "choose")} == {"done"}
    drive = str(root.parent / "drive/transforms.json")
    assert main(["import", drive, "-o", str(root), "--work-side", "32"]) == 0
    after = {name: stage.state for name, stage in read(root).stages.items()}
    assert after["import"] == after["objects"] == "done" and after["segment"] == after["choose"] == "stale"
    assert main(["import", drive, "-o", str(root), "--work-side", "auto"]) == 0  # as before, byte for byte
    assert read(root).stages["choose"].state == "done"
    assert stage_states(Workspace.open(root))["choose"] == "done"


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"seed": 5},
        {"movers": "keep"},
        {"work_side": 32},
        {"quality": "draft"},
        {"shadows": "off"},
        {"instances": (300,)},
        {"without": ("quilting", "layered_fill", "remains")},
    ],
)
def test_it_agrees_with_unveil_status(root: Path, changed: dict[str, object]) -> None:
    settings = RunSettings(**changed)  # type: ignore[arg-type]
    assert states(root, settings.to_json()) == stage_states(Workspace.open(root), settings)


def test_a_choice_put_another_way_is_the_same_choice(root: Path) -> None:
    """The workspace was made with no choice at all, which means the car."""
    assert states(root, {"remove": ["car"], "instances": []})["choose"] == "done"
    assert states(root, {"remove": [], "instances": [300]})["choose"] == "stale"
    assert states(root, {"remove": ["car", "person"], "instances": []})["choose"] == "stale"
    assert states(root, {"remove": [], "instances": []})["choose"] == "done"


def test_running_failed_and_killed(root: Path) -> None:
    workspace = Workspace.open(root)
    workspace.update_stage("reconstruct", status="running")
    killed = read(root).stages["reconstruct"]
    assert killed.state == "to do" and "broken off" in killed.message
    with workspace.lock():
        assert states(root)["reconstruct"] == "running"
    workspace.update_stage("reconstruct", status="failed")
    workspace.log("reconstruct", "out of splats\nand more", level="error")
    stage = read(root).stages["reconstruct"]
    assert (stage.state, stage.message) == ("failed", "out of splats")


def test_what_follows_a_stale_stage_is_stale(root: Path) -> None:
    found = states(root, {"work_side": 32})
    assert found["import"] == found["segment"] == found["choose"] == "stale" and found["reconstruct"] == "to do"


@pytest.mark.parametrize("end", ["cancelled", "failed", "running"])
def test_a_broken_off_attempt_with_other_settings_leaves_the_result_done(root: Path, end: str) -> None:
    Workspace.open(root).update_stage("segment", status=end, attempt={"settings": {"movers": "keep"}})
    assert states(root, {"movers": "auto"})["segment"] == "done"
    assert states(root, {"movers": "keep"})["segment"] == ("failed" if end == "failed" else "stale")


def test_no_workspace_and_a_damaged_one(tmp_path: Path) -> None:
    state = read(tmp_path / "none")
    assert not state.exists and state.problem == "No results yet" and set(state.stages) == set(STAGES)
    (tmp_path / "workspace.json").write_text('{"stages": ')
    assert "Damaged" in read(tmp_path).problem
    (tmp_path / "workspace.json").write_text(json.dumps([1]))
    assert "Damaged" in read(tmp_path).problem
