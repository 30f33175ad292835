"""A run on an existing workspace keeps its settings; a planned one writes nothing."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.app.cli import main
from unveil_core.workspace.workspace import Workspace

MADE_WITH = ["--remove", "car", "--work-side", "32", "--movers", "keep", "--seed", "5", "--no-adaptation"]


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return make_tiny_drive(tmp_path / "drive")


@pytest.fixture
def root(drive: Path, tmp_path: Path) -> Path:
    """Imported with settings of its own, and segmented."""
    assert main(["run", str(drive), "-o", str(tmp_path / "ws"), "--until", "choose", *MADE_WITH]) == 0
    return tmp_path / "ws"


def settings(root: Path) -> dict[str, Any]:
    return dict(Workspace.open(root).state()["settings"])


def content(root: Path) -> dict[str, str]:
    return {str(p): hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(root.rglob("*")) if p.is_file()}


def test_a_run_keeps_what_the_workspace_was_made_with(
    root: Path, drive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = settings(root)
    capsys.readouterr()
    for verb in (["run", "--until", "choose"], ["import"]):
        assert main([verb[0], str(drive), "-o", str(root), *verb[1:]]) == 0
        said = capsys.readouterr().err
        assert "started" not in said and settings(root) == before
        assert said.count("Keeping the settings") == 1
        assert "remove car, movers keep, work_side 32, seed 5, adapt False (--reset takes the defaults)" in said


def test_what_is_given_is_changed_and_taken_back(root: Path, drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    again = ["run", str(drive), "-o", str(root), "--until", "choose"]
    assert main([*again, "--movers", "auto", "--adaptation", "--seed", "auto"]) == 0
    found = settings(root)
    assert (found["movers"], found["adapt"], found["seed"], found["work_side"]) == ("auto", True, 0, 32)
    assert "remove car, work_side 32 (" in capsys.readouterr().err
    assert main([*again, "--reset"]) == 0
    assert settings(root)["work_side"] is None and "Keeping" not in capsys.readouterr().err


def test_another_drive_begins_with_the_defaults(root: Path, tmp_path: Path) -> None:
    other = make_tiny_drive(tmp_path / "other", offset=(5.0, 0.0, 0.0))
    assert main(["import", str(other), "-o", str(root)]) == 2
    assert main(["import", str(other), "-o", str(root), "--replace"]) == 0
    assert settings(root)["work_side"] is None


def test_settings_of_another_version_need_a_reset(root: Path, drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Workspace.open(root).update(settings={**settings(root), "of_tomorrow": 1})
    assert main(["import", str(drive), "-o", str(root)]) == 2
    assert "--reset takes the defaults" in capsys.readouterr().err
    assert main(["import", str(drive), "-o", str(root), "--reset"]) == 0


def test_a_file_of_settings_goes_below_the_options(drive: Path, tmp_path: Path) -> None:
    (tmp_path / "run.toml").write_text('seed = 3\nmovers = "keep"\nwork_side = 32\n')
    given = ["--settings", str(tmp_path / "run.toml"), "--seed", "4"]
    assert main(["import", str(drive), "-o", str(tmp_path / "w"), *given]) == 0
    found = settings(tmp_path / "w")
    assert (found["seed"], found["movers"], found["work_side"]) == (4, "keep", 32)


def test_a_planned_run_says_why_and_writes_nothing(
    root: Path, drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UNVEIL_CACHE", str(tmp_path / "cache"))
    before = content(root)
    again = ["run", str(drive), "-o", str(root), "--until", "choose", "--dry-run"]
    capsys.readouterr()
    assert main(again) == 0
    assert "Nothing would run." in capsys.readouterr().out
    assert main([*again, "--movers", "auto"]) == 0
    said = capsys.readouterr().out
    assert "import       up to date\n" in said and "segment      would run: movers keep -> auto\n" in said
    assert main([*again, "--work-side", "auto", "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)["plan"]
    assert plan["stages"]["import"] == {"state": "stale", "why": "work_side 32 -> auto", "would_run": True}
    assert plan["stages"]["segment"]["why"] == "follows import"
    assert plan["forecast"]["seconds"].keys() >= {"import", "segment"} and plan["settings"]["seed"] == 5
    assert main(["run", str(drive), "-o", str(tmp_path / "new"), "--dry-run"]) == 0
    assert "report       would run: not made yet\n" in capsys.readouterr().out
    assert content(root) == before and not (tmp_path / "new").exists() and not (tmp_path / "cache").exists()
    assert main(["import", "nowhere", "-o", str(root), "--dry-run"]) == 2


def test_quiet_and_verbose(drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["-q", "import", str(drive), "-o", str(tmp_path / "q")]) == 0
    said = capsys.readouterr()
    assert "started" not in said.err and said.out == ""
    assert main(["import", str(drive), "-o", str(tmp_path / "v"), "--verbose"]) == 0
    assert "import       4/4" in capsys.readouterr().err


def test_the_status_says_what_makes_a_stage_stale(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["status", str(root), "--movers", "auto"]) == 0
    assert "segment      stale (movers keep -> auto)\n" in capsys.readouterr().out
    assert main(["status", str(root), "--movers", "auto", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["why"]["segment"] == "movers keep -> auto"
