"""The lock of a workspace: whatever becomes of its file, one run works there, and it writes to no file but its own."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from unveil_core.base.errors import InUseError, WorkspaceError
from unveil_core.workspace.journal import commit, open_partial
from unveil_core.workspace.workspace import Workspace

HOLD = """
import sys
from unveil_core.workspace.workspace import Workspace
with Workspace.open(sys.argv[1]).lock():
    print("held", flush=True)
    sys.stdin.readline()
"""
with_folder_locks = pytest.mark.skipif(os.name == "nt", reason="an open file cannot be removed there")


@pytest.fixture
def space(tmp_path: Path) -> Workspace:
    return Workspace.create(tmp_path / "w")


@pytest.fixture
def other(space: Workspace) -> Iterator[subprocess.Popen[str]]:
    """Another process that holds the workspace until it is killed."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(space.root)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        yield holder
        holder.kill()


@with_folder_locks
def test_a_lock_whose_file_was_removed_still_holds(space: Workspace, other: subprocess.Popen[str]) -> None:
    (space.root / ".lock").unlink()
    with pytest.raises(InUseError, match="In use by another process"), space.lock():
        pass
    other.kill()
    other.wait()
    with space.lock():
        pass


@with_folder_locks
def test_the_file_that_is_locked_is_the_one_that_the_path_names(
    space: Workspace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is removed, and made by somebody else, between the moment it is opened and that in which it is locked."""
    import unveil_core.base.disk.lock as module

    real, left = module.lock_file, [2]

    def lock_one_that_is_removed(handle: int, shared: bool = False) -> None:
        real(handle, shared)
        if left[0] and stat.S_ISREG(os.fstat(handle).st_mode):
            left[0] -= 1
            (space.root / ".lock").unlink()
            (space.root / ".lock").write_text("")

    monkeypatch.setattr(module, "lock_file", lock_one_that_is_removed)
    with space.lock():
        assert left == [0]
        assert (space.root / ".lock").read_bytes()[1:].startswith(str(os.getpid()).encode())


@with_folder_locks
def test_a_commit_puts_the_file_of_the_lock_there_again(space: Workspace) -> None:
    with space.lock():
        (space.root / ".lock").unlink()
        partial = open_partial(space, "mesh", "0" * 32)
        (partial / "out").write_text("new")
        commit(space, "mesh", partial, ["out"], {"status": "done"})
        assert (space.root / "out").read_text() == "new" and (space.root / ".lock").is_file()
        with pytest.raises(InUseError), Workspace.open(space.root).lock():
            pass


@with_folder_locks
def test_nothing_is_committed_where_another_has_the_lock(space: Workspace, tmp_path: Path) -> None:
    """The whole folder was moved away, and another one lies in its place."""
    with space.lock():
        partial = open_partial(space, "mesh", "0" * 32)
        (partial / "out").write_text("new")
        space.root.rename(tmp_path / "moved")
        Workspace.create(space.root)
        with pytest.raises(WorkspaceError, match="Another folder took its place"):
            commit(space, "mesh", partial, ["out"], {"status": "done"})
        assert sorted(p.name for p in space.root.iterdir()) == [".lock", "workspace.json"]
        assert (tmp_path / "moved/.partial-mesh/out").read_text() == "new"


def test_several_share_and_one_alone_does_not(space: Workspace) -> None:
    alone = Workspace.open(space.root).lock()
    with space.lock(shared=True), Workspace.open(space.root).lock(shared=True), pytest.raises(InUseError), alone:
        pass
    with alone:
        pass


@pytest.mark.parametrize("name", [".lock", "events.jsonl"])
def test_a_hard_link_is_not_written_to(name: str, space: Workspace, tmp_path: Path) -> None:
    (tmp_path / "bashrc").write_text("precious")
    (space.root / name).unlink(missing_ok=True)
    os.link(tmp_path / "bashrc", space.root / name)
    with pytest.raises(WorkspaceError, match="is a hard link"):
        Workspace.open(space.root)
    with pytest.raises(WorkspaceError, match="is a hard link"):
        Workspace.create(space.root)
    with pytest.raises(WorkspaceError, match="is a hard link"), space.lock():  # was put there after it was opened
        space.log("import", "$(touch x)")
    with pytest.raises(WorkspaceError, match="is a hard link"), space.lock():
        space.end_cut_event()
    assert (tmp_path / "bashrc").read_text() == "precious"
