"""A stranger's workspace with links in it: nothing that they lead to is changed."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from unveil_core.base.disk.links import refuse_links
from unveil_core.base.errors import WorkspaceError
from unveil_core.pipeline.runner import run_stages
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Stage, StageContext
from unveil_core.workspace.workspace import Workspace


def write(context: StageContext) -> None:
    (context.output("frames") / "0000.txt").parent.mkdir(parents=True, exist_ok=True)
    (context.output("frames") / "0000.txt").write_text("clean")


STAGE = Stage("frames", inputs=(), outputs=("frames",), settings=(), run=write)


@pytest.mark.parametrize(
    "name",
    [
        ".blocks",
        ".blocks/frames",
        ".blocks/frames/block_000",
        ".blocks/frames/block_000/digest",
        ".partial-frames",
        ".partial-frames/frames",
        "frames",
        "surfels",
        "events.jsonl",
        ".lock",
    ],
)
def test_a_run_does_not_write_or_remove_through_a_link(name: str, tmp_path: Path) -> None:
    root, elsewhere = tmp_path / "w", tmp_path / "elsewhere"
    Workspace.create(root)
    (elsewhere / "inner" / "digest").mkdir(parents=True)
    for folder in (elsewhere, elsewhere / "inner", elsewhere / "inner/digest"):
        (folder / "letter.txt").write_text("dear")
    is_file = name in ("events.jsonl", ".lock")
    (root / name).unlink(missing_ok=True)
    (root / name).parent.mkdir(parents=True, exist_ok=True)
    (root / name).symlink_to(elsewhere / "letter.txt" if is_file else elsewhere)
    space = Workspace(root)  # as where the link was made after it was opened
    for act in (lambda: Workspace.open(root), lambda: run_stages(space, (STAGE,), RunSettings(), tmp_path, force=True)):
        with pytest.raises(WorkspaceError, match=f"{Path(name).name}: (A|it is a) symbolic link"):
            act()
    left = {str(p.relative_to(elsewhere)): p.read_text() for p in elsewhere.rglob("*") if p.is_file()}
    assert left == dict.fromkeys(("letter.txt", "inner/letter.txt", "inner/digest/letter.txt"), "dear")
    (root / name).unlink()
    assert run_stages(Workspace.open(root), (STAGE,), RunSettings(), tmp_path) == ["frames"]


def test_a_workspace_may_be_reached_through_a_link(tmp_path: Path) -> None:
    Workspace.create(tmp_path / "disk/w")
    (tmp_path / "w").symlink_to(tmp_path / "disk/w")
    assert run_stages(Workspace.open(tmp_path / "w"), (STAGE,), RunSettings(), tmp_path) == ["frames"]
    assert (tmp_path / "disk/w/frames/0000.txt").read_text() == "clean"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
@pytest.mark.parametrize("name", [".digests.json", "drive/cameras.json", "meshes/empty.ply", "workspace.json"])
def test_a_pipe_is_refused_before_anything_is_read(name: str, tmp_path: Path) -> None:
    Workspace.create(tmp_path / "w")
    pipe = tmp_path / "w" / name
    pipe.parent.mkdir(exist_ok=True)
    pipe.unlink(missing_ok=True)
    os.mkfifo(pipe)
    for reach in (Workspace.open, Workspace.create):
        with pytest.raises(WorkspaceError, match="pipe or a device|Not a workspace|Not empty"):
            reach(tmp_path / "w")


def test_a_workspace_may_be_looked_at_while_a_run_removes_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Workspace.create(tmp_path / "w")
    (tmp_path / "w/.partial-mesh").mkdir()
    real = os.scandir

    def scandir(path: str) -> object:
        if path.endswith(".partial-mesh"):
            os.rmdir(path)
        return real(path)

    monkeypatch.setattr(os, "scandir", scandir)
    Workspace.open(tmp_path / "w")
    assert not (tmp_path / "w/.partial-mesh").exists()


def test_of_thousands_of_files_none_is_looked_at_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ten thousand looks at files would take a second on a disk in the network."""
    Workspace.create(tmp_path / "w")
    for camera in range(10):
        folder = tmp_path / f"w/frames/{camera}"
        folder.mkdir(parents=True)
        for i in range(1000):
            (folder / f"{i}.png").touch()
    looks: list[object] = []
    for name in ("scandir", "stat", "lstat", "open"):
        real = getattr(os, name)
        monkeypatch.setattr(
            os, name, lambda path, *rest, real=real, **more: looks.append(path) or real(path, *rest, **more)
        )
    refuse_links(tmp_path / "w")
    assert 12 <= len(looks) < 30
    monkeypatch.undo()
    (tmp_path / "w/frames/9/999.png").unlink()
    (tmp_path / "w/frames/9/999.png").symlink_to(tmp_path)
    with pytest.raises(WorkspaceError):
        refuse_links(tmp_path / "w")
