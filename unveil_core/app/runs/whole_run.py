"""``unveil run``, ``import`` and ``demo``: a run keeps the settings of its workspace, but for those given."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from unveil_core.app.confirming import confirmed
from unveil_core.app.console import reporting_for, say
from unveil_core.app.footage.solve import (
    drive_beside,
    drive_of_footage,
    is_footage_alone,
    plan_of_footage,
    refuse_clip,
    without_footage,
)
from unveil_core.app.given_settings import given_settings
from unveil_core.app.parser import STAGE_VERBS
from unveil_core.base.errors import DriveError
from unveil_core.pipeline.options.given import settings_over

if TYPE_CHECKING:  # loads NumPy
    from unveil_core.pipeline.options.kept import Kept
    from unveil_core.pipeline.settings import RunSettings
    from unveil_core.solve.plan import SolvePlan
    from unveil_core.workspace.workspace import Workspace

__all__ = ["demo", "import_drive", "run_all", "sample_drive"]


def sample_drive() -> Path:
    """The sample street of a source checkout."""
    folder = Path(__file__).resolve().parents[3] / "sample_scenes" / "parked_street"
    if not (folder / "transforms.json").is_file():
        raise DriveError(
            "Not in the installed package: the sample street",
            mend="run `make demo` in a checkout of the sources, or `unveil run DRIVE -o WORKSPACE` on a drive of yours",
        )
    return folder


def demo(arguments: argparse.Namespace) -> int:
    """Unveil the sample street."""
    return _run_and_sum_up(sample_drive(), arguments)


def run_all(arguments: argparse.Namespace) -> int:
    """From a drive, a clip or photographs to the report."""
    from unveil_core.pipeline.output_place import check_place

    if not is_footage_alone(arguments.drive):
        without_footage(arguments)
        return _run_and_sum_up(arguments.drive, arguments)
    check_place(
        arguments.output, [arguments.drive] if arguments.drive.is_dir() else []
    )  # beside a clip is where results go
    if arguments.dry_run:
        return _plan_footage(arguments)
    return _run_and_sum_up(drive_beside(arguments.output), arguments, footage=arguments.drive)


def import_drive(arguments: argparse.Namespace) -> int:
    """The first stages: the drive, and what can be removed."""
    refuse_clip(arguments.drive)
    if arguments.dry_run:
        return _plan(arguments.drive, arguments, "objects")
    workspace = _run(arguments.drive, arguments, "objects")
    if arguments.preview:
        from unveil_core.drives.imported import read_imported
        from unveil_core.labelling.preview import write_preview

        pictures = write_preview(read_imported(workspace.drive_dir), workspace.root / "preview")
        say(f"{len(pictures)} pictures in {workspace.root / 'preview'}", sys.stderr if arguments.json else sys.stdout)
    return 0


def _run_and_sum_up(drive: Path, arguments: argparse.Namespace, *, footage: Path | None = None) -> int:
    until = getattr(arguments, "until", None)
    if arguments.dry_run:
        return _plan(drive, arguments, until)
    workspace = _run(drive, arguments, until, footage=footage)
    if until in (None, "report") and not arguments.quiet:
        from unveil_core.report.summary import print_summary

        print_summary(workspace.root, sys.stderr if arguments.json else sys.stdout)
    return 0


def _run(drive: Path, arguments: argparse.Namespace, until: str | None, *, footage: Path | None = None) -> Workspace:
    """Run a drive; where it is one of ``footage``, solve that first."""
    from unveil_core.pipeline.run import run

    kept = _kept(drive, arguments)
    settings = settings_over(kept.settings, given_settings(arguments))
    replace = getattr(arguments, "replace", False)

    def begun(yes: bool) -> Workspace:
        with reporting_for(arguments) as reporter:
            source, left = drive, settings
            if footage is not None:
                source, left = drive_of_footage(footage, arguments.output, arguments, settings, reporter)
            return run(
                source,
                arguments.output,
                left,
                until=until,
                replace=replace,
                yes=yes,
                told=kept.message,
                reporter=reporter,
            )

    return confirmed(arguments, begun)


def _plan_footage(arguments: argparse.Namespace) -> int:
    """Say what the solve would do; and of the run, where the drive that it goes on with is there already."""
    drive, until = drive_beside(arguments.output), arguments.until
    kept = _kept(drive, arguments)
    settings = settings_over(kept.settings, given_settings(arguments))
    first, left = plan_of_footage(arguments.drive, arguments.output, arguments, settings)
    if not first.would_run:
        return _plan(drive, arguments, until, settings=left, first=first)
    names = ["import", *STAGE_VERBS]
    names = names[: names.index(until) + 1] if until else names
    if arguments.json:
        stages = {name: {"state": "todo", "why": "the solve comes first", "would_run": True} for name in names}
        plan: dict[str, object] = {
            "solve": first.to_json(),
            "notices": [],
            "findings": [],
            "stages": stages,
            "forecast": None,
        }
        print(json.dumps({"plan": {**plan, "settings": left.to_json()}}))
    else:
        after = f"{names[0]} to {names[-1]} would run after it; how long they take is known when the cameras are"
        say("\n".join([*([kept.message] if kept.message else []), *first.lines(), after]))
    return 0


def _plan(
    drive: Path,
    arguments: argparse.Namespace,
    until: str | None,
    *,
    settings: RunSettings | None = None,
    first: SolvePlan | None = None,
) -> int:
    """Say what a run would do; ``settings``: of it, the arguments' by default; ``first``: what is told of the solve before."""
    from unveil_core.pipeline.dry_run import plan_run

    kept = _kept(drive, arguments)
    settings = settings or settings_over(kept.settings, given_settings(arguments))
    replace = getattr(arguments, "replace", False)
    plan = plan_run(
        drive, arguments.output, settings, until=until, replace=replace, tell=lambda line: say(line, sys.stderr)
    )
    if arguments.json:
        solved = {} if first is None else {"solve": first.to_json()}
        print(json.dumps({"plan": {**solved, **plan.to_json(settings)}}))
    else:
        before = [] if first is None else first.lines()
        say("\n".join([*([kept.message] if kept.message else []), *before, *plan.lines()]))
    return 0


def _kept(drive: Path, arguments: argparse.Namespace) -> Kept:
    from unveil_core.pipeline.options.kept import kept_settings

    return kept_settings(
        arguments.output,
        drive,
        given_settings(arguments),
        reset=arguments.reset,
        replace=getattr(arguments, "replace", False),
    )
