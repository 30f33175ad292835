"""Jobs: real processes that speak, do not heed, leave children behind, flood, are killed; and real runs of unveil."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from blender_addon.worker import jobs
from blender_addon.worker.jobs import Job, end_all, unveil_job, worker_environment
from tests.app.test_endings import alive, until
from tests.blender_addon.run_in_blender import ROOT, unveil_python
from tests.drives.tiny_drive import make_tiny_drive

STUBBORN = """
import os, signal, subprocess, sys, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
signal.signal(signal.SIGTERM, signal.SIG_IGN)
stubborn = "import signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN); time.sleep(300)"
child = subprocess.Popen([sys.executable, "-c", stubborn])
print(child.pid, flush=True)
time.sleep(300)
"""


@pytest.fixture(autouse=True)
def _nothing_stays() -> Iterator[None]:
    yield
    end_all()
    assert not jobs._running


def script(program: str) -> Job:
    return Job([sys.executable, "-u", "-c", program])


def first_line(job: Job) -> str:
    assert until(lambda: len(job.drain().log) > 1, 120), list(job.state.log)
    return job.state.log[1]


def test_output_errors_and_exit_code() -> None:
    program = (
        'import sys; print(\'{"stage": "mesh", "done": 1, "total": 2, "message": "fusing"}\'); '
        'print("unveil: error: x.png: Cut short", file=sys.stderr); sys.exit(2)'
    )
    state = script(program).wait(120)
    assert (state.stage, state.message, state.status) == ("mesh", "fusing", "bad input")
    assert state.error == "x.png: Cut short"


def test_jobs_work_in_a_folder_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blender's working folder is that of a .blend, perhaps a stranger's."""
    (tmp_path / "json.py").write_text("raise SystemExit('imported from the working folder')")
    monkeypatch.chdir(tmp_path)
    state = script("import json, os; print(os.getcwd(), os.listdir())").wait(120)
    assert state.status == "done", list(state.log)
    folder, _, found = state.log[1].partition(" ")
    assert found == "[]" and Path(folder) != tmp_path and Path(folder).stat().st_mode & 0o077 == 0
    Path(folder).rmdir()  # as those that clean up do
    assert script("pass").wait(120).status == "done"


def test_a_program_that_is_not_there() -> None:
    with pytest.raises(OSError):
        Job(["/nowhere/python"])


def test_draining_a_flood_takes_a_bounded_time() -> None:
    """Two hundred thousand lines: a tick takes in what its time is for, and none is lost at the end."""
    job = script("for i in range(200000): print('line', i)")
    first_line(job)
    taken = list(job.state.log)
    assert list(job.drain(0.0).log) == taken, "without time nothing is taken in"
    assert until(lambda: not job.drain().running, 120)
    assert job.state.status == "done" and job.state.log[-2] == "line 199999"


def test_cancel_ends_a_stubborn_group_and_does_not_wait_for_it() -> None:
    job = script(STUBBORN)
    child = int(first_line(job))
    job.cancel()
    assert job.cancelling and job.state.running and alive(child)
    assert until(lambda: not job.drain().running, 60)
    assert jobs.GENTLE_S < 2, "an artist does not wait for longer"
    assert job.state.status == "cancelled" and not alive(child) and not alive(job.pid)


def test_a_worker_that_heeds_is_not_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs, "GENTLE_S", 15.0)  # a machine with much else to do takes its time
    # A program that was started in the background ignores interrupts from its first word on, and so do those it starts.
    job = script(
        "import signal, sys, time\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "try: print('ready'); time.sleep(300)\nexcept KeyboardInterrupt: print('tidying'); sys.exit(130)"
    )
    assert first_line(job) == "ready"
    job.cancel()
    state = job.wait(120)
    assert state.status == "cancelled" and state.exit_code == 130 and "tidying" in state.log


def test_children_left_behind_do_not_keep_the_job_alive() -> None:
    job = script(
        "import subprocess, sys; p = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(300)']); print(p.pid)"
    )
    child = int(first_line(job))
    assert job.wait(60).status == "done"
    assert until(lambda: not alive(child), 60)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_killed_worker_is_told() -> None:
    job = script("import time; print('ready'); time.sleep(300)")
    first_line(job)
    os.kill(job.pid, signal.SIGKILL)
    state = job.wait(60)
    assert state.status == "failed" and state.error.startswith("The worker was killed")


