"""What people keep in a workspace outlives the stages: only what a stage made makes room for what it makes anew."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from unveil_core.pipeline.runner import run_stages
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Stage, StageContext
from unveil_core.workspace.journal import recover
from unveil_core.workspace.workspace import Workspace


def write(context: StageContext) -> None:
    """As many frames as the seed says, and a file beside them."""
    folder = context.output("frames/front")
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(context.settings.seed):
        (folder / f"{i:04d}.png").write_text(f"{context.settings.seed}")
    context.output("metrics.json").write_text(f"{context.settings.seed}")


STAGE = Stage("frames", inputs=(), outputs=("frames", "metrics.json"), settings=("seed",), run=write)


def go(root: Path, seed: int) -> Workspace:
    workspace = Workspace.create(root)
    run_stages(workspace, [STAGE], RunSettings(seed=seed), root.parent / "drive")
    return workspace


def contents(root: Path) -> dict[str, str]:
    """Visible files by name."""
    names = (p for p in sorted(root.rglob("*")) if p.is_file() and not p.relative_to(root).parts[0].startswith("."))
    return {
        p.relative_to(root).as_posix(): p.read_text() for p in names if p.name not in ("workspace.json", "events.jsonl")
    }


def test_what_somebody_put_beside_outputs_stays_when_they_are_made_anew(tmp_path: Path) -> None:
    root = go(tmp_path / "w", 3).root
    for name in ("frames/roto.nk", "frames/front/comp.blend", "frames/mine/deep/0001.png", "notes.txt"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(name)
    go(root, 2)
    mine = {n: n for n in ("frames/roto.nk", "frames/front/comp.blend", "frames/mine/deep/0001.png", "notes.txt")}
    made = {"frames/front/0000.png": "2", "frames/front/0001.png": "2", "metrics.json": "2"}
    assert contents(root) == {**made, **mine}
    go(root, 1)
    assert contents(root) == {"frames/front/0000.png": "1", "metrics.json": "1", **mine}


def test_what_has_the_name_of_a_new_output_is_put_aside(tmp_path: Path) -> None:
    root = Workspace.create(tmp_path / "w").root
    (root / "frames").mkdir()
    (root / "frames/front").write_text("a file where a folder comes")
    (root / "metrics.json").write_text("mine")
    go(root, 1)
    aside = {"kept/frames/front": "a file where a folder comes", "kept/metrics.json": "mine"}
    assert contents(root) == {"frames/front/0000.png": "1", "metrics.json": "1", **aside}
    (root / "frames/front/0001.png").write_text("mine, too")
    go(root, 2)
    assert (root / "frames/front/0001.png").read_text() == "2"
    aside["kept_2/frames/front/0001.png"] = "mine, too"  # kept/frames/front is a file
    assert {name: text for name, text in contents(root).items() if name.startswith("kept")} == aside


def test_in_a_workspace_of_before_all_of_an_output_is_the_stages(tmp_path: Path) -> None:
    """It left no list, and frames of before must not stand among the new ones."""
    root = go(tmp_path / "w", 3).root
    (root / ".made/frames.json").unlink()
    go(root, 1)
    assert contents(root) == {"frames/front/0000.png": "1", "metrics.json": "1"}


@pytest.mark.parametrize(
    "content", ['{"generator": "another", "files": ["frames/roto.nk"]}', "{", '{"generator": "unveil", "files": 3}']
)
def test_a_damaged_list_gives_nothing_of_a_first_attempt_away(content: str, tmp_path: Path) -> None:
    root = Workspace.create(tmp_path / "w").root
    for name, text in ((".made/frames.json", content), ("frames/roto.nk", "mine")):
        (root / name).parent.mkdir()
        (root / name).write_text(text)
    go(root, 1)
    assert contents(root)["frames/roto.nk"] == "mine"


def test_recovery_removes_what_the_program_left_half_written_and_no_download(tmp_path: Path) -> None:
    root = go(tmp_path / "w", 1).root
    mine = (
        ".film.mkv.partial",
        "frames/.film.mkv.partial",
        "frames/.a.npz.1.new",
        "mine/.x.partial",
        ".partial-film/a.mkv",
    )
    ours = (".workspace.json.ab_12xyz.partial", ".partial-frames/.a.partial", ".blocks/frames/.part.npz.3.new")
    for name in (*mine, *ours, ".partial-frames/.inputs"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(name)
    recover(Workspace.open(root))
    assert [n for n in mine if not (root / n).is_file()] == [] and [n for n in ours if (root / n).exists()] == []


def test_the_list_says_what_a_stage_made(tmp_path: Path) -> None:
    root = go(tmp_path / "w", 2).root
    listed = json.loads((root / ".made/frames.json").read_text())
    assert list(listed["files"]) == ["frames/front/0000.png", "frames/front/0001.png", "metrics.json"]
    assert listed["generator"].startswith("unveil")
