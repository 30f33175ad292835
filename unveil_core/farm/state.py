"""What became of the tasks of a batch, by files that anybody may read."""

from __future__ import annotations

import os
import platform
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from unveil_core.base.checks.fields import checked
from unveil_core.base.errors import UnveilError
from unveil_core.base.files import read_json, write_json_atomic
from unveil_core.farm.manifest import Batch, Task
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.stage import note_of_block

__all__ = ["TaskState", "note_state", "seen_state", "state_of"]


@dataclass(frozen=True)
class TaskState:
    """What became of a task.

    Attributes:
        status: "to do", "running", "done" or "failed".
        tries: how often it was begun.
        seconds: of the last try; line: the last that it said.
        host, process: where it ran, and the worker's process there.
        arguments: of the command that this is about.
    """

    status: str = "to do"
    tries: int = 0
    seconds: float = 0.0
    line: str = ""
    host: str = ""
    process: int = 0
    arguments: tuple[str, ...] = ()


def note_state(batch: Batch, task: Task, state: TaskState) -> None:
    """Write what became of a task."""
    path = _file(batch, task)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json_atomic(path, asdict(replace(state, arguments=task.arguments)))


def state_of(batch: Batch, task: Task) -> TaskState:
    """What a worker noted of a task: nothing where it was planned anew with other options. What ran on this machine in a process
    that is no longer there is to do."""
    path = _file(batch, task)
    if not path.is_file():
        return TaskState()
    try:
        data: Any = read_json(path)
        state = checked(TaskState, data)
    except (UnveilError, TypeError, ValueError):
        return TaskState()
    if state.arguments != task.arguments:
        return TaskState()
    if state.status == "running" and state.host == platform.node() and not _is_there(state.process):
        return replace(state, status="to do")
    return state


def seen_state(batch: Batch, task: Task) -> TaskState:
    """The same; of a task of which no worker of ours noted anything, what its workspace shows: another farm may have run it."""
    noted = state_of(batch, task)
    if noted.tries:
        return noted
    root = Path(next(d.workspace for d in batch.drives if d.name == task.drive))
    stage = task.step if task.block is not None else _last_stage(task)
    try:
        recorded: Any = read_json(root / "workspace.json")
        done = bool(recorded["stages"].get(stage, {}).get("status") == "done")
    except (UnveilError, KeyError, TypeError, AttributeError):
        done = False
    if task.block is not None:
        done = done or note_of_block(root, stage, task.block).is_file()
    return TaskState("done" if done else "to do")


def _last_stage(task: Task) -> str:
    arguments = task.arguments
    return arguments[arguments.index("--until") + 1] if "--until" in arguments else STAGES[-1].name


def _file(batch: Batch, task: Task) -> Path:
    return batch.root / "tasks" / f"{task.id}.json"


def _is_there(process: int) -> bool:
    """Whether a process of this machine runs; where that cannot be asked, it does."""
    if os.name != "posix":
        return True  # asking by a signal ends it there
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True
