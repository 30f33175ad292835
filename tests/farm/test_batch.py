"""Batches: planned once, run on real workers, and read back from files."""

from __future__ import annotations

import http.client
import importlib.util
import json
import os
import platform
import re
import shutil
import signal
import subprocess
import threading
import time
import urllib.parse
import urllib.request
from dataclasses import replace
from pathlib import Path

import pytest

from tests.drives.tiny_drive import make_tiny_drive
from tests.worlds.box_worlds import make_box_world
from tests.worlds.long_street import long_street, long_way
from unveil_core.app.cli import main
from unveil_core.base.errors import SettingsError, WorkspaceError
from unveil_core.farm import manifest
from unveil_core.farm.manifest import Batch, BatchDrive, Task, plan_batch, read_batch
from unveil_core.farm.run import MEMORY, RETRIES, run_batch, workers_that_fit
from unveil_core.farm.state import TaskState, note_state, state_of
from unveil_core.farm.status import batch_status, status_lines
from unveil_core.farm.task import TaskFailed, end_tasks, run_task, tasks_may_begin
from unveil_core.forecast.machine import this_machine
from unveil_core.ground import blocks
from unveil_core.pipeline.settings import RunSettings


@pytest.fixture(scope="module")
def long_drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("long") / "street"
    return make_box_world(folder, long_street(20.0), long_way(20, size=(32, 24)), rays=200)


