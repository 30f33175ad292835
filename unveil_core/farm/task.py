"""One task: its command in a process of its own, with what became of it noted (see ``farm.state``)."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from unveil_core.base.disk.lock import IN_USE
from unveil_core.base.disk.open_safely import open_file, open_in_place
from unveil_core.base.surroundings.programs import environment
from unveil_core.farm.manifest import read_batch
from unveil_core.farm.state import TaskState, note_state, state_of

__all__ = ["TaskFailed", "end_tasks", "run_task", "tasks_may_begin"]

BUSY_S = 120.0
"""How long a task waits for a workspace that another process has, seconds: a killed one's is free at once."""


_running: set[tuple[str, subprocess.Popen[bytes]]] = set()
"""Those of this process, each with the root of its batch: Dask's workers are threads that several batches may have started."""
_stopping: set[str] = set()


def end_tasks(root: str) -> None:
    """End what runs of a batch in threads of this process; no task of it begins any more, until :func:`tasks_may_begin`.

    Args:
        root: as for :func:`run_task`.
    """
    _stopping.add(root)
    for of, process in list(_running):
        if of == root:
            _end(process)


def tasks_may_begin(root: str) -> None:
    """After :func:`end_tasks`, once the threads are gone."""
    _stopping.discard(root)


def _end(process: subprocess.Popen[bytes]) -> None:
    with suppress(OSError, ValueError):  # its standard input: with that it stops
        if process.stdin is not None:
            process.stdin.close()


class TaskFailed(Exception):
    """A command that did not end well; the message is the last line that it said."""


def run_task(root: str, task_id: str) -> dict[str, Any]:
    """Run one task of the batch in a folder, unless it is done.

    Returns:
        ``id``, ``tries`` and ``seconds``.
    Raises:
        TaskFailed: the command failed.
    """
    batch = read_batch(Path(root))
    task = next(t for t in batch.tasks if t.id == task_id)
    before = state_of(batch, task)
    if before.status == "done":
        return {"id": task.id, "tries": before.tries, "seconds": before.seconds}
    if root in _stopping:
        raise TaskFailed(f"{task.id}: cancelled")
    tries, begun = before.tries + 1, time.monotonic()

    def note(status: str, line: str = "") -> None:
        seconds = round(time.monotonic() - begun, 2)
        note_state(batch, task, TaskState(status, tries, seconds, line, platform.node(), os.getpid()))

    note("running")
    log = batch.root / "tasks" / f"{task.id}.log"
    # Its standard input closes with this process, however that ends, and then it stops.
    # -P: what lies in the folder where the batch was started is not imported.
    command = [sys.executable, "-P", "-m", "unveil_core", *task.arguments, "--end-with-stdin"]
    while True:
        with os.fdopen(open_in_place(log, os.O_WRONLY | os.O_APPEND | os.O_CREAT), "ab") as stream:
            process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=stream, stderr=stream, env=environment())
            _running.add((root, process))
            try:
                if root in _stopping:
                    _end(process)
                code = process.wait()
            finally:
                _running.discard((root, process))
        line = _last_line(log)
        if code == 0:
            note("done", line)
            return {"id": task.id, "tries": tries, "seconds": round(time.monotonic() - begun, 2)}
        if root in _stopping:  # it has not failed: with this process gone it is to do
            raise TaskFailed(f"{task.id}: cancelled")
        # The process of a worker that died may live on for a moment.
        if IN_USE not in line or time.monotonic() - begun > BUSY_S:
            note("failed", line)
            raise TaskFailed(f"{task.id}: {line}")
        time.sleep(2.0)


def _last_line(log: Path) -> str:
    with open_file(log, links=False) as stream:
        stream.seek(max(os.fstat(stream.fileno()).st_size - 4000, 0))
        lines = stream.read(4000).decode(errors="replace").strip().splitlines()
    return lines[-1][-500:] if lines else "it said nothing"
