"""From footage to a drive: every step of a solve, in order, each made once."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from unveil_core.base.disk.links import LOCK
from unveil_core.base.disk.rights import keep_rights, rights_of_files
from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.base.output.own_folder import EXCHANGE, NEW, OwnFolder
from unveil_core.base.output.written import DRIVE, record_of
from unveil_core.base.output.written import RECORD as LIST
from unveil_core.pipeline.output_place import check_folder_place
from unveil_core.solve.events import Events, Reporter
from unveil_core.solve.footage.kinds import files_of, is_clip, is_footage
from unveil_core.solve.mapping.process import check_installed
from unveil_core.solve.plan import SolvePlan, footage_marks, made_from, plan_solve
from unveil_core.solve.settings import SolveSettings
from unveil_core.solve.stages.decode import decode
from unveil_core.solve.stages.fill import place_and_fill
from unveil_core.solve.stages.finish import PAGE, RECORD, finish
from unveil_core.solve.stages.look import look
from unveil_core.solve.stages.mapping import map_frames
from unveil_core.solve.stages.rest import place_rest
from unveil_core.solve.steps import Steps

__all__ = ["Solved", "planned", "solve"]

WORK = "solve"
"""Folder in the drive's for what steps leave behind."""
OWN = {WORK, LOCK, NEW, EXCHANGE, LIST}
"""What a solve that did not come to its end leaves in an empty folder."""
WRITTEN = (
    "transforms.json",
    "points.ply",
    *(f"sparse/0/{n}.txt" for n in ("cameras", "images", "points3D")),
    PAGE,
    RECORD,
)
"""What each solve writes anew."""
MEND = "name another folder with -o, or add --replace to write over it"


@dataclass(frozen=True, eq=False)
class Solved:
    """Attributes: drive: the folder written; facts: what was found, JSON-able, as in its solve.json."""

    drive: Path
    facts: dict[str, Any]


def solve(
    inputs: Sequence[Path], output: Path, settings: SolveSettings, reporter: Reporter = lambda event: None
) -> Solved:
    """Make a drive of clips or folders of photographs, one a camera.

    Args:
        output: folder of the drive; made if need be, continued if a solve wrote it.
        reporter: receives each event as a dict.
    Raises:
        DriveError: no footage, or it cannot be solved. SettingsError: a setting, a place for no results, or a folder with files
            that no solve of this footage wrote, or that somebody changed since.
        Cancelled, Interrupted: calling again continues.
    """
    inputs = [Path(p) for p in inputs]
    _check_inputs(inputs)
    _check_output(output, inputs, settings)
    check_installed("pycolmap", *(["av"] if any(is_clip(p) for p in inputs) else []))
    begun = time.monotonic()
    source = {"made_from": made_from(inputs, settings), "footage_marks": footage_marks(inputs)}
    rights = rights_of_files(p for path in inputs for p in files_of(path))
    own = OwnFolder(output, replace=settings.replace, mend=MEND, says={DRIVE: True})
    with own, _nobody_else_reads(output / WORK, rights):
        own.check(WRITTEN)
        steps, events = Steps(output / WORK), Events(reporter)
        reels, images = decode(inputs, own, settings, steps, events)
        looked = look(reels, images, settings, steps, events)
        model = map_frames(reels, looked, images, settings, steps, events)
        every = place_rest(model, reels, images, steps, events)
        found = place_and_fill(every, reels, looked, images, settings, steps, events)
        seconds = time.monotonic() - begun
        facts = finish(every, found, reels, looked, images, own, settings, events, source, seconds, rights)
    return Solved(output, facts)


@contextmanager
def _nobody_else_reads(folder: Path, rights: int) -> Iterator[None]:
    """Leave a folder with these rights at most, however its use ends."""
    try:
        yield
    finally:
        keep_rights([folder] if folder.is_dir() else [], rights)


def planned(inputs: Sequence[Path], output: Path, settings: SolveSettings) -> SolvePlan:
    """What :func:`solve` would do. Arguments and errors as there; nothing is written."""
    inputs = [Path(p) for p in inputs]
    _check_inputs(inputs)
    _check_output(output, inputs, settings)
    check_installed("pycolmap", *(["av"] if any(is_clip(p) for p in inputs) else []))
    return plan_solve(inputs, output / RECORD, settings)


def _check_inputs(inputs: Sequence[Path]) -> None:
    if not inputs:
        raise SettingsError("no footage is given", mend="name a clip or a folder of photographs")
    for path in inputs:
        if not path.exists():
            raise DriveError("Not found", path=path, mend="check the path")
        if not is_footage(path):
            if path.is_file():
                raise DriveError(
                    "Not footage", path=path, mend="give a clip, as .mp4 or .mov, or a folder of photographs"
                )
            raise DriveError(
                "Not footage: the folder has no photographs", path=path, mend="give a folder of JPEG or PNG files"
            )


def _check_output(output: Path, inputs: Sequence[Path], settings: SolveSettings) -> None:
    if output.exists() and not output.is_dir():
        raise SettingsError("Not a folder", path=output, mend="name a folder with -o")
    check_folder_place(output, again=True)
    target = output.resolve()
    for path in inputs:
        own = path.resolve()
        if target == own or own in target.parents or target in own.parents:
            raise SettingsError(
                f"lies in the footage, or around it: {path}", path=output, mend="name a folder beside it"
            )
    if settings.replace or not output.is_dir():
        return
    held = record_of(output / RECORD)
    if held is None and not all(p.name in OWN for p in output.iterdir()):
        raise SettingsError("Not replaced: no solve wrote it", path=output, mend=MEND)
    if held is not None and not _shares_footage(held, inputs):
        raise SettingsError(f"Not replaced: it was solved from other footage{_called(held)}", path=output, mend=MEND)


def _shares_footage(held: dict[str, Any], inputs: Sequence[Path]) -> bool:
    marks = held.get("footage_marks")
    return isinstance(marks, list) and any(mark in marks for mark in footage_marks(inputs))


def _called(held: dict[str, Any]) -> str:
    names = held.get("footage")
    return f", {', '.join(map(str, names))}" if isinstance(names, list) and names else ""
