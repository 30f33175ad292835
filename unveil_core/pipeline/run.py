"""The pipeline as functions: from a drive to the empty street, or one stage of a workspace."""

from __future__ import annotations

import shutil
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from unveil_core.base.errors import ConfirmError, InUseError, SettingsError, UnveilError, WorkspaceError
from unveil_core.base.kernels.device import check_device
from unveil_core.base.progress import Progress
from unveil_core.drives.checks.findings import Finding, worst_first
from unveil_core.drives.checks.look_over import looked_over
from unveil_core.drives.checks.solved import told_of_solve
from unveil_core.drives.drive import Drive
from unveil_core.drives.importing.check import Checked, check_drive
from unveil_core.drives.importing.colours import colour_notices
from unveil_core.drives.marked import marked_objects, told_of_footage
from unveil_core.drives.scale_and_up import Placement, place_drive
from unveil_core.drives.selecting import named_frames
from unveil_core.labelling.segmenter import NO_LABELS_HELP
from unveil_core.pipeline.forecasting import expected_of
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.other_drive import check_same_drive
from unveil_core.pipeline.output_place import check_place
from unveil_core.pipeline.outside import opened, opened_once
from unveil_core.pipeline.runner import run_stages
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.stage import Notice, Reporter, Stage, silent
from unveil_core.pipeline.steps.import_ import labels_come_from
from unveil_core.points.of_drive import lacks_points
from unveil_core.semantics.labels import choose_labels
from unveil_core.semantics.too_much import much_removed
from unveil_core.workspace.workspace import Workspace

__all__ = ["Begun", "found_wrong", "look_at", "run", "run_verb", "stage_named"]

FEW_POINTS = (
    "the drive has {} points: optical flow finds them in its photographs, and gives scale and up where files lack these"
)


def stage_named(name: str) -> Stage:
    """The stage of that name."""
    return next(s for s in STAGES if s.name == name)


@opened_once()
def run(
    drive: str | Path,
    workspace: str | Path,
    settings: RunSettings | None = None,
    *,
    until: str | None = None,
    replace: bool = False,
    yes: bool = False,
    told: str = "",
    reporter: Reporter = silent,
) -> Workspace:
    """Run everything that is missing or changed, from a drive on disk to the report.

    Args:
        drive: a transforms.json, a COLMAP folder, or a folder that holds one.
        workspace: folder of the results; made if need be, continued if it exists.
        settings: what to remove and how; defaults remove everything removable.
        until: name of the last stage to run.
        replace: whether a workspace with results of another drive may be given this one.
        yes: go on where a check would have the user confirm it.
        told: a line about the settings, the first event.
        reporter: receives each event as a dict.
    Raises:
        ConfirmError: the drive is so surely not what it is taken for that somebody must confirm it.
        UnveilError: bad input, a workspace in, of or around a drive, or with results of another drive; a workspace that this call
            made is deleted again.
        Cancelled: SIGINT or SIGTERM; calling again continues.
    """
    settings = settings or RunSettings()
    begun = look_at(drive, workspace, settings, until=until, replace=replace, reporter=reporter)
    findings = begun.findings
    if findings and findings[0].asks and not yes:
        raise ConfirmError(
            findings[0].problem, path=begun.drive.root, mend=f"{findings[0].mend}; --yes goes on all the same"
        )
    notices = [*([Notice("import", told)] if told else []), *begun.notices]
    space = Workspace.create(workspace)
    try:
        place = Path(drive).absolute()
        expected = expected_of(
            begun.drive, begun.placed, space, begun.stages, settings, lambda line: reporter(_event(line)), place
        )
        notices += [] if expected is None else expected.notices(space.root)
        stages = begun.stages
        del begun  # the stages read what was imported: two clouds of points of a long drive need not be held
        run_stages(space, stages, settings, place, notices=notices, expected=expected, reporter=reporter)
    except InUseError:
        raise  # whoever works in it goes on with what this call made
    except UnveilError:
        # Only what this call made, and while nobody else works in it: two may have begun at once.
        if space.made:
            with suppress(WorkspaceError), space.lock():
                if all(p.name.startswith((".", "workspace.json", "events.jsonl")) for p in space.root.iterdir()):
                    shutil.rmtree(space.root, ignore_errors=True)
        raise
    return space


@dataclass(frozen=True)
class Begun:
    """A run before its first stage.

    Attributes:
        drive: as read; placed: its scale and axes; stages: that belong to the run.
        first: whether there is no workspace yet.
        findings: what looks wrong with the drive, the worst first; of a first run alone.
        notices: what is assumed of the drive, as events.
    """

    drive: Drive
    placed: Placement
    stages: tuple[Stage, ...]
    first: bool
    findings: tuple[Finding, ...]
    notices: tuple[Notice, ...]


