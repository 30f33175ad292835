"""The states of stages as the panel reads them agree with what ``unveil status`` says."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from blender_addon.workspace_state import FOLLOWS, STAGES, read
from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.cli import main
from unveil_core.settings import RunSettings
from unveil_core.stage_bodies import STAGES as CORE_STAGES
from unveil_core.status import depends_on, stage_states
from unveil_core.workspace import Workspace


@pytest.fixture
def root(tmp_path: Path) -> Path:
    drive = make_tiny_drive(tmp_path / "drive")
    assert main(["import", str(drive), "-o", str(tmp_path / "ws")]) == 0
    for verb in ("segment", "choose"):
        assert main([verb, str(tmp_path / "ws")]) == 0
    return tmp_path / "ws"


def states(root: Path, wanted: dict[str, object] | None = None) -> dict[str, str]:
    return {name: stage.state for name, stage in read(root, wanted).stages.items()}


def test_the_stages_and_what_they_follow_are_the_core_s() -> None:
    assert list(STAGES) == [stage.name for stage in CORE_STAGES]

    def closed(follows: dict[str, tuple[str, ...]]) -> dict[str, set[str]]:
        found: dict[str, set[str]] = {}
        for name, direct in follows.items():
            found[name] = set(direct).union(*(found[d] for d in direct))
        return found

    direct = {
        s.name: tuple(
            o.name for o in CORE_STAGES if o is not s and depends_on(s.inputs + s.optional, set(o.outputs))
        )
        for s in CORE_STAGES
    }  # fmt: skip
    assert closed(FOLLOWS) == closed(direct)


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"seed": 5},
        {"movers": "keep"},
        {"max_side": 32},
        {"quality": "draft"},
        {"shadows": "off"},
        {"instances": (300,)},
    ],
)
def test_it_agrees_with_unveil_status(root: Path, changed: dict[str, object]) -> None:
    settings = RunSettings(**changed)  # type: ignore[arg-type]
    assert states(root, settings.to_json()) == stage_states(Workspace.open(root), settings)


def test_running_failed_and_killed(root: Path) -> None:
    workspace = Workspace.open(root)
    workspace.update_stage("reconstruct", status="running")
    assert states(root)["reconstruct"] == "to do"
    with workspace.lock():
        assert states(root)["reconstruct"] == "running"
    workspace.update_stage("reconstruct", status="failed")
    workspace.log("reconstruct", "out of splats\nand more", level="error")
    stage = read(root).stages["reconstruct"]
    assert (stage.state, stage.message) == ("failed", "out of splats")


def test_what_follows_a_stage_that_is_not_done_is_stale(root: Path) -> None:
    workspace = Workspace.open(root)
    workspace.update_stage("import", status="cancelled")
    assert states(root)["segment"] == "stale"


def test_no_workspace_and_a_damaged_one(tmp_path: Path) -> None:
    state = read(tmp_path / "none")
    assert not state.exists and state.problem == "there is no workspace yet" and set(state.stages) == set(STAGES)
    (tmp_path / "workspace.json").write_text('{"stages": ')
    assert "is damaged" in read(tmp_path).problem
    (tmp_path / "workspace.json").write_text(json.dumps([1]))
    assert "is damaged" in read(tmp_path).problem
