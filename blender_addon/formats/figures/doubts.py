# SPDX-License-Identifier: GPL-3.0-or-later
"""How doubtful each frame of a workspace is: which share of it no frame has seen and was made up. No bpy here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..drive_files import file_name, read_json

__all__ = ["DoubtfulFrame", "Doubts", "read_doubts"]


@dataclass(frozen=True)
class DoubtfulFrame:
    """Attributes:
    track: its camera; name: file stem.
    doubt: pixels that were made up.
    removed: pixels that were removed.
    """

    track: str
    name: str
    doubt: int
    removed: int


@dataclass(frozen=True)
class Doubts:
    """Attributes:
    frames: in the order of the workspace; empty before its report was made.
    removed: share of all pixels that was removed; seen: share of these that other frames show. None where it is not told.
    """

    frames: tuple[DoubtfulFrame, ...]
    removed: float | None
    seen: float | None

    def worst_first(self) -> list[DoubtfulFrame]:
        """Frames with something made up, the most doubtful first."""
        return sorted((f for f in self.frames if f.doubt > 0), key=lambda f: (-f.doubt, f.track, f.name))


def read_doubts(workspace: Path) -> Doubts:
    """What ``metrics.json`` of a workspace tells; nothing where there is none.

    Raises:
        ValueError: it is damaged; one line that names it.
    """
    path = workspace / "metrics.json"
    data: Any = read_json(path)
    if data is None:
        return Doubts((), None, None)
    try:
        frames = tuple(_frame(entry) for entry in data.get("per_frame", ()))
        told = data.get("coverage") or {}
        return Doubts(frames, _share(told.get("removed")), _share(told.get("seen_elsewhere_of_removed")))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"{path}: Damaged: {error} (run the stage Report again)") from error


def _frame(entry: Any) -> DoubtfulFrame:
    doubt, removed = entry["unobserved_pixels"], entry["removed_pixels"]
    if not all(isinstance(v, int) and v >= 0 for v in (doubt, removed)):
        raise ValueError("a number of pixels is not a number")
    return DoubtfulFrame(file_name(str(entry["camera"])), file_name(str(entry["frame"])), doubt, removed)


def _share(value: Any) -> float | None:
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 1:
        raise ValueError(f"{value!r} is not a share from 0 to 1")
    return float(value)
