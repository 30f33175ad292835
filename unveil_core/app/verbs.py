"""What each verb of the command does: a function from the parsed arguments to an exit code.

Each function imports what it needs when it is called, so that one verb does not wait for the imports of another.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from unveil_core.app.batch import run_batch_part
from unveil_core.app.check import run_check
from unveil_core.app.console import reporting_for, say
from unveil_core.app.footage.solve import run_solve
from unveil_core.app.given_settings import settings_of
from unveil_core.app.mask.command import run_mask
from unveil_core.app.parser import STAGE_VERBS
from unveil_core.app.runs.whole_run import demo, import_drive, run_all, sample_drive
from unveil_core.base.errors import SettingsError
from unveil_core.pipeline.settings import RunSettings

if TYPE_CHECKING:  # the stages' module loads NumPy
    from unveil_core.base.progress import Progress
    from unveil_core.pipeline.stage import Reporter

__all__ = ["VERBS"]


def _recorded_settings(arguments: argparse.Namespace) -> RunSettings:
    """The settings that the command line gives, over those that the workspace records."""
    from unveil_core.workspace.workspace import Workspace

    recorded = Workspace.open(arguments.workspace).state().get("settings", {})
    return settings_of(arguments, RunSettings.from_json(recorded))


def _stage(arguments: argparse.Namespace) -> int:
    from unveil_core.pipeline.run import run_verb

    settings = _recorded_settings(arguments)
    with reporting_for(arguments) as reporter:
        run_verb(arguments.verb, arguments.workspace, settings, reporter=reporter)
    return 0


def _run_block(arguments: argparse.Namespace) -> int:
    from unveil_core.pipeline.run import stage_named
    from unveil_core.pipeline.runner import run_block
    from unveil_core.workspace.workspace import Workspace

    space = Workspace.open(arguments.workspace)
    drive = Path(str(space.state().get("drive", "")))
    with reporting_for(arguments) as reporter:
        settings = _recorded_settings(arguments)
        run_block(space, stage_named(arguments.stage), arguments.block, settings, drive, reporter=reporter)
    return 0


def _status(arguments: argparse.Namespace) -> int:
    from unveil_core.pipeline.status import explained_states
    from unveil_core.workspace.workspace import Workspace

    settings = _recorded_settings(arguments)
    states = explained_states(Workspace.open(arguments.workspace), settings)
    if arguments.json:
        why = {name: found.why for name, found in states.items() if found.why}
        print(json.dumps({"stages": {name: found.state for name, found in states.items()}, "why": why}))
    else:
        for name, found in states.items():
            say(f"{name:<12} {found.state}{f' ({found.why})' if found.state == 'stale' else ''}")
    return 0


def _evaluate(arguments: argparse.Namespace) -> int:
    if arguments.holdout_masks:
        return _check_footage(arguments)
    for name in ("cars", "quality", "output"):
        if getattr(arguments, name) is not None:
            raise SettingsError(f"Not used without virtual cars: --{name}", mend="add --holdout-masks")
    from unveil_core.evaluate import run_evaluation
    from unveil_core.workspace.workspace import Workspace

    root = Workspace.open(arguments.workspace).root
    metrics = run_evaluation(root, arguments.truth, lpips=arguments.lpips, fid=arguments.fid)
    print(json.dumps(metrics, indent=None if arguments.json else 1))
    return 0


def _check_footage(arguments: argparse.Namespace) -> int:
    from unveil_core.app.holdout_check import CARS, check_footage, holdout_lines

    for name in ("truth", "fid"):
        if getattr(arguments, name) is not None:
            raise SettingsError(f"Not used with --holdout-masks: --{name}", mend="leave one of them out")
    with reporting_for(arguments) as reporter:
        found = check_footage(
            arguments.workspace,
            arguments.output,
            cars=CARS if arguments.cars is None else arguments.cars,
            settings=RunSettings(quality=arguments.quality or "standard", device=arguments.works_on),
            quality=arguments.quality,
            device=arguments.works_on,
            lpips=arguments.lpips,
            reporter=reporter,
        )
    print(json.dumps({"holdout": found}) if arguments.json else "\n".join(holdout_lines(found)))
    return 0


def _render(arguments: argparse.Namespace) -> int:
    from unveil_core.app.render_views import render_views
    from unveil_core.workspace.workspace import Workspace

    with reporting_for(arguments) as reporter:
        views = render_views(
            Workspace.open(arguments.workspace),
            arguments.output,
            state=arguments.state,
            path=arguments.path,
            beside=arguments.beside,
            above=arguments.above,
            planes=arguments.planes,
            progress=_progress_of("render", reporter),
        )
    print(json.dumps({"folder": str(arguments.output), "views": views}) if arguments.json else arguments.output)
    return 0


def _export(arguments: argparse.Namespace) -> int:
    from unveil_core.app.export import export_results
    from unveil_core.workspace.workspace import Workspace

    with reporting_for(arguments) as reporter:
        written = export_results(
            Workspace.open(arguments.workspace),
            to=arguments.to,
            state=arguments.state,
            triangles=arguments.triangles,
            levels=arguments.lods,
            texture_px=arguments.texture,
            start_frame=arguments.start_frame,
            spz_version=arguments.spz,
            epsg=arguments.epsg,
            undistorted=arguments.undistorted,
            output=arguments.output,
            replace=arguments.replace,
            progress=_progress_of("export", reporter),
            notice=_notice_of("export", reporter),
        )
    names = [str(path) for path in written]
    # "file" is what programs of before read, which ask for one.
    print(json.dumps({"file": names[0], "files": names}) if arguments.json else "\n".join(names))
    return 0


def _progress_of(verb: str, reporter: Reporter) -> Progress:
    """Progress of a verb that is no stage, as its events."""

    def progress(done: int, total: int, message: str = "", **metrics: float) -> None:
        event = {"t": round(time.time(), 3), "stage": verb, "done": done, "total": total, "message": message}
        reporter({**event, "level": "info", **metrics})

    return progress


def _notice_of(verb: str, reporter: Reporter) -> Callable[[str], None]:
    """Notices of a verb that is no stage, as its events."""

    def notice(line: str) -> None:
        event = {"t": round(time.time(), 3), "stage": verb, "done": 0, "total": 0, "message": line}
        reporter({**event, "level": "notice"})

    return notice


def _bench(arguments: argparse.Namespace) -> int:
    from unveil_core.app.bench import run_bench

    if arguments.what in ("reconstruction", "pipeline", "run") and arguments.drive is None:
        arguments.drive = sample_drive()
    return run_bench(arguments)


def _doctor(arguments: argparse.Namespace) -> int:
    from unveil_core.app.doctor import examine

    found = examine()
    if arguments.json:
        print(json.dumps(found))
    else:
        for key, value in found.items():
            say(f"{key:<32} {value}")
    return 0 if found["ok"] else 1


def _completion(arguments: argparse.Namespace) -> int:
    from unveil_core.app.grammar.completion import completion_of
    from unveil_core.app.parser import command_parser

    script = completion_of(command_parser(), arguments.shell)
    print(json.dumps({"completion": script}) if arguments.json else script)
    return 0


VERBS: dict[str, Callable[[argparse.Namespace], int]] = {
    "demo": demo,
    "run": run_all,
    "import": import_drive,
    "solve": run_solve,
    "check": run_check,
    "mask": run_mask,
    **dict.fromkeys(STAGE_VERBS, _stage),
    "status": _status,
    "run-block": _run_block,
    "evaluate": _evaluate,
    "render": _render,
    "export": _export,
    "bench": _bench,
    "batch": run_batch_part,
    "doctor": _doctor,
    "completion": _completion,
}
"""Every verb of the command line, with what it does."""