def look_at(
    drive: str | Path,
    workspace: str | Path,
    settings: RunSettings,
    *,
    until: str | None = None,
    replace: bool = False,
    reporter: Reporter = silent,
) -> Begun:
    """Open a drive and check all that can be checked before a run; nothing is written. Arguments and errors as :func:`run`."""
    check_device(settings.device)
    names = [s.name for s in STAGES]
    if until is not None and until not in names:
        raise SettingsError(f"Not a stage: {until!r}", mend=f"use one of {', '.join(names)}")
    stages = STAGES[: names.index(until) + 1] if until else STAGES
    check_place(Path(workspace), [Path(drive)])
    read = opened(drive, settings.drive_options)
    first = not Workspace.may_be(workspace)
    if not first and not replace:
        check_same_drive(Workspace.open(workspace), Path(drive), read)
    checked = None
    if first:
        # Before anything is made: whether the drive is whole and the selection selects something.
        checked = check_drive(read, _every_second(reporter))
    labels = labels_come_from(read, settings)
    # Before the choice is made, and where labels only come with the import, nothing can be checked.
    if first and until not in ("import", "objects") and labels in ("drive", "nothing"):
        marked = {m.id for m in marked_objects(settings.marked)}
        listed = [i for i in settings.instances if i not in marked]
        all_marked = labels == "nothing" and marked and not settings.instances
        if listed or settings.remove or not (settings.instances or all_marked):
            choose_labels(read, settings.remove, listed)
    if settings.keyframes:
        named_frames(read.frames, settings.keyframes)
    bare = lacks_points(read)  # the import finds some: what needs points waits for them
    height = None if bare else settings.camera_height
    placed = place_drive(read, scale=settings.scale, up=settings.up, camera_height_m=height)
    findings = [] if checked is None else found_wrong(read, placed, settings, checked)
    level = "warning" if placed.surprising else "notice"
    notices = [Notice("import", placed.message(), level, {"placement": placed.to_json()})]
    if bare:
        notices = [Notice("import", FEW_POINTS.format(len(read.points.positions) or "no"), "notice")]
    notices += [Notice("import", line, "notice") for line in told_of_solve(Path(drive))]
    other = () if settings.marked is None else told_of_footage(Path(settings.marked), read.frames)
    notices += [Notice("import", line, "warning") for line in (*other, *read.notices, *colour_notices(read.frames))]
    notices += [] if not findings else [_worst(findings)]
    if labels == "nothing" and settings.marked is None:
        notices.append(Notice("import", NO_LABELS_HELP, "warning"))
    return Begun(read, placed, stages, first, tuple(findings), tuple(notices))


def found_wrong(drive: Drive, placed: Placement, settings: RunSettings, checked: Checked) -> list[Finding]:
    """What looks wrong with a drive as read, the worst first.

    Args:
        checked: what :func:`check_drive` saw of its labels.
    """
    much = much_removed(drive, checked, settings.remove, settings.instances)
    rest = looked_over(drive, placed, convention_given=settings.pose_convention is not None)
    return list(worst_first([*([] if much is None else [much]), *rest]))


def _worst(findings: Sequence[Finding]) -> Notice:
    more = f"; {len(findings) - 1} more, which unveil check shows" if len(findings) > 1 else ""
    return Notice("import", f"LOOK AT THE DRIVE: {findings[0].line}{more}", "warning")


def _every_second(reporter: Reporter) -> Progress:
    """Progress of what comes before the first stage, as events that no workspace logs; none where it takes no second."""
    last = time.monotonic()

    def progress(done: int, total: int, message: str = "", **_: float) -> None:
        nonlocal last
        if time.monotonic() - last >= 1.0:
            last = time.monotonic()
            reporter(_event(message, done, total))

    return progress


def _event(message: str, done: int = 0, total: int = 0) -> dict[str, object]:
    """An event before the first stage, which no workspace logs."""
    return {
        "t": round(time.time(), 3),
        "stage": "import",
        "done": done,
        "total": total,
        "message": message,
        "level": "info",
    }


def run_verb(
    name: str, workspace: str | Path, settings: RunSettings | None = None, *, reporter: Reporter = silent
) -> bool:
    """Run one stage of an existing workspace, if it is not up to date; returns whether it ran."""
    space = Workspace.open(workspace)
    state = space.state()
    settings = settings or RunSettings.from_json(state.get("settings", {}))
    drive = Path(str(state.get("drive", "")))
    return bool(run_stages(space, [stage_named(name)], settings, drive, reporter=reporter))
