"""Runs that end early: with the program that started them, and for want of space. The workspace goes on each time."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.app.cli import main
from unveil_core.pipeline.run import stage_named
from unveil_core.pipeline.stage import Stage
from unveil_core.workspace.workspace import Workspace

PARENT = """
import subprocess, sys, time
worker = subprocess.Popen([sys.executable, *sys.argv[1:]], stdin=subprocess.PIPE)
print(worker.pid, flush=True)
time.sleep(300)
"""


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text() if Path("/proc").exists() else True


def until(true: Callable[[], bool], seconds: float) -> bool:
    deadline = time.monotonic() + seconds
    while not true() and time.monotonic() < deadline:
        time.sleep(0.02)
    return true()


def started(root: Path, stage: str) -> bool:
    try:
        return json.loads((root / "workspace.json").read_text())["stages"][stage]["status"] == "running"
    except (OSError, KeyError, ValueError):
        return False


@pytest.mark.skipif(sys.platform == "win32", reason="kill -9")
def test_a_run_ends_with_the_program_that_started_it_even_killed(tmp_path: Path) -> None:
    drive, root = make_tiny_drive(tmp_path / "drive"), tmp_path / "ws"
    arguments = ["-m", "unveil_core", "run", str(drive), "-o", str(root), "--end-with-stdin", "--iterations", "100000"]
    parent = subprocess.Popen([sys.executable, "-c", PARENT, *arguments], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    worker = int(parent.stdout.readline())
    try:
        assert until(lambda: started(root, "reconstruct"), 240)
        assert alive(worker)
        parent.send_signal(signal.SIGKILL)
        parent.wait()
        assert until(lambda: not alive(worker), 60)
    finally:
        parent.kill()
        if alive(worker):
            os.kill(worker, signal.SIGKILL)
        parent.stdout.close()
    assert Workspace.open(root).state()["stages"]["import"]["status"] == "done"
    assert main(["segment", str(root)]) == 0  # nobody holds the workspace


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 1 MB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)], capture_output=True)
    if mounted.returncode:
        pytest.skip("no right to mount a small disk")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk_is_one_clear_line_and_the_workspace_goes_on(
    small_disk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive, root = make_tiny_drive(tmp_path / "drive"), small_disk / "ws"
    assert main(["import", str(drive), "-o", str(root)]) == 0
    filler = small_disk / "filler"
    with filler.open("wb", buffering=0) as stream, pytest.raises(OSError):
        while True:
            stream.write(bytes(4096))
    capsys.readouterr()
    assert main(["segment", str(root)]) == 1
    error = capsys.readouterr().err.splitlines()
    assert error[-1].startswith(f"unveil: failed: {root}: the disk is full (free some space")
    assert not list(root.glob(".partial-*"))
    filler.unlink()
    assert main(["segment", str(root)]) == 0
    assert (root / "labels.json").is_file()


@pytest.mark.skipif(sys.platform == "win32", reason="RLIMIT_FSIZE")
def test_a_file_that_may_not_grow_is_told_likewise(tmp_path: Path) -> None:
    """A quota rather than a disk."""
    drive, root = make_tiny_drive(tmp_path / "drive"), tmp_path / "ws"
    program = (
        "import resource, sys; from unveil_core.app.cli import main; resource.setrlimit(resource.RLIMIT_FSIZE, (900, 900));"
        "sys.exit(main(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, "import", str(drive), "-o", str(root)], capture_output=True, text=True
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == (
        f"unveil: failed: {root}: the disk is full (free some space and run it again: it goes on)"
    )
    assert main(["import", str(drive), "-o", str(root)]) == 0


def test_too_little_memory_is_one_clear_line_and_the_workspace_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    drive, root = make_tiny_drive(tmp_path / "drive"), tmp_path / "ws"
    assert main(["import", str(drive), "-o", str(root)]) == 0

    def hungry(name: str) -> Stage:
        return replace(stage_named(name), run=lambda context: {"much": len(bytearray(1 << 46))})

    capsys.readouterr()
    with monkeypatch.context() as patched:
        patched.setattr("unveil_core.pipeline.run.stage_named", hungry)
        assert main(["segment", str(root)]) == 1
    said = [line for line in capsys.readouterr().err.splitlines() if line != "segment      started"]
    assert len(said) == 1 and said[0].startswith(f"unveil: failed: {root}: no memory left for segment, at ")
    assert main(["segment", str(root)]) == 0


@pytest.mark.skipif(sys.platform == "win32", reason="SIGTERM")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_an_end_that_is_asked_for_before_the_first_stage_is_one_line(number: int, tmp_path: Path) -> None:
    """While libraries are loaded and the drive is checked, which takes seconds."""
    drive, root = make_tiny_drive(tmp_path / "drive"), tmp_path / "ws"
    process = subprocess.Popen(
        [sys.executable, "-v", "-m", "unveil_core", "import", str(drive), "-o", str(root)],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    text = ""
    while "import 'numpy.version'" not in text:  # Python tells what it loads
        text = process.stderr.readline()
        assert text
    process.send_signal(number)
    said = process.stderr.read()  # the signal may have cut a line of Python's short
    assert process.wait(timeout=120) == 130
    assert said.count("unveil: ") == 1 and "unveil: cancelled; run the same command again to go on\n" in said
    assert "Traceback" not in said
    process.stderr.close()
    assert not root.exists()


WITHIN_TEXT = """
import sys
from unveil_core.app import cli
def interrupted(arguments):
    exec("import os, signal, time; os.kill(os.getpid(), signal.SIGINT); time.sleep(5)")
cli.VERBS["doctor"] = interrupted
sys.exit(cli.main(["doctor"]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_an_interrupt_that_is_caught_does_not_end_the_process_by_a_signal(tmp_path: Path) -> None:
    """Of code that is compiled from text, as data classes are, ``python -m`` remembers one that was caught."""
    (tmp_path / "interrupted.py").write_text(WITHIN_TEXT)
    command = [sys.executable, "-m", "interrupted"]
    paths = {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(__file__).parents[2])])}
    done = subprocess.run(command, env={**os.environ, **paths}, capture_output=True, text=True, timeout=300)
    assert done.returncode == 130 and done.stderr.count("\n") == 1


TALKATIVE = """
import sys
from unveil_core.app import cli
def talk(arguments):
    for number in range(100000):
        print(number)
cli.VERBS["doctor"] = talk
sys.exit(cli.main(["doctor"]))
"""


@pytest.mark.skipif(sys.platform == "win32", reason="pipes")
def test_who_stops_reading_is_told_nothing() -> None:
    process = subprocess.Popen([sys.executable, "-c", TALKATIVE], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None and process.stderr is not None
    assert process.stdout.readline() == b"0\n"
    process.stdout.close()
    assert process.stderr.read() == b"" and process.wait() == 1


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a traceback that nobody wrote down."""
    drive, root = make_tiny_drive(tmp_path / "drive"), tmp_path / "ws"
    assert main(["import", str(drive), "-o", str(root)]) == 0
    (root / "events.jsonl").unlink()
    (root / "events.jsonl").mkdir()
    capsys.readouterr()
    assert main(["segment", str(root)]) == 1
    assert capsys.readouterr().err == f"unveil: failed: {root}/events.jsonl: Is a directory (--debug shows where)\n"
