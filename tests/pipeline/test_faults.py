"""Stages that run out of memory, or whose files change under them; and what kills leave half-written."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.base.errors import (
    GpuTooSmallError,
    InUseError,
    OutOfMemoryError,
    SettingsError,
    UnveilError,
    WorkspaceError,
)
from unveil_core.base.kernels.device import current_device, note_of_device
from unveil_core.pipeline.run import run
from unveil_core.pipeline.runner import run_stages
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Stage, StageContext, parts_of
from unveil_core.workspace.journal import recover
from unveil_core.workspace.workspace import Workspace

MOST = 1 << 46


def read(context: StageContext) -> None:
    context.output("sum.txt").write_text(context.drive.read_text())


def outside(workspace: Workspace, settings: RunSettings, drive: Path) -> list[tuple[str, Path]]:
    return [("drive", drive)]


STAGE = Stage("read", read, (), ("sum.txt",), outside=outside)


def go(root: Path, drive: Path, stage: Stage = STAGE) -> list[str]:
    return run_stages(Workspace.create(root), (stage,), RunSettings(), drive)


@pytest.mark.parametrize(
    "said",
    [
        "CUDA out of memory. Tried to allocate 9 GiB. GPU 0 has a total capacity of 8 GiB",
        "CUDA error: out of memory\nCompile with `TORCH_USE_CUDA_DSA`",
        "Triton Error [CUDA]: out of memory",
        "CUDA error: CUBLAS_STATUS_ALLOC_FAILED when calling `cublasCreate(handle)`",
    ],
)
def test_want_of_the_gpu_s_memory_is_told_with_what_to_do(said: str, tmp_path: Path) -> None:
    def hungry(context: StageContext) -> None:
        raise RuntimeError(said)

    (tmp_path / "drive").write_text("a street")
    with pytest.raises(OutOfMemoryError, match=r"no memory left on the GPU for read \(.*--device cpu: it goes on"):
        go(tmp_path / "ws", tmp_path / "drive", replace(STAGE, run=hungry))


def test_a_gpu_that_is_full_when_a_run_goes_on_costs_nothing_that_was_computed(tmp_path: Path) -> None:
    def begins(context: StageContext) -> None:
        context.kept.once("half", lambda: {"found": np.arange(3)})
        raise GpuTooSmallError("the GPU has 1 GB free", mend="use --device cpu")

    def goes_on(context: StageContext) -> None:
        assert context.kept.once("half", dict)["found"].tolist() == [0, 1, 2]
        read(context)

    (tmp_path / "drive").write_text("a street")
    with pytest.raises(SettingsError, match="1 GB free"):
        go(tmp_path / "ws", tmp_path / "drive", replace(STAGE, run=begins))
    assert run_stages(
        Workspace.open(tmp_path / "ws"), (replace(STAGE, run=goes_on),), RunSettings(), tmp_path / "drive"
    )


def test_a_stage_records_what_it_worked_on_and_why_not_elsewhere(tmp_path: Path) -> None:
    def working(context: StageContext) -> None:
        current_device()
        note_of_device("training on the processor: too large")
        read(context)

    (tmp_path / "drive").write_text("a street")
    for stage, found in (
        (STAGE, (None, None)),
        (replace(STAGE, run=working), ("cpu", ["training on the processor: too large"])),
    ):
        root = tmp_path / str(found[0])
        events: list[dict[str, object]] = []
        run_stages(
            Workspace.create(root), (stage,), RunSettings(device="cpu"), tmp_path / "drive", reporter=events.append
        )
        recorded = json.loads((root / "workspace.json").read_text())["stages"]["read"]
        assert (recorded.get("device"), recorded.get("device_notes")) == found
        assert [e["message"] for e in events if e["level"] == "notice"] == (found[1] or [])


@pytest.mark.parametrize(
    "allocate",
    [lambda: np.zeros(MOST, np.uint8), lambda: torch.zeros(MOST, dtype=torch.uint8), lambda: bytearray(MOST)],
)
def test_want_of_memory_is_told_and_what_was_computed_serves_the_next_attempt(
    allocate: Callable[[], object], tmp_path: Path
) -> None:
    made: list[str] = []

    def hungry(context: StageContext) -> None:
        context.kept.once("first", lambda: made.append("first") or {"x": np.zeros(1)})
        if len(made) == 1:
            made.append("hungry")
            allocate()
        read(context)

    (tmp_path / "drive").write_text("3")
    stage = replace(STAGE, run=hungry)
    line = r"w: no memory left for read, at \d+ MB .end other programs or use a machine with more: it goes on where"
    with pytest.raises(OutOfMemoryError, match=line):
        go(tmp_path / "w", tmp_path / "drive", stage)
    workspace = Workspace.open(tmp_path / "w")
    assert workspace.state()["stages"]["read"]["status"] == "failed"
    assert "allocate" in workspace.events()[-1]["traceback"]
    assert go(tmp_path / "w", tmp_path / "drive", stage) == ["read"] and made == ["first", "hungry"]


@pytest.mark.parametrize("how", ["changed", "changed and put back", "removed", "removed and missed"])
def test_a_file_that_changes_under_a_stage_spoils_no_result(how: str, tmp_path: Path) -> None:
    drive, root = tmp_path / "drive", tmp_path / "w"
    drive.write_text("3")

    def disturbed(context: StageContext) -> None:
        (parts_of(root, "read") / "block_000/digest").mkdir(parents=True)
        if how.startswith("removed"):
            drive.unlink()
        else:
            drive.write_text("4")
            os.utime(drive, ns=(1, 1))
        if how == "removed and missed":
            read(context)
        context.output("sum.txt").write_text("of what was read")
        if how == "changed and put back":
            drive.write_text("3")

    kind = "Changed or removed while read read it .leave it alone during a run, and run again"
    with pytest.raises(UnveilError, match=f"drive: {kind}"):
        go(root, drive, replace(STAGE, run=disturbed))
    assert not (root / "sum.txt").exists() and not list(root.glob(".partial*")) and not parts_of(root, "read").exists()
    drive.write_text("3")
    assert go(root, drive) == ["read"] and (root / "sum.txt").read_text() == "3"
    os.utime(drive, (4_102_444_800, 4_102_444_800))  # another time alone is no other content, once nobody reads it
    assert go(root, drive) == []


def test_a_folder_that_is_removed_under_a_run_is_one_line(tmp_path: Path) -> None:
    """Also when the run would write that down in the folder."""
    drive, root = tmp_path / "drive", tmp_path / "w"
    drive.write_text("3")

    def disturbed(context: StageContext) -> None:
        for path in sorted(root.rglob("*"), reverse=True):
            path.rmdir() if path.is_dir() else path.unlink()
        root.rmdir()
        read(context)

    with pytest.raises((OSError, WorkspaceError)):
        go(root, drive, replace(STAGE, run=disturbed))


def test_after_a_kill_the_next_run_says_so(tmp_path: Path) -> None:
    """The killed one cannot, and who finds it gone in the morning asks why."""
    (tmp_path / "drive").write_text("3")
    workspace = Workspace.create(tmp_path / "w")
    workspace.update_stage("read", status="running")
    assert go(tmp_path / "w", tmp_path / "drive") == ["read"] and go(tmp_path / "w", tmp_path / "drive") == []
    told = [e for e in workspace.events() if "ended here: killed, or out of memory" in e["message"]]
    assert [(e["stage"], e["level"]) for e in told] == [("read", "notice")]


def test_what_a_kill_left_half_written_is_no_part_of_the_result(tmp_path: Path) -> None:
    workspace = Workspace.create(tmp_path / "w")
    report = workspace.root / ".partial-report/report"
    report.mkdir(parents=True)
    (report.parent / ".inputs").write_text("digest")
    left = [".index.html.abc.partial", ".before_after.x1_y.partial.mp4", ".part.npz.123.new"]
    for name in left:
        (report / name).write_bytes(b"half")
    (report / "whole.partial.txt").write_bytes(b"somebody's")
    workspace.log("report", "whole")
    with workspace.events_jsonl.open("a") as stream:
        stream.write('{"t": 1, "stage": "cut')
    recover(workspace)
    assert [p.name for p in report.iterdir()] == ["whole.partial.txt"]
    workspace.log("report", "after")
    assert [e["message"] for e in workspace.events()] == ["whole", "after"]
    before = workspace.events_jsonl.read_bytes()
    recover(workspace)
    assert workspace.events_jsonl.read_bytes() == before


HOLD = """
import sys, time
from pathlib import Path
from unveil_core.workspace.workspace import Workspace
with Workspace(Path(sys.argv[1])).lock():
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_run_that_meets_another_does_not_remove_what_both_work_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other may have begun nothing yet, and let go of the lock for a moment."""
    drive, root = make_tiny_drive(tmp_path / "drive"), tmp_path / "w"
    real, others = Workspace.create, []

    def create_and_meet(path: str | Path) -> Workspace:
        space = real(path)
        others.append(subprocess.Popen([sys.executable, "-c", HOLD, str(root)], stdout=subprocess.PIPE, text=True))
        assert others[0].stdout is not None and others[0].stdout.readline() == "held\n"
        return space

    def met_and_gone(stages: object, *rest: object, **options: object) -> None:
        try:
            run_stages(stages, *rest, **options)  # type: ignore[arg-type]
        finally:
            others[0].kill()
            others[0].communicate()

    monkeypatch.setattr(Workspace, "create", staticmethod(create_and_meet))
    monkeypatch.setattr("unveil_core.pipeline.run.run_stages", met_and_gone)
    with pytest.raises(InUseError, match="In use by another process, "):
        run(drive, root, RunSettings(remove=("vehicle",)))
    assert json.loads((root / "workspace.json").read_text())["format"] == 1
