"""Two at once in one workspace, as real processes: one goes on, the other says who holds it, and nothing is lost."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import unveil_core.pipeline.run as run_module
from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.base.errors import WorkspaceError
from unveil_core.drives import open_drive
from unveil_core.workspace.workspace import Workspace

HOLD = """
import sys, time
from unveil_core.workspace.workspace import Workspace
with Workspace.open(sys.argv[1]).lock():
    print("held", flush=True)
    time.sleep(600)
"""


def unveil(drive: Path, root: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "unveil_core", "import", str(drive), "-o", str(root)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("later_s", [0.0, 0.05])
def test_two_runs_into_one_new_folder_lose_nothing(tmp_path: Path, later_s: float) -> None:
    drive, root = make_tiny_drive(tmp_path / "drive"), tmp_path / "w"
    first = unveil(drive, root)
    time.sleep(later_s)
    both = (first, unveil(drive, root))
    said = [process.communicate(timeout=300)[1].strip() for process in both]
    ends = [process.returncode for process in both]
    # The second may come when the first is done; it then finds nothing left to do.
    assert 0 in ends
    assert set(ends) <= {0, 2}
    for end, line in zip(ends, said, strict=True):
        if end == 2:
            assert "In use by another process" in line
            assert "\n" not in line
    assert len(open_drive(root / "drive").frames) == 4
    assert Workspace.open(root).state()["stages"]["import"]["status"] == "done"


def test_who_comes_second_leaves_the_first_one_s_workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The other run begins while this one looks at its drive, and has not imported anything yet when this one finds it there."""
    drive, root, others = make_tiny_drive(tmp_path / "drive"), tmp_path / "w", []
    look = run_module.check_drive

    def long_look(*arguments: Any) -> None:
        look(*arguments)
        Workspace.create(root)
        holder = subprocess.Popen([sys.executable, "-c", HOLD, str(root)], stdout=subprocess.PIPE, text=True)
        others.append(holder)
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"

    monkeypatch.setattr(run_module, "check_drive", long_look)
    try:
        with pytest.raises(WorkspaceError, match="In use by another process"):
            run_module.run(drive, root, until="import")
        assert Workspace.open(root).state()["stages"] == {}
    finally:
        for holder in others:
            holder.kill()
            holder.wait()


def test_who_holds_a_workspace_is_told(tmp_path: Path) -> None:
    space = Workspace.create(tmp_path / "w")
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(space.root)], stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None
    try:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(WorkspaceError, match=f"In use by another process, {holder.pid} on "), space.lock():
            pass
    finally:
        holder.kill()
        holder.wait()
    with space.lock():  # the system drops it with the process
        pass


def test_a_signature_that_is_none_is_not_repeated(tmp_path: Path) -> None:
    space = Workspace.create(tmp_path / "w")
    with space.lock():
        (space.root / ".lock").write_text("\0<script>\x1b[31m")
        with pytest.raises(WorkspaceError, match="In use by another process .wait"), space.lock():
            pass


def test_only_who_made_a_folder_may_remove_it(tmp_path: Path) -> None:
    assert Workspace.create(tmp_path / "w").made
    assert not Workspace.create(tmp_path / "w").made
    (tmp_path / "empty").mkdir()
    assert not Workspace.create(tmp_path / "empty").made


def test_a_folder_that_another_process_is_just_making_is_no_strangers(tmp_path: Path) -> None:
    root = tmp_path / "w"
    root.mkdir()
    (root / ".workspace.json.abc.partial").write_bytes(b"{")
    assert Workspace.create(root).workspace_json.is_file()
    os.remove(root / "workspace.json")
    (root / "mine.txt").write_text("x")
    with pytest.raises(WorkspaceError, match="Not empty"):
        Workspace.create(root)


def test_a_workspace_that_was_removed_is_one_line(tmp_path: Path) -> None:
    space = Workspace(tmp_path / "gone")
    with pytest.raises(WorkspaceError, match="Not there any more"), space.lock():
        pass


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("[]", "Not what a workspace says of itself"),
        ('{"stages": []}', "Not what a workspace says of itself"),
        ('{"stages": {"import": 3}}', "Not what a workspace says of itself"),
        ('{"stages": {}}', "Another program's file"),
        ('{"format": 1, "stages": {}}', "Another program's file"),
        ('{"format": 1, "generator": "nx 20", "stages": {}}', "Another program's file"),
        ('{"format": 2, "generator": "unveil 9.1", "stages": {}}', "has format 2, this version reads 1"),
        ('{"format": 1, "sta', "cannot be read"),
        ("[" * 100_000, "cannot be read"),
    ],
)
def test_a_workspace_of_another_version_or_none_is_told_in_a_line(content: str, says: str, tmp_path: Path) -> None:
    workspace = Workspace.create(tmp_path / "w")
    workspace.workspace_json.write_text(content)
    with pytest.raises(WorkspaceError, match=says):
        workspace.state()
    assert workspace.workspace_json.read_text() == content
