"""One task: its command in a process of its own, with what became of it in files that anybody may read."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from unveil_core.base.errors import WorkspaceError
from unveil_core.base.files import read_json, write_json_atomic
from unveil_core.farm.manifest import Batch, Task, read_batch

__all__ = ["TaskFailed", "TaskState", "run_task", "state_of"]

BUSY_S = 120.0
"""How long a task waits for a workspace that another process has, seconds: a killed one's is free at once."""


class TaskFailed(Exception):
    """A command that did not end well; the message is the last line that it said."""


@dataclass(frozen=True)
class TaskState:
    """What became of a task.

    Attributes:
        status: "to do", "running", "done" or "failed".
        tries: how often it was begun.
        seconds: of the last try; line: the last that it said.
        host, process: where it ran, and the worker's process there.
    """

    status: str = "to do"
    tries: int = 0
    seconds: float = 0.0
    line: str = ""
    host: str = ""
    process: int = 0


def state_of(batch: Batch, task: Task) -> TaskState:
    """What the files tell of a task."""
    path = batch.root / "tasks" / f"{task.id}.json"
    if not path.is_file():
        return TaskState()
    try:
        data: Any = read_json(path)
        return TaskState(**data)
    except (WorkspaceError, TypeError):
        return TaskState()


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
    folder = batch.root / "tasks"
    folder.mkdir(parents=True, exist_ok=True)
    tries, begun = before.tries + 1, time.monotonic()

    def note(status: str, line: str = "") -> None:
        seconds = round(time.monotonic() - begun, 2)
        state = TaskState(status, tries, seconds, line, platform.node(), os.getpid())
        write_json_atomic(folder / f"{task.id}.json", asdict(state))

    note("running")
    log = folder / f"{task.id}.log"
    environment = {**os.environ, "OMP_WAIT_POLICY": "PASSIVE"}
    # Its standard input closes with this process, however that ends, and then it stops.
    command = [sys.executable, "-m", "unveil_core", *task.arguments, "--end-with-stdin"]
    while True:
        with log.open("ab") as stream:
            process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=stream, stderr=stream, env=environment)
            code = process.wait()
        line = _last_line(log)
        if code == 0:
            note("done", line)
            return {"id": task.id, "tries": tries, "seconds": round(time.monotonic() - begun, 2)}
        # The process of a worker that died may live on for a moment.
        if "in use by another process" not in line or time.monotonic() - begun > BUSY_S:
            note("failed", line)
            raise TaskFailed(f"{task.id}: {line}")
        time.sleep(2.0)


def _last_line(log: Path) -> str:
    lines = log.read_bytes()[-4000:].decode(errors="replace").strip().splitlines()
    return lines[-1][-500:] if lines else "it said nothing"
