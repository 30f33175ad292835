"""A solve that is only planned: whether it would run, why, and about how long. Nothing is written."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from unveil_core.base.drive_options import frame_numbers
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_own_json
from unveil_core.base.output.stamps import mark_of
from unveil_core.base.wording import about_as_long
from unveil_core.forecast.solving import seconds_by_step
from unveil_core.solve.footage.kinds import files_of, is_clip, pictures_in
from unveil_core.solve.settings import SolveSettings
from unveil_core.solve.steps import facts_of_files

__all__ = ["SolvePlan", "footage_marks", "made_from", "plan_solve"]

NEIGHBOURS = 5
"""Frames that each is matched with, see ``looks.pairs``."""


@dataclass(frozen=True)
class SolvePlan:
    """What a solve would do.

    Attributes:
        why: it would run; empty where the drive is up to date.
        frames: of all inputs that it takes; width, height: of the first input's, pixels.
        steps: seconds that each step takes at most, about, in order.
    """

    why: str
    frames: int
    width: int
    height: int
    steps: dict[str, float]

    @property
    def seconds(self) -> float:
        """How long it takes at most, about."""
        return sum(self.steps.values())

    @property
    def would_run(self) -> bool:
        """Whether anything is to be done."""
        return bool(self.why)

    def lines(self) -> list[str]:
        """For people."""
        if not self.would_run:
            return [f"{'solve':<12} up to date"]
        size = f"{self.frames} frames, {self.width}x{self.height}"
        return [f"{'solve':<12} would run: {self.why}", f"{'':<12} {size}: at most about {about_as_long(self.seconds)}"]

    def to_json(self) -> dict[str, object]:
        """The same for programs."""
        told = {name: value for name, value in asdict(self).items() if name != "steps"}
        return {**told, "seconds": round(self.seconds), "would_run": self.would_run}


def made_from(inputs: Sequence[Path], settings: SolveSettings) -> str:
    """A digest of what a drive is solved from: the footage, what goes with it, and the settings."""
    footage = [p for path in inputs for p in files_of(path)]
    beside: dict[str, object] = {}
    for name in ("labels", "masks", "segmenter", "gpx"):
        path = getattr(settings, name)
        own = [] if path is None else [path] if path.is_file() else sorted(path.rglob("*.png"))
        beside[name] = facts_of_files(own)  # by what they are, wherever they are named from
    asked = {k: v for k, v in asdict(settings).items() if k not in beside and k != "replace"}
    told = json.dumps([facts_of_files(footage), beside, asked], sort_keys=True, default=str)
    return hashlib.sha256(told.encode()).hexdigest()


def footage_marks(inputs: Sequence[Path]) -> list[str]:
    """Marks of the files of footage, by their names and sizes: footage that shares none with another is other footage, wherever it
    lies, and however it is solved."""
    return [mark_of(p, p.name) for path in inputs for p in files_of(path)]


def plan_solve(inputs: Sequence[Path], record: Path, settings: SolveSettings) -> SolvePlan:
    """Plan a solve.

    Args:
        inputs: clips or folders of photographs that are there; record: what an earlier solve found, if there is one.
    Raises:
        DriveError: footage that cannot be read.
    """
    counted = [_size_of(path) for path in inputs]
    frames = 0
    for count, _ in counted:
        part = range(count) if settings.frames is None else frame_numbers(settings.frames, count)
        frames += len(part[:: settings.every])
    if not frames:
        raise DriveError("has no frames in that part", path=inputs[0], mend="give --frames within the footage")
    width, height = counted[0][1]
    steps = seconds_by_step(frames, frames, (width, height), NEIGHBOURS * frames, settings.thorough)
    return SolvePlan(_why(inputs, record, settings), frames, width, height, steps)


def _why(inputs: Sequence[Path], record: Path, settings: SolveSettings) -> str:
    try:
        held: Any = read_own_json(record)
    except (OSError, ValueError):
        return "it has not run"
    if not isinstance(held, dict) or held.get("state") != "done":
        return "it was not finished"
    return "" if held.get("made_from") == made_from(inputs, settings) else "the footage or its settings have changed"


def _size_of(path: Path) -> tuple[int, tuple[int, int]]:
    """How many frames footage has, by what a clip notes of itself, and their width and height, pixels."""
    if is_clip(path):
        from unveil_core.solve.footage.video import noted_size

        return noted_size(path)
    from unveil_core.base.pictures.decoding import read_image

    pictures = pictures_in(path)
    if not pictures:
        raise DriveError("Not footage: the folder has no photographs", path=path, mend="give JPEG or PNG files")
    height, width = read_image(pictures[0]).shape[:2]
    return len(pictures), (width, height)
