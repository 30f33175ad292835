"""From footage to a drive: every step of a solve, in order, each made once."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.base.files import write_json_atomic
from unveil_core.base.output.written import GENERATOR, record_of
from unveil_core.solve.events import Events, Reporter
from unveil_core.solve.footage.kinds import is_clip, is_footage
from unveil_core.solve.mapping.process import check_installed
from unveil_core.solve.plan import SolvePlan, made_from, plan_solve
from unveil_core.solve.settings import SolveSettings
from unveil_core.solve.stages.decode import decode
from unveil_core.solve.stages.fill import place_and_fill
from unveil_core.solve.stages.finish import RECORD, finish
from unveil_core.solve.stages.look import look
from unveil_core.solve.stages.mapping import map_frames
from unveil_core.solve.stages.rest import place_rest
from unveil_core.solve.steps import Steps

__all__ = ["Solved", "planned", "solve"]

WORK = "solve"
"""Folder in the drive's for what steps leave behind."""


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
        DriveError: no footage, or it cannot be solved. SettingsError: a setting, or a folder that no solve wrote.
        Cancelled, Interrupted: calling again continues.
    """
    inputs = [Path(p) for p in inputs]
    _check_inputs(inputs)
    _check_output(output, inputs, settings)
    output.mkdir(parents=True, exist_ok=True)
    check_installed("pycolmap", *(["av"] if any(is_clip(p) for p in inputs) else []))
    begun, source = time.monotonic(), made_from(inputs, settings)
    work = output / WORK
    steps, events = Steps(work), Events(reporter)
    write_json_atomic(output / RECORD, {"generator": GENERATOR, "state": "begun"})
    reels = decode(inputs, output / "images", settings, steps, events)
    looked = look(reels, output, settings, steps, events)
    model = map_frames(reels, looked, output, settings, steps, events)
    every = place_rest(model, reels, output, steps, events)
    found = place_and_fill(every, reels, looked, output, settings, steps, events)
    facts = finish(every, found, reels, looked, output, settings, events, source, time.monotonic() - begun)
    return Solved(output, facts)


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
    target = output.resolve()
    for path in inputs:
        own = path.resolve()
        if target == own or own in target.parents or target in own.parents:
            raise SettingsError(
                f"lies in the footage, or around it: {path}", path=output, mend="name a folder beside it"
            )
    if output.is_dir() and any(output.iterdir()) and record_of(output / RECORD) is None and not settings.replace:
        raise SettingsError(
            "Not replaced: no solve wrote it", path=output, mend="name another folder with -o, or add --replace"
        )
