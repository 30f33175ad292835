"""``unveil batch``: many drives, planned once and run anywhere."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from dataclasses import fields, replace
from pathlib import Path

from unveil_core.app.console import say
from unveil_core.base.errors import UnveilError
from unveil_core.base.wording import about_as_long, about_as_much, setting_as_option, shown

__all__ = ["run_batch_part"]


def run_batch_part(arguments: argparse.Namespace) -> int:
    """Plan, run, show, merge or translate a batch; returns the exit code."""
    return {"plan": _plan, "run": _run, "status": _status, "merge": _merge, "template": _template}[arguments.part](
        arguments
    )


def _plan(arguments: argparse.Namespace) -> int:
    from unveil_core.app.given_settings import settings_of
    from unveil_core.farm.manifest import plan_batch
    from unveil_core.pipeline.settings import RunSettings

    given = settings_of(arguments)
    # A workspace that is there already gets the settings of the plan, not its own.
    options = ["--reset", *_options(given, RunSettings()), *["--yes"] * arguments.yes]
    left_out: list[dict[str, str]] = []

    def leave_out(path: Path, error: UnveilError) -> None:
        left_out.append({"drive": str(path), "message": str(error)})
        say(f"left out: {error}", sys.stderr)

    batch = plan_batch(
        arguments.drives, arguments.output, given, options, replace=arguments.replace, leave_out=leave_out
    )
    batch.save()
    frames = sum(d.frames for d in batch.drives)
    blocks = sum(d.blocks for d in batch.drives)
    seconds, memory_mb = sum(d.seconds for d in batch.drives), max(d.memory_mb for d in batch.drives)
    if arguments.json:
        told = {"folder": str(arguments.output), "drives": len(batch.drives), "frames": frames, "blocks": blocks}
        told |= {"tasks": len(batch.tasks), "seconds": round(seconds), "memory_mb": round(memory_mb)}
        print(json.dumps({"batch": {**told, "left_out": left_out}}))
    else:
        say(
            f"{len(batch.drives)} drives, {frames} frames, {blocks} blocks, {len(batch.tasks)} tasks: {arguments.output}\n"
            f"about {about_as_long(seconds)} on one worker like this machine, {about_as_much(memory_mb)} of memory for "
            "each worker"
        )
    return 1 if left_out else 0


def _options(given: object, usual: object) -> list[str]:
    """The options of ``unveil run`` that give these settings."""
    words: list[str] = []
    for f in fields(given):  # type: ignore[arg-type]
        value = getattr(given, f.name)
        if value == getattr(usual, f.name):
            continue
        words.append(setting_as_option(f.name, value))
    return words


def _run(arguments: argparse.Namespace) -> int:
    from unveil_core.farm.manifest import read_batch
    from unveil_core.farm.run import run_batch

    batch = read_batch(arguments.batch)

    def tell(line: str) -> None:
        say(json.dumps({"message": line}) if arguments.json else shown(line, longest=None))

    return 1 if run_batch(batch, tell, scheduler=arguments.scheduler, workers=arguments.workers) else 0


def _status(arguments: argparse.Namespace) -> int:
    from unveil_core.farm.manifest import read_batch
    from unveil_core.farm.status import batch_status, status_lines

    status = batch_status(read_batch(arguments.batch))
    say(json.dumps(status) if arguments.json else "\n".join(status_lines(status)))
    return 0


def _merge(arguments: argparse.Namespace) -> int:
    from unveil_core.farm.manifest import read_batch
    from unveil_core.farm.state import seen_state
    from unveil_core.farm.task import TaskFailed, run_task

    batch = read_batch(arguments.batch)
    failed = 0
    for task in batch.tasks:
        ready = all(seen_state(batch, t).status == "done" for t in batch.tasks if t.id in task.after)
        if task.block is not None or not task.after or not ready:
            continue
        try:
            seconds = run_task(str(batch.root), task.id)["seconds"]
            line = f"{task.id}: done in {seconds:.0f} s"
            say(json.dumps({"task": task.id, "status": "done", "seconds": seconds}) if arguments.json else line)
        except TaskFailed as error:
            failed += 1
            if arguments.json:
                say(json.dumps({"task": task.id, "status": "failed", "level": "error", "message": str(error)}))
            say(f"failed: {error}", sys.stderr)
    return 1 if failed else 0


def _template(arguments: argparse.Namespace) -> int:
    from unveil_core.base.files import write_bytes_atomic
    from unveil_core.base.output.single_files import of_user, whole_file
    from unveil_core.farm.manifest import read_batch
    from unveil_core.farm.template import TEMPLATES, fitting

    batch = read_batch(arguments.batch)
    name, text = TEMPLATES[arguments.to]
    path: Path = arguments.batch / name
    left_out: list[UnveilError] = []
    content = text(fitting(batch, text, left_out.append)).encode()
    receipts = of_user(replace=arguments.replace)
    receipts.check(path)
    replace(batch, files=tuple({**dict.fromkeys(batch.files), name: None})).save()
    with whole_file(path, receipts) as made:
        write_bytes_atomic(made, content)
    for error in left_out:
        say(f"left out: {error}", sys.stderr)
    told = {"file": str(path), "left_out": [str(error) for error in left_out]}
    say(json.dumps(told) if arguments.json else shlex.quote(str(path)))
    return 1 if left_out else 0
