"""How far a batch is, by its files alone."""

from __future__ import annotations

from typing import Any

from unveil_core.base.wording import shown
from unveil_core.farm.manifest import Batch
from unveil_core.farm.state import TaskState, seen_state

__all__ = ["batch_status", "status_lines"]


def batch_status(batch: Batch) -> dict[str, Any]:
    """JSON-able: tasks by status, and each drive with its tasks by status, seconds, and tasks that were tried again."""
    states = {task.id: seen_state(batch, task) for task in batch.tasks}
    drives = []
    for drive in batch.drives:
        own = {t.id: states[t.id] for t in batch.tasks if t.drive == drive.name}
        drives.append(
            {
                "name": drive.name,
                "workspace": drive.workspace,
                "frames": drive.frames,
                "blocks": drive.blocks,
                "tasks": _counts(list(own.values())),
                "seconds": round(sum(s.seconds for s in own.values()), 1),
                "tried_again": [i for i, s in own.items() if s.tries > 1],
                "failed": {i: s.line for i, s in own.items() if s.status == "failed"},
            }
        )
    return {"tasks": _counts(list(states.values())), "drives": drives}


def _counts(states: list[TaskState]) -> dict[str, int]:
    return {name: sum(s.status == name for s in states) for name in ("done", "running", "failed", "to do")}


def status_lines(status: dict[str, Any]) -> list[str]:
    """The same as text, a line for each drive."""
    lines = []
    for drive in status["drives"]:
        count, total = drive["tasks"], sum(drive["tasks"].values())
        line = f"{shown(drive['name']):<24} {count['done']}/{total} tasks done, {drive['seconds']:.0f} s"
        line += f", {count['running']} running" if count["running"] else ""
        line += f", tried again: {', '.join(drive['tried_again'])}" if drive["tried_again"] else ""
        lines.append(line)
        lines += [f"  {task} failed: {shown(text)}" for task, text in drive["failed"].items()]
    return lines