def test_end_all_ends_all() -> None:
    found = [script(STUBBORN) for _ in range(2)]
    for job in found:
        first_line(job)
    end_all()
    assert not any(alive(job.pid) for job in found)


def test_blenders_python_variables_do_not_reach_the_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONHOME", "/nowhere")
    monkeypatch.setenv("PYTHONPATH", "/nowhere/lib")
    monkeypatch.setenv("MY_OWN", "kept")
    environment = worker_environment()
    assert "PYTHONHOME" not in environment and "PYTHONPATH" not in environment and environment["MY_OWN"] == "kept"
    assert script("import sys; print('started')").wait(120).status == "done"


# ---------------------------------------------------------------------------------------------------------- with unveil itself


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return make_tiny_drive(tmp_path / "drive")


@pytest.fixture
def python(tmp_path: Path) -> Path:
    return unveil_python(tmp_path)


def test_an_import_tells_of_itself(drive: Path, python: Path, tmp_path: Path) -> None:
    state = unveil_job(python, ["import", str(drive), "-o", str(tmp_path / "ws")]).wait(240)
    assert state.status == "done", list(state.log)
    assert state.ended == {"import": "done", "objects": "done"} and (tmp_path / "ws/drive/cameras.json").is_file()


def test_bad_input_is_one_line(python: Path, tmp_path: Path) -> None:
    state = unveil_job(python, ["run", str(tmp_path / "nowhere"), "-o", str(tmp_path / "ws")]).wait(240)
    assert state.status == "bad input" and "Not found" in state.error


def test_a_folder_with_a_torch_of_its_own_changes_nothing(
    drive: Path, python: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "torch.py").write_text("raise SystemExit(9)")
    monkeypatch.chdir(tmp_path)
    assert unveil_job(python, ["import", str(drive), "-o", str(tmp_path / "ws")]).wait(240).status == "done"


def test_cancel_and_kill_leave_a_workspace_that_goes_on(drive: Path, python: Path, tmp_path: Path) -> None:
    run = ["run", str(drive), "-o", str(tmp_path / "ws"), "--iterations", "100000"]

    def reconstructing() -> Job:
        job = unveil_job(python, run)
        assert until(lambda: job.drain().stage == "reconstruct" or not job.state.running, 240)
        assert job.state.running, list(job.state.log)
        return job

    job = reconstructing()
    job.cancel()
    assert job.wait(60).status == "cancelled"
    job = reconstructing()  # nobody holds the workspace, and the import is not done again
    assert job.state.ended["import"] == "up to date"
    os.kill(job.pid, signal.SIGKILL)
    assert job.wait(60).status == "failed"
    state = unveil_job(python, ["segment", str(tmp_path / "ws")]).wait(240)
    assert state.status == "done", list(state.log)


OWNER = """
import sys, time
sys.path.insert(0, sys.argv[1])
from blender_addon.worker.jobs import unveil_job
job = unveil_job(sys.argv[2], sys.argv[3:])
while job.drain().stage != "reconstruct":
    time.sleep(0.05)
print(job.pid, flush=True)
time.sleep(300)
"""


def test_the_work_ends_with_a_blender_that_is_killed(drive: Path, python: Path, tmp_path: Path) -> None:
    arguments = ["run", str(drive), "-o", str(tmp_path / "ws"), "--iterations", "100000"]
    owner = subprocess.Popen(
        [sys.executable, "-c", OWNER, str(ROOT), str(python), *arguments], stdout=subprocess.PIPE, text=True
    )
    assert owner.stdout is not None
    with owner.stdout:
        worker = int(owner.stdout.readline())
    owner.kill()
    owner.wait()
    try:
        assert until(lambda: not alive(worker), 60)
    finally:
        if alive(worker):
            os.kill(worker, signal.SIGKILL)


@pytest.mark.skipif(sys.platform == "win32", reason="niceness")
def test_the_artist_s_hand_goes_before_the_work() -> None:
    """And before all threads and children of it."""
    child = (
        "import os, subprocess, sys, time; time.sleep(1); print(os.nice(0));"
        "subprocess.run([sys.executable, '-c', 'import os; print(os.nice(0))'])"
    )
    job = Job([sys.executable, "-u", "-c", child])
    assert job.wait(30).status == "done"
    told = [int(line) for line in job.state.log if line.strip().isdigit()]
    assert told == [min(os.nice(0) + 5, 19)] * 2
