"""A batch for other farms: the same tasks as an Open Job Description template, a Slurm script, or a Flamenco job."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from unveil_core.base.errors import SettingsError
from unveil_core.farm.manifest import Batch, BatchDrive, Task

__all__ = ["TEMPLATES", "fitting", "flamenco_job", "openjd_template", "slurm_script"]


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


def fitting(batch: Batch, text: Callable[[Batch], str], leave_out: Callable[[SettingsError], None]) -> Batch:
    """A batch without the drives that a template cannot name.

    Args:
        text: writes the template; leave_out: gets what is wrong with a drive.
    Raises:
        SettingsError: no drive is left.
    """
    problems: dict[str, SettingsError] = {}
    for drive in batch.drives:
        tasks = tuple(t for t in batch.tasks if t.drive == drive.name)
        try:
            for argument in (a for task in tasks for a in task.arguments):
                _as_text(argument, drive.name)
            text(replace(batch, drives=(drive,), tasks=tasks))
        except SettingsError as error:
            problems[drive.name] = error
    if len(problems) == len(batch.drives):
        raise next(iter(problems.values()))
    for problem in problems.values():
        leave_out(problem)
    return replace(
        batch,
        drives=tuple(d for d in batch.drives if d.name not in problems),
        tasks=tuple(t for t in batch.tasks if t.drive not in problems),
    )


def _as_text(argument: str, drive: str) -> None:
    """Refuse a name that is no text in UTF-8, as file systems may have: templates are text."""
    try:
        argument.encode()
    except UnicodeEncodeError:
        raise SettingsError(
            f"{drive}: not UTF-8, so no template can name it: {argument!r}",
            mend="rename the folder or file and plan again, or use `unveil batch run`",
        ) from None


def openjd_template(batch: Batch) -> str:
    """A job template, ``jobtemplate-2023-09``: a step for each step of a drive, with the blocks as its tasks.

    Raises:
        SettingsError: a path or an option holds what such a template takes for an expression.
    """
    steps: list[dict[str, Any]] = []
    for name, tasks in _groups(batch):
        arguments = [_literal(a, tasks[0].drive) for a in tasks[0].arguments]
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
    """A step's name, which may have 64 characters; longer ones that differ anywhere stay different."""
    if len(name) <= 64:
        return name
    return f"{name[:20]}..{hashlib.blake2b(name.encode(), digest_size=4).hexdigest()}..{name[-32:]}"


def _literal(text: str, drive: str) -> str:
    """An argument that a template gives as it is: the format has no way to write two braces that are none of its own."""
    if "{{" in text or "}}" in text:
        raise SettingsError(
            f"{drive}: {text!r} holds two braces, which Open Job Description takes for an expression",
            mend="rename the folder or file and plan again, or use another farm's template",
        )
    return text


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
    """A job type for Flamenco Manager, with the tasks of this batch written into it.

    Flamenco puts its two-way variables, by which a folder has another path on each platform, into the settings of a job and not
    into what a script writes. So the folders that the tasks' paths lie in are settings.
    """
    folders = _folders(batch)
    tasks = [
        {"id": t.id, "arguments": [_within(a, folders) for a in t.arguments], "after": list(t.after)}
        for t in batch.tasks
    ]
    settings = [{"key": "command", "type": "string", "default": "unveil", "description": "How workers start Unveil"}]
    for key, folder in folders.items():
        what = f"The folder of the {key}, as this computer sees it"
        settings.append({"key": key, "type": "string", "subtype": "dir_path", "default": folder, "description": what})
    return f"""// A job type for Flamenco: the tasks of one batch of Unveil. Copy it to the manager's scripts folder.
const JOB_TYPE = {{
    label: "Unveil",
    settings: {json.dumps(settings, indent=4)},
}};

// An argument is text, or a setting that names a folder and the path from there.
const TASKS = {json.dumps(tasks, indent=4)};

function compileJob(job) {{
    const written = (argument) => Array.isArray(argument) ? job.settings[argument[0]] + argument[1] : argument;
    const made = {{}};
    for (const task of TASKS) {{
        const authored = author.Task(task.id, "misc");
        authored.addCommand(author.Command("exec", {{ exe: job.settings.command, args: task.arguments.map(written) }}));
        for (const before of task.after) authored.addDependency(made[before]);
        made[task.id] = authored;
        job.addTask(authored);
    }}
}}
"""


def _folders(batch: Batch) -> dict[str, str]:
    """By key of a setting, the batch's folder and the one that all drives lie in, where there is such a one."""
    folders = {"batch": str(batch.root.absolute())}
    try:
        drives = os.path.commonpath([Path(drive.drive).parent for drive in batch.drives])
    except ValueError:  # on several disks of Windows
        return folders
    return folders if drives == Path(drives).anchor else {**folders, "drives": drives}


def _within(argument: str, folders: dict[str, str]) -> str | list[str]:
    """An argument that is a path in one of the folders as that folder's key and the rest; any other as it is."""
    for key, folder in folders.items():
        rest = argument.removeprefix(folder)
        if rest != argument and rest.startswith(("/", os.sep)):
            return [key, rest]
    return argument


TEMPLATES: dict[str, tuple[str, Callable[[Batch], str]]] = {
    "openjd": ("batch.openjd.json", openjd_template),
    "slurm": ("batch.slurm.sh", slurm_script),
    "flamenco": ("batch.flamenco.js", flamenco_job),
}
"""By name, the file that is written into the batch's folder, and its text."""