@pytest.fixture
def planned(long_drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Batch:
    monkeypatch.setattr(blocks, "BLOCK_M", 6.0)
    short = make_tiny_drive(tmp_path / "short")
    return plan_batch([long_drive, short], tmp_path / "batch", RunSettings(seed=4), ("--seed=4",))


def test_a_long_drive_has_a_task_for_each_block_and_each_waits_for_what_it_needs(planned: Batch) -> None:
    by_id = {t.id: t for t in planned.tasks}
    assert [d.blocks for d in planned.drives] == [3, 1]
    assert [t.step for t in planned.tasks if t.drive == "street"] == [
        "prepare",
        *["reconstruct"] * 3,
        "inpaint",
        *["reoptimize"] * 3,
        "report",
    ]
    assert by_id["street.reconstruct.0002"].arguments[-3:] == (planned.drives[0].workspace, "reconstruct", "2")
    assert by_id["street.inpaint"].after == tuple(f"street.reconstruct.{k:04d}" for k in range(3))
    assert by_id["street.prepare"].arguments[-3:] == ("--seed=4", "--until", "choose")
    assert by_id["short.all"].after == () and by_id["short.all"].step == "all"
    planned.save()
    assert read_batch(planned.root) == planned


def test_blocks_are_counted_in_metres_that_the_user_gave(
    long_drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(blocks, "BLOCK_M", 6.0)
    batch = plan_batch([long_drive], tmp_path / "batch", RunSettings(scale=4.0))
    assert [d.blocks for d in batch.drives] == [1]


def test_a_batch_for_a_card_is_forecast_by_runs_on_a_card(
    long_drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("UNVEIL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(manifest, "name_of_device", lambda setting: "cuda:0" if setting == "cuda" else "cpu")
    for device, ratio in (("cpu", 8.0), ("cuda:0", 0.5)):
        machine = this_machine(device=device)
        machine.ratios = {"standard.reconstruct": [ratio]}
        machine.save()
    seconds = {}
    for device in ("cpu", "cuda"):
        (drive,) = plan_batch([long_drive], tmp_path / device, RunSettings(device=device)).drives
        seconds[device] = drive.seconds
        assert drive.gpus == (device == "cuda")
    assert seconds["cpu"] == pytest.approx(16 * seconds["cuda"], rel=0.05)


def test_two_drives_of_one_name_have_two_workspaces(tmp_path: Path) -> None:
    paths = [make_tiny_drive(tmp_path / k / "my drive!") for k in ("a", "b")]
    batch = plan_batch(paths, tmp_path / "batch", RunSettings())
    assert [d.name for d in batch.drives] == ["my_drive", "my_drive_2"]
    # Where case does not count they would have one, and some names are those of devices.
    paths = [make_tiny_drive(tmp_path / k) for k in ("c/Street", "d/street", "e/con")]
    batch = plan_batch(paths, tmp_path / "other", RunSettings())
    assert [d.name for d in batch.drives] == ["Street", "street_2", "_con"]
    batch.save()
    assert read_batch(tmp_path / "other") == batch
    with pytest.raises(SettingsError, match="no drive"):
        plan_batch([], tmp_path / "none", RunSettings())


@pytest.mark.parametrize(
    "change", [{"version": 2}, {"tasks": [{"id": "../x", "after": []}]}, {"drives": 3}, {"tasks": None}]
)
def test_a_damaged_manifest_is_one_clear_line(planned: Batch, change: dict[str, object]) -> None:
    planned.save()
    path = planned.root / "batch.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(WorkspaceError, match="Not a batch"):
        read_batch(planned.root)


def test_a_drive_that_cannot_be_read_is_left_out_of_the_plan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = make_tiny_drive(tmp_path / "good"), make_tiny_drive(tmp_path / "bad")
    bad.write_text("{")
    root = str(tmp_path / "batch")
    assert main(["batch", "plan", str(bad), str(good), "-o", root]) == 1
    said = capsys.readouterr()
    assert "1 drives" in said.out and "left out" in said.err and str(bad) in said.err
    assert [d.name for d in read_batch(Path(root)).drives] == ["good"]
    assert main(["batch", "plan", str(bad), "-o", str(tmp_path / "other")]) != 0
    assert "no drive to plan" in capsys.readouterr().err


def test_what_a_task_of_other_options_or_of_a_lost_process_noted_does_not_count(planned: Batch) -> None:
    task = planned.tasks[0]
    note_state(planned, task, TaskState("done", 1, 2.0))
    assert state_of(planned, task).status == "done"
    other = replace(task, arguments=(*task.arguments, "--quality=high"))
    assert state_of(planned, other) == TaskState()
    ended = subprocess.Popen(["true"])
    ended.wait()
    for process, expected in ((os.getpid(), "running"), (ended.pid, "to do")):
        note_state(planned, task, TaskState("running", 2, host=platform.node(), process=process))
        assert (state_of(planned, task).status, state_of(planned, task).tries) == (expected, 2)


def cheap(root: Path, names: list[str], tmp_path: Path, *, broken: str = "", memory_mb: int = 0) -> Batch:
    """Drives of which only the import is run, in two tasks each."""
    drives, tasks = [], []
    for name in names:
        path = make_tiny_drive(tmp_path / "drives" / name)
        if name == broken:
            path.write_text("{")
        workspace = root / "drives" / name
        drives.append(BatchDrive(name, str(path), str(workspace), 4, 1, memory_mb))
        run = ("run", str(path), "-o", str(workspace), "--remove", "car")
        tasks.append(Task(f"{name}.objects", name, "objects", None, (*run, "--until", "objects"), ()))
        tasks.append(Task(f"{name}.choose", name, "choose", None, (*run, "--until", "choose"), (tasks[-1].id,)))
    batch = Batch(root, tuple(drives), tuple(tasks))
    batch.save()
    return batch


def refusals(address: str) -> list[int]:
    """What a dashboard answers a page of the web whose name leads here, and who does not know its address."""
    told = urllib.parse.urlsplit(address)
    place = told.path.rsplit("/", 1)[0]
    paths = ("/status", "/", "/info/main/workers.html", "/json/identity.json", "/sitemap.json", "/health")
    asked = [(path, "127.0.0.1") for path in paths]
    asked += [(place + path, host) for path in paths for host in ("evil.example", "evil.example:8787", "")]
    found = []
    for path, host in asked:
        connection = http.client.HTTPConnection(told.hostname or "", told.port)
        connection.putrequest("GET", path, skip_host=True)
        connection.putheader("Host", host)
        connection.endheaders()
        found.append(connection.getresponse().status)
        connection.close()
    return found


def test_a_poisoned_drive_fails_alone_and_what_is_done_is_not_run_again(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    batch = cheap(tmp_path / "batch", ["one", "bad"], tmp_path, broken="bad")
    lines: list[str] = []
    pages: list[str] = []
    refused: list[int] = []

    def tell(line: str) -> None:
        lines.append(line)
        if line.startswith("dashboard: "):
            address = line.removeprefix("dashboard: ")
            with urllib.request.urlopen(address) as page:
                pages.append(page.read().decode())
            for linked in re.findall(r'(?:href|src)="([^"]+\.(?:js|css|html))[?"]', pages[0]):
                with urllib.request.urlopen(urllib.parse.urljoin(address, linked)) as part:
                    assert part.status == 200
            refused.extend(refusals(address))

    assert run_batch(batch, tell, workers=2) == ["bad.objects"]
    if importlib.util.find_spec("bokeh"):
        assert len(pages) == 1 and "task-stream" in pages[0] and "bokeh" in pages[0].lower()
        assert len(refused) > 8 and set(refused) == {403}
    status = batch_status(batch)
    assert status["tasks"] == {"done": 2, "running": 0, "failed": 1, "to do": 1}
    assert state_of(batch, batch.tasks[2]).tries == RETRIES + 1
    assert any("bad.objects: failed after 3 tries: unveil: error" in line for line in lines)
    assert any("bad.choose: not run" in line for line in lines)
    assert (tmp_path / "batch/drives/one/selection.json").is_file()
    assert "bad.objects failed: unveil: error" in "\n".join(status_lines(status))
    # Mended, only what is missing runs.
    shutil.copy(tmp_path / "drives/one/transforms.json", tmp_path / "drives/bad/transforms.json")
    lines.clear()
    assert run_batch(batch, lines.append, workers=1) == []
    assert "4 tasks of 2 drives, 2 done already" in lines[0]
    assert sum("bad." in line and ": done in" in line for line in lines) == 2
    assert sum("bad." in line and ": begun on worker 0" in line for line in lines) == 2
    lines.clear()
    assert run_batch(batch, lines.append) == [] and lines == ["4 tasks of 2 drives, 4 done already"]


def test_a_batch_that_is_stopped_stops_no_other(tmp_path: Path) -> None:
    """Of one process, whose threads are both batches' workers."""
    stopped, other = (cheap(tmp_path / name / "batch", ["one"], tmp_path / name) for name in ("stopped", "other"))
    end_tasks(str(stopped.root))
    try:
        with pytest.raises(TaskFailed, match="cancelled"):
            run_task(str(stopped.root), stopped.tasks[0].id)
        assert run_task(str(other.root), other.tasks[0].id)["tries"] == 1
    finally:
        tasks_may_begin(str(stopped.root))
    assert run_task(str(stopped.root), stopped.tasks[0].id)["tries"] == 1


def test_a_worker_that_dies_is_replaced_and_a_task_that_kills_every_one_fails(tmp_path: Path) -> None:
    """Both in one run: the worker of one task is killed once, that of another whenever it begins."""
    distributed, dask = pytest.importorskip("distributed"), pytest.importorskip("dask")
    batch = cheap(tmp_path / "batch", ["one", "two"], tmp_path, memory_mb=600)
    unlucky, poisoned = batch.tasks[0], batch.tasks[3]
    stop = threading.Event()
    killed: list[Task] = []

    def kill() -> None:
        while not stop.is_set():
            for task in (unlucky, poisoned):
                state = state_of(batch, task)
                if state.status == "running" and (task is poisoned or task not in killed):
                    os.kill(state.process, signal.SIGKILL)
                    killed.append(task)
            time.sleep(0.02)

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, resources={MEMORY: 1000}
        ) as cluster,
    ):
        large = cheap(tmp_path / "large", ["three"], tmp_path, memory_mb=1200)
        with pytest.raises(SettingsError, match="no worker has the memory that three needs, 1200 MB"):
            run_batch(large, print, scheduler=cluster.scheduler_address)
        thread = threading.Thread(target=kill)
        thread.start()
        lines: list[str] = []
        try:
            assert run_batch(batch, lines.append, scheduler=cluster.scheduler_address) == [poisoned.id]
        finally:
            stop.set()
            thread.join()
    status = batch_status(batch)
    assert status["tasks"] == {"done": 3, "running": 0, "failed": 1, "to do": 0}
    assert unlucky in killed and "one" in [d["name"] for d in status["drives"] if d["tried_again"]]
    assert any(unlucky.id in line and "at try 2" in line for line in lines)
    state = state_of(batch, poisoned)
    assert state.status == "failed" and state.tries == 2 and "its worker died" in state.line
    assert any(f"{poisoned.id}: failed after 2 tries: its worker died" in line for line in lines)


def test_no_more_workers_are_started_than_have_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unveil_core.farm.run.free_memory_mb", lambda: 5000.0)
    lines: list[str] = []
    assert workers_that_fit(4, 2000, lines.append) == 2 and "2 instead of 4, 2.0 GB each" in lines[0]
    assert workers_that_fit(2, 2000, lines.append) == 2 and len(lines) == 1
    assert workers_that_fit(1, 9000, lines.append) == 1 and "may need 8.8 GB, of which 4.9 GB are free" in lines[1]


def test_a_scheduler_that_is_not_there_is_one_clear_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    batch = cheap(tmp_path / "batch", ["one"], tmp_path)
    monkeypatch.setattr("unveil_core.farm.run.PATIENCE", "1s")
    with pytest.raises(SettingsError, match="no Dask scheduler answers at tcp://127.0.0.1:9"):
        run_batch(batch, print, scheduler="tcp://127.0.0.1:9")


def test_the_command_plans_shows_and_merges(
    long_drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "batch"
    plan = [
        "batch",
        "plan",
        str(long_drive),
        "-o",
        str(root),
        "--quality",
        "draft",
        "--remove",
        "car",
        "--no-adaptation",
    ]
    assert main(plan) == 0
    assert "1 drives, 20 frames, 1 blocks, 1 tasks" in capsys.readouterr().out
    (task,) = read_batch(root).tasks
    assert task.arguments[4:] == ("--reset", "--remove=car", "--quality=draft", "--no-adaptation")
    assert main(["batch", "status", str(root)]) == 0
    assert "0/1 tasks done" in capsys.readouterr().out
    batch = cheap(tmp_path / "other", ["one"], tmp_path)
    assert main(list(batch.tasks[0].arguments)) == 0  # as another farm runs it
    capsys.readouterr()
    assert main(["batch", "merge", str(batch.root)]) == 0
    assert "one.choose: done" in capsys.readouterr().out
