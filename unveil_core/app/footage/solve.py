"""``unveil solve``: a drive out of a clip or photographs; and ``unveil run`` of such, which does both."""

from __future__ import annotations

import argparse
import json
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unveil_core.app.console import reporting_for, say
from unveil_core.app.footage.time_left import with_time_left
from unveil_core.base.errors import DriveError, SettingsError, UnveilError
from unveil_core.pipeline.settings import RunSettings

if TYPE_CHECKING:  # loads NumPy
    from unveil_core.pipeline.stage import Reporter
    from unveil_core.solve.plan import SolvePlan
    from unveil_core.solve.settings import SolveSettings

__all__ = [
    "OF_FOOTAGE",
    "drive_beside",
    "drive_of_footage",
    "footage_settings",
    "is_footage_alone",
    "next_step",
    "plan_of_footage",
    "refuse_clip",
    "run_solve",
    "summary",
    "without_footage",
]

OF_FOOTAGE = ("every", "lens", "focal", "speed", "known_length", "gpx", "thorough")
"""Options of ``run`` that footage alone takes."""
CARRIED = ("labels", "segmenter", "camera_height", "frames")
"""Settings of a run that the solve takes instead: the drive that it writes has what follows from them."""


def run_solve(arguments: argparse.Namespace) -> int:
    """Solve footage, say what was found; 0 where a drive was written."""
    from unveil_core.solve.settings import SolveSettings
    from unveil_core.solve.solve import solve

    given: dict[str, Any] = {
        f.name: getattr(arguments, f.name) for f in fields(SolveSettings) if hasattr(arguments, f.name)
    }
    settings = SolveSettings(**given)
    with reporting_for(arguments) as reporter:
        steps = _expected(arguments.footage, arguments.output, settings)
        solved = solve(arguments.footage, arguments.output, settings, with_time_left(reporter, steps))
    if arguments.json:
        say(json.dumps({"solve": solved.facts}))
    else:
        for line in summary(solved.facts):
            say(line)
        say(f"next                   {next_step(solved.drive, settings)}")
        say(solved.drive / "solve.html")
    return 0


def _expected(footage: list[Path], output: Path, settings: SolveSettings) -> dict[str, float]:
    """Seconds of each step, about; none of footage that cannot be read: the solve itself says what is wrong."""
    from unveil_core.solve.solve import planned

    try:
        return planned(footage, output, settings).steps
    except UnveilError:
        return {}


def next_step(drive: Path, settings: SolveSettings) -> str:
    """The command that goes on from a drive: without labels nothing says yet what to remove."""
    if any((settings.labels, settings.masks, settings.segmenter)):
        return f"unveil run {drive} -o WORKSPACE"
    return f"unveil mask {drive} -o masks --click FRAME:X,Y (no labels: it outlines what to remove)"


def summary(facts: dict[str, Any]) -> list[str]:
    """What a solve found, in lines."""
    lenses = "; ".join(
        f"{name}: {lens['focal_px']:.0f} px" + (f" ({lens['focal_known_by']})" if lens["focal_known_by"] else "")
        for name, lens in facts["lens"].items()
    )
    way = "" if facts["way_m"] is None else f", {facts['way_m']:.1f} m of way"
    return [
        f"frames placed          {facts['placed']} of {facts['frames']}{way}",
        f"error                  {facts['error_px']:.2f} pixels",
        f"focal length           {lenses}",
        f"scale                  {facts['scale']}",
        f"points                 {facts['points']:,}",
    ]


def is_footage_alone(path: Path) -> bool:
    """Whether a path is a clip, or a folder of photographs that is no drive."""
    from unveil_core.drives.formats.registry import FORMATS
    from unveil_core.solve.footage.kinds import is_footage

    return is_footage(path) and not any(f.recognizes(path) for f in FORMATS)


def refuse_clip(path: Path) -> None:
    """Check that a path is no clip, before anything is asked of the place that results go to.

    Raises:
        DriveError: it is one; with the verb that makes a drive of it.
    """
    from unveil_core.drives.checks.unread import unread
    from unveil_core.solve.footage.kinds import is_clip

    if is_clip(path) and (known := unread(path)) is not None:
        raise DriveError(known.problem, path=path, mend=known.mend)


def footage_settings(arguments: argparse.Namespace, settings: RunSettings) -> SolveSettings:
    """The settings of the solve that a run of footage begins with.

    Raises:
        SettingsError: a setting of drives alone.
    """
    from unveil_core.solve.settings import SolveSettings

    for name, value in (("scale", settings.scale), ("up", settings.up), ("cameras", settings.cameras or None)):
        if value is not None:
            raise SettingsError(f"Not an option of footage: --{name} belongs to drives", mend="leave it out")
    own: dict[str, Any] = {k: getattr(arguments, k) for k in OF_FOOTAGE if hasattr(arguments, k)}
    return SolveSettings(
        frames=settings.frames,
        labels=_path(settings.labels),
        segmenter=_path(settings.segmenter),
        camera_height=settings.camera_height,
        replace=getattr(arguments, "replace", False),
        **own,
    )


def drive_of_footage(
    footage: Path, workspace: Path, arguments: argparse.Namespace, settings: RunSettings, reporter: Reporter
) -> tuple[Path, RunSettings]:
    """Solve footage beside a workspace, and what the run of it takes: the drive, and the settings that are left.

    Raises:
        SettingsError: the run would end after the solve, for nothing says what to remove.
    """
    from unveil_core.solve.solve import solve

    own = footage_settings(arguments, settings)
    if getattr(arguments, "until", None) not in ("import", "objects"):
        _check_says_what_goes(footage, settings)
    solved = solve([footage], drive_beside(workspace), own, reporter)
    left: dict[str, Any] = dict.fromkeys(CARRIED)
    return solved.drive, replace(settings, **left)


def _check_says_what_goes(footage: Path, settings: RunSettings) -> None:
    if not any((settings.labels, settings.segmenter, settings.marked, settings.instances)):
        raise SettingsError(
            "nothing says what to remove from this footage",
            path=footage,
            mend="give --labels or --segmenter; or click on it: unveil solve first, then unveil mask of its drive",
        )


def plan_of_footage(
    footage: Path, workspace: Path, arguments: argparse.Namespace, settings: RunSettings
) -> tuple[SolvePlan, RunSettings]:
    """What the solve that a run of footage begins with would do, and the settings that are left for the run."""
    from unveil_core.solve.solve import planned

    plan = planned([footage], drive_beside(workspace), footage_settings(arguments, settings))
    left: dict[str, Any] = dict.fromkeys(CARRIED)
    return plan, replace(settings, **left)


def drive_beside(workspace: Path) -> Path:
    """Where the drive of a run of footage is written."""
    whole = workspace.absolute()
    return whole.with_name(f"{whole.name}_drive")


def without_footage(arguments: argparse.Namespace) -> None:
    """Check that no option of footage is given for a drive.

    Raises:
        SettingsError: one is.
    """
    for name in OF_FOOTAGE:
        if hasattr(arguments, name):
            option = f"--{name.replace('_', '-')}"
            raise SettingsError(
                f"Not an option of drives: {option} belongs to clips and photographs", mend="leave it out"
            )


def _path(value: object) -> Path | None:
    return None if value is None else Path(str(value))
