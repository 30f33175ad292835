"""Places where a workspace cannot be: read-only ones, file systems without locks, folders of other versions. One line each."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from unveil_core.base.errors import InUseError, WorkspaceError
from unveil_core.pipeline.runner import run_stages
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Stage, StageContext
from unveil_core.workspace.workspace import Workspace

ROOT = Path(__file__).resolve().parents[2]


def write(context: StageContext) -> None:
    context.output("a.txt").write_text("a")


STAGES = (Stage("write", write, (), ("a.txt",)),)


def go(root: Path) -> list[str]:
    return run_stages(Workspace.create(root), STAGES, RunSettings(), Path("."))


def contents(root: Path) -> dict[str, tuple[bytes, int]]:
    return {str(p): (p.read_bytes(), p.stat().st_mtime_ns) for p in root.rglob("*") if p.is_file()}


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Path]:
    """A folder with a finished workspace that cannot be written."""
    place = tmp_path / "place"
    go(place / "ws")
    mounted = subprocess.run(["mount", "--bind", str(place), str(place)], capture_output=True)
    if mounted.returncode:
        pytest.skip("no right to mount")
    try:
        subprocess.run(["mount", "-o", "remount,bind,ro", str(place)], check=True)
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=True)


def test_a_read_only_workspace_and_a_new_one_there_are_one_line(read_only: Path) -> None:
    before = contents(read_only)
    for name in ("ws", "new", "deep/er/new"):
        with pytest.raises(WorkspaceError, match=f"{name}: cannot be written: Read-only file system .make it writable"):
            go(read_only / name)
    assert Workspace.open(read_only / "ws").state()["stages"]["write"]["status"] == "done"
    assert contents(read_only) == before


NOBODY = """
import os, sys
from pathlib import Path
from unveil_core.base.errors import WorkspaceError
from unveil_core.workspace.workspace import Workspace
os.setuid(65534)
for name in ("ws", "new"):
    try:
        with Workspace.create(Path(sys.argv[1]) / name).lock():
            pass
    except WorkspaceError as error:
        print(error)
"""


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can become another user")
def test_who_may_not_write_is_told_so(tmp_path: Path) -> None:
    go(tmp_path / "ws")
    for folder in (tmp_path, *tmp_path.parents):
        if folder.owner() == "root" and folder != Path("/"):
            folder.chmod(folder.stat().st_mode | 0o055)
    done = subprocess.run([sys.executable, "-c", NOBODY, str(tmp_path)], capture_output=True, text=True, cwd=ROOT)
    lines = done.stdout.splitlines()
    assert len(lines) == 2, done.stderr
    assert all(": cannot be written: Permission denied (make it writable" in line for line in lines)


LOCKS = """
import sys
from unveil_core.base.errors import WorkspaceError
from unveil_core.workspace.workspace import Workspace
try:
    with Workspace.create(sys.argv[1]).lock():
        print("held")
except WorkspaceError as error:
    print(error)
"""


@pytest.mark.skipif(
    not sys.platform.startswith("linux") or not shutil.which("gcc"), reason="preloads a library, made by gcc"
)
def test_a_file_system_without_locks_is_told_and_may_be_used_all_the_same(tmp_path: Path) -> None:
    library, source = tmp_path / "shim.so", ROOT / "benchmarks/robustness/fault_kinds/shim.c"
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", str(library), str(source), "-ldl"], check=True)

    def try_it(**variables: str) -> str:
        environment = {**os.environ, "LD_PRELOAD": str(library), "UNVEIL_FLOCK_ERROR": str(errno.ENOLCK), **variables}
        command = [sys.executable, "-c", LOCKS, str(tmp_path / "ws")]
        return subprocess.run(command, env=environment, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True).stdout

    said = try_it()
    assert said.startswith(f"{tmp_path / 'ws'}: On a file system without locks, which cannot keep two runs apart: ")
    assert said.endswith("(use a local disk; where no other run can come, set UNVEIL_NO_LOCKS=1)\n")
    assert try_it(UNVEIL_NO_LOCKS="1") == "held\n"


@pytest.mark.parametrize("number", [errno.ENOSYS, errno.EOPNOTSUPP])
def test_only_a_lock_that_is_taken_is_called_taken(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    space = Workspace.create(tmp_path / "w")
    with space.lock(), pytest.raises(InUseError, match="In use by another process"), space.lock():
        pass

    def flock(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", flock)
    with pytest.raises(WorkspaceError, match="without locks"), space.lock():
        pass
    monkeypatch.setenv("UNVEIL_NO_LOCKS", "1")
    with space.lock():
        pass


@pytest.mark.parametrize("number", [0, 2, "3.1"])
def test_a_workspace_of_another_version_is_left_as_it_is(number: object, tmp_path: Path) -> None:
    """Also what a kill left there: finishing it would mix two versions."""
    root = tmp_path / "w"
    go(root)
    state = json.loads((root / "workspace.json").read_text())
    (root / "workspace.json").write_text(json.dumps({**state, "format": number}))
    (root / ".partial-write").mkdir()
    (root / ".partial-write/a.txt").write_text("newer")
    entry = {"stage": "write", "partial": ".partial-write", "outputs": ["a.txt"], "record": {}}
    (root / ".journal.json").write_text(json.dumps(entry))
    (root / ".half.abc.partial").write_text("")
    (root / "events.jsonl").write_text('{"cut')
    before = {name: found for name, found in contents(root).items() if not name.endswith(".lock")}
    with pytest.raises(WorkspaceError, match="has format .*, this version reads 1 .use the version of Unveil"):
        go(root)
    assert {name: found for name, found in contents(root).items() if not name.endswith(".lock")} == before
