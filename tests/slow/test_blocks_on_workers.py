"""Blocks of one drive as tasks: made by a Dask worker and by another farm, and merged here into what one run makes."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from tests.worlds.box_worlds import make_box_world
from tests.worlds.long_street import long_street, long_way
from unveil_core.app.cli import main
from unveil_core.farm.manifest import Batch, Task, plan_batch
from unveil_core.farm.run import run_batch
from unveil_core.farm.state import TaskState, seen_state, state_of
from unveil_core.farm.status import batch_status
from unveil_core.ground import blocks
from unveil_core.pipeline.run import run
from unveil_core.pipeline.settings import RunSettings
from unveil_core.workspace.workspace import Workspace

FRAMES, BLOCK_M = 13, 6.0
OPTIONS = ("--remove=car", "--iterations=20", "--quality=draft")
SHORT_BLOCKS = f"""
import sys
if "unveil_core" in sys.orig_argv:  # a task's command
    from unveil_core.ground import blocks
    blocks.BLOCK_M = {BLOCK_M}
"""
"""What each Python process of the test begins with: so small a drive has two blocks for the commands of its tasks, too."""
TIMED = ("workspace.json", "events.jsonl", ".digests.json", ".lock")


@pytest.fixture
def batch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Batch:
    """A drive of two blocks, planned until the frames are delivered."""
    monkeypatch.setattr(blocks, "BLOCK_M", BLOCK_M)
    (tmp_path / "site").mkdir()
    (tmp_path / "site/sitecustomize.py").write_text(SHORT_BLOCKS)
    paths = [str(tmp_path / "site"), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(p for p in paths if p))
    drive = make_box_world(tmp_path / "street", long_street(float(FRAMES)), long_way(FRAMES, size=(32, 24)), rays=200)
    given = RunSettings(remove=("car",), iterations=20, quality="draft")
    batch = plan_batch([drive], tmp_path / "batch", given, OPTIONS)
    *tasks, last = batch.tasks
    batch = replace(batch, tasks=(*tasks, replace(last, arguments=(*last.arguments[:-1], "deliver"))))
    batch.save()
    return batch


def contents(root: Path) -> dict[str, bytes]:
    names = {p.relative_to(root).as_posix(): p for p in sorted(root.rglob("*")) if p.is_file()}
    return {name: path.read_bytes() for name, path in names.items() if name not in TIMED}


def test_blocks_that_workers_and_another_farm_made_are_merged_into_what_one_run_makes(
    batch: Batch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    distributed = pytest.importorskip("distributed")
    prepare, *reconstruct, inpaint, first, last, deliver = batch.tasks
    assert [t.step for t in batch.tasks] == [
        "prepare",
        "reconstruct",
        "reconstruct",
        "inpaint",
        "reoptimize",
        "reoptimize",
        "report",
    ]

    workspace = Workspace(Path(batch.drives[0].workspace))

    def another_farm(task: Task) -> None:
        """Its workers know nothing of batches: they run the commands that a template gives them."""
        assert main(list(task.arguments)) == 0
        assert state_of(batch, task) == TaskState() and seen_state(batch, task).status == "done"

    def worker(task: Task) -> None:
        assert run_batch(replace(batch, tasks=(task,)), lambda line: None, scheduler=cluster.scheduler_address) == []
        assert state_of(batch, task).status == "done"

    def merge(task: Task, stage: str) -> None:
        before = len(workspace.events())
        assert main(["batch", "merge", str(batch.root)]) == 0
        assert f"{task.id}: done" in capsys.readouterr().out
        said = [e["message"] for e in workspace.events()[before:] if e["stage"] == stage]
        assert said[-1] == "done" and not any(m.startswith("block") for m in said), "no block was made again"

    assert batch_status(batch)["tasks"]["to do"] == 7
    another_farm(prepare)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as cluster:
        worker(reconstruct[1])
        assert seen_state(batch, reconstruct[0]).status == "to do"
        another_farm(reconstruct[0])
        merge(inpaint, "reconstruct")
        another_farm(first)
        worker(last)
    assert seen_state(batch, deliver).status == "to do"
    merge(deliver, "reoptimize")
    assert batch_status(batch)["tasks"] == {"done": 7, "running": 0, "failed": 0, "to do": 0}
    given = RunSettings(remove=("car",), iterations=20, quality="draft")
    whole = run(Path(batch.drives[0].drive), tmp_path / "whole", given, until="deliver")
    assert len(whole.state()["stages"]["reconstruct"]["choices"]["blocks"]) == 2
    one, other = contents(whole.root), contents(workspace.root)
    assert sorted(one) == sorted(other)
    assert [name for name in one if one[name] != other[name]] == []
