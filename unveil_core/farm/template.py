"""A batch for other farms: the same tasks as an Open Job Description template, a Slurm script, or a Flamenco job."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from typing import Any

from unveil_core.farm.manifest import Batch, BatchDrive, Task

__all__ = ["TEMPLATES", "flamenco_job", "openjd_template", "slurm_script"]


def _groups(batch: Batch) -> list[tuple[str, list[Task]]]:
    """The tasks by step of a drive, in order: those of all blocks of a stage together."""
    groups: dict[str, list[Task]] = {}
    for task in batch.tasks:
        groups.setdefault(f"{task.drive}.{task.step}", []).append(task)
    return list(groups.items())


def _groups_before(batch: Batch, tasks: list[Task]) -> list[str]:
    of_task = {task.id: f"{task.drive}.{task.step}" for task in batch.tasks}
    return list(dict.fromkeys(of_task[i] for task in tasks for i in task.after))


def _drive_of(batch: Batch, tasks: list[Task]) -> BatchDrive:
    return next(d for d in batch.drives if d.name == tasks[0].drive)


def openjd_template(batch: Batch) -> str:
    """A job template, ``jobtemplate-2023-09``: a step for each step of a drive, with the blocks as its tasks."""
    steps: list[dict[str, Any]] = []
    for name, tasks in _groups(batch):
        arguments = list(tasks[0].arguments)
        step: dict[str, Any] = {"name": _short(name)}
        if tasks[0].block is not None:
            arguments[-1] = "{{Task.Param.Block}}"
            blocks = {"name": "Block", "type": "INT", "range": [t.block for t in tasks]}
            step["parameterSpace"] = {"taskParameterDefinitions": [blocks]}
        before = _groups_before(batch, tasks)
        if before:
            step["dependencies"] = [{"dependsOn": _short(b)} for b in before]
        drive = _drive_of(batch, tasks)
        needs = {"amount.worker.memory": drive.memory_mb, "amount.worker.gpu": drive.gpus}
        if any(needs.values()):
            step["hostRequirements"] = {"amounts": [{"name": n, "min": least} for n, least in needs.items() if least]}
        step["script"] = {"actions": {"onRun": {"command": "unveil", "args": arguments}}}
        steps.append(step)
    return (
        json.dumps({"specificationVersion": "jobtemplate-2023-09", "name": "unveil", "steps": steps}, indent=2) + "\n"
    )


def _short(name: str) -> str:
    """A step's name, which may have 64 characters."""
    return name if len(name) <= 64 else f"{name[:20]}..{name[-42:]}"


def slurm_script(batch: Batch) -> str:
    """A shell script that submits an array for each step; a farm's own options go into ``SBATCH_OPTIONS``."""
    lines = ["#!/bin/sh", "# Submits the tasks of a batch: sh batch.sh", "set -e", ': "${SBATCH_OPTIONS:=}"']
    for k, (name, tasks) in enumerate(_groups(batch)):
        arguments = [shlex.quote(a) for a in tasks[0].arguments]
        options = f"--parsable --job-name={shlex.quote(name)}"
        drive = _drive_of(batch, tasks)
        options += f" --mem={drive.memory_mb}M" if drive.memory_mb else ""
        options += f" --gres=gpu:{drive.gpus}" if drive.gpus else ""
        if tasks[0].block is not None:
            arguments[-1] = '"$SLURM_ARRAY_TASK_ID"'
            options += f" --array=0-{len(tasks) - 1}"
        names = [n for n, _ in _groups(batch)]
        before = ":".join(f"$job{names.index(b)}" for b in _groups_before(batch, tasks))
        if before:
            options += f" --dependency=afterok:{before}"
        command = shlex.quote("unveil " + " ".join(arguments))
        lines.append(f"job{k}=$(sbatch $SBATCH_OPTIONS {options} --wrap={command})")
    return "\n".join(lines) + "\n"


def flamenco_job(batch: Batch) -> str:
    """A job type for Flamenco Manager, with the tasks of this batch written into it."""
    tasks = [{"id": t.id, "arguments": list(t.arguments), "after": list(t.after)} for t in batch.tasks]
    return f"""// A job type for Flamenco: the tasks of one batch of Unveil. Copy it to the manager's scripts folder.
const JOB_TYPE = {{
    label: "Unveil",
    settings: [{{ key: "command", type: "string", default: "unveil", description: "How workers start Unveil" }}],
}};

const TASKS = {json.dumps(tasks, indent=4)};

function compileJob(job) {{
    const made = {{}};
    for (const task of TASKS) {{
        const authored = author.Task(task.id, "misc");
        authored.addCommand(author.Command("exec", {{ exe: job.settings.command, args: task.arguments }}));
        for (const before of task.after) authored.addDependency(made[before]);
        made[task.id] = authored;
        job.addTask(authored);
    }}
}}
"""


TEMPLATES: dict[str, tuple[str, Callable[[Batch], str]]] = {
    "openjd": ("batch.openjd.json", openjd_template),
    "slurm": ("batch.slurm.sh", slurm_script),
    "flamenco": ("batch.flamenco.js", flamenco_job),
}
"""By name, the file that is written into the batch's folder, and its text."""
