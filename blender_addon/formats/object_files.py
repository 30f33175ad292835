# SPDX-License-Identifier: GPL-3.0-or-later
"""What a workspace lists: its classes and objects, what was marked and chosen in it, and its keyframes. No bpy here.

A workspace may come from a stranger: what is handed to Blender has been looked at here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from .drive_files import FARTHEST, ImportedDrive, file_below, file_name, read_json

__all__ = [
    "Box",
    "Choice",
    "Fix",
    "ListedClass",
    "ListedObject",
    "Mark",
    "found_sun",
    "read_choice",
    "read_fixes",
    "read_keyframes",
    "read_listed",
    "read_marks",
    "read_moving",
    "read_source",
    "recorded_drive",
    "recorded_settings",
]

LARGEST = (1 << 31) - 1
"""Of the whole numbers that Blender's properties hold."""
SEMANTICS = "semantics"
LONGEST = 1000
"""Characters of a name."""
T = TypeVar("T")


@dataclass(frozen=True)
class Box:
    """A box as a file has it; ``yaw`` in radians from the first axis of its coordinates."""

    centre: tuple[float, ...]
    size: tuple[float, ...]
    yaw: float


@dataclass(frozen=True)
class ListedClass:
    """A class that occurs, with how many of it there are."""

    name: str
    removable: bool
    objects: int
    points: int
    pixels: int


@dataclass(frozen=True)
class ListedObject:
    """An object that was found.

    Attributes:
        source: "instance", "box", "mattes", …: by what it is known.
        box: in the coordinates of the workspace, its yaw from east; None where it has none.
        thumbnail: a file of the workspace; None where it has none.
        best_camera, best_frame: where it is seen best.
    """

    number: int
    source: str
    class_name: str
    frames: int
    points: int
    first_frame: str
    last_frame: str
    best_camera: str | None
    best_frame: str | None
    distance_m: float | None
    thumbnail: Path | None
    box: Box | None


@dataclass(frozen=True)
class Mark:
    """An object that somebody marked: by a box in the drive's own coordinates, or by a folder of mattes."""

    number: int
    class_name: str
    box: Box | None
    mattes: str


@dataclass(frozen=True)
class Fix:
    """A clean frame that was mended by hand; ``invent``: what was painted over is invented anew."""

    camera: str
    frame: str
    invent: bool


@dataclass(frozen=True)
class Choice:
    """What was chosen: ids of objects, and classes."""

    instances: frozenset[int] = frozenset()
    classes: frozenset[str] = frozenset()


def read_listed(drive: ImportedDrive) -> tuple[list[ListedClass], list[ListedObject]]:
    """``objects.json``; nothing where there is none.

    Raises:
        ValueError: it is damaged; one line that names it. So do all functions here.
    """

    def understood(data: Any) -> tuple[list[ListedClass], list[ListedObject]]:
        return [_class(e) for e in _list(data["classes"])], [_object(e, drive) for e in _list(data["objects"])]

    return _read(drive.workspace / "objects.json", understood, ([], []), "import the drive again")


def read_source(drive: ImportedDrive) -> str:
    """What labels were made of, by ``objects.json``."""

    def understood(data: Any) -> str:
        return _text(data.get("source", SEMANTICS))

    return _read(drive.workspace / "objects.json", understood, SEMANTICS, "import the drive again")


def read_moving(drive: ImportedDrive) -> set[int]:
    """Ids of the objects that move, by ``movers/movers.json``."""

    def understood(data: Any) -> set[int]:
        return {_whole(e["id"]) for e in _list(data) if e.get("id") is not None}

    return _read(drive.workspace / "movers" / "movers.json", understood, set(), "run the stage segment again")


def read_choice(workspace: Path) -> Choice:
    """``selection.json``, as the last run left it."""

    def understood(data: Any) -> Choice:
        instances = frozenset(_whole(i) for i in _list(data.get("instances", [])))
        return Choice(instances, frozenset(_text(c) for c in _list(data.get("removed", []))))

    return _read(workspace / "selection.json", understood, Choice(), "run the stage choose again")


def read_marks(drive: ImportedDrive, path: Path | None = None) -> list[Mark]:
    """``marked.json``, in its own order; of the workspace, or another file of the kind."""

    def understood(data: Any) -> list[Mark]:
        return [_mark(e, drive) for e in _list(data)]

    return _read(path or drive.workspace / "marked.json", understood, [], "mend it, or remove it to mark objects anew")


def read_fixes(drive: ImportedDrive) -> list[Fix]:
    """``corrections.json``, in its own order."""

    def understood(data: Any) -> list[Fix]:
        return [
            Fix(file_name(_text(e["camera"])), file_name(_text(e["frame"])), e.get("invent", False) is True)
            for e in _list(data)
        ]

    return _read(drive.workspace / "corrections.json", understood, [], "mend it, or remove it to paint anew")


def read_keyframes(workspace: Path) -> list[tuple[str, str]]:
    """Camera and frame of each keyframe, by ``inpaint/keyframes.json``."""

    def understood(data: Any) -> list[tuple[str, str]]:
        return [(_text(e["camera"]), _text(e["frame"])) for e in _list(data.get("keyframes", []))]

    return _read(workspace / "inpaint" / "keyframes.json", understood, [], "run the stage inpaint again")


def recorded_drive(workspace: Path) -> str:
    """Where the drive of a workspace was, by ``workspace.json``; "" where that does not say."""

    def understood(data: Any) -> str:
        return _text(data.get("drive", ""))

    return _read(workspace / "workspace.json", understood, "", "run it again")


def found_sun(workspace: Path) -> tuple[float, float] | None:
    """Azimuth, clockwise from the y axis, and elevation of the sun that a run went by, degrees; None where it found none."""

    def understood(data: Any) -> tuple[float, float] | None:
        sun = ((data.get("stages") or {}).get("inpaint") or {}).get("sun")
        return None if sun is None else (_number(sun["azimuth_deg"]), _number(sun["elevation_deg"]))

    return _read(workspace / "workspace.json", understood, None, "run it again")


def recorded_settings(workspace: Path) -> dict[str, Any]:
    """The settings that a workspace was last run with, by ``workspace.json``: any values, under any names."""

    def understood(data: Any) -> dict[str, Any]:
        found = data.get("settings") or {}
        if not isinstance(found, dict):
            raise TypeError("its settings are no object")
        return {str(name): value for name, value in found.items()}

    return _read(workspace / "workspace.json", understood, {}, "run it again")


def _read(path: Path, understood: Callable[[Any], T], nothing: T, mend: str) -> T:
    data = read_json(path)
    if data is None:
        return nothing
    try:
        return understood(data)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else error
        raise ValueError(f"{path}: Damaged: {what} ({mend})") from error


def _class(entry: Any) -> ListedClass:
    counts = (_whole(entry[key], least=0, most=1 << 62) for key in ("objects", "points", "pixels"))
    objects, points, pixels = (min(count, LARGEST) for count in counts)
    return ListedClass(_text(entry["name"]), bool(entry["removable"]), objects, points, pixels)


def _object(entry: Any, drive: ImportedDrive) -> ListedObject:
    distance, thumbnail, box = entry["distance_m"], entry["thumbnail"], entry["box"]
    return ListedObject(
        _whole(entry["id"]),
        _text(entry["source"]),
        _text(entry["class"]),
        _whole(entry["frames"], least=0),
        _whole(entry["points"], least=0),
        _text(entry["first_frame"] or ""),
        _text(entry["last_frame"] or ""),
        *(None if entry.get(key) is None else _text(entry[key]) for key in ("best_camera", "best_frame")),
        None if distance is None else _number(distance),
        file_below(drive.workspace, thumbnail) if thumbnail else None,
        None if box is None else _box(box),
    )


def _mark(entry: Any, drive: ImportedDrive) -> Mark:
    number, name = _whole(entry["id"]), _text(entry.get("class", "object"))
    if "mattes" in entry:
        return Mark(number, name, None, str(drive.workspace / _text(entry["mattes"])))
    return Mark(number, name, _box(entry), "")


def _box(entry: Any) -> Box:
    centre, size = (tuple(_number(v) for v in _list(entry[key])) for key in ("centre", "size"))
    if len(centre) != 3 or len(size) != 3 or min(size) < 0:
        raise ValueError("a box has no centre and size of three numbers")
    return Box(centre, size, _number(entry.get("yaw", 0.0)))


def _list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise TypeError(f"a list is expected, not {str(value)[:40]!r}")
    return value


def _text(value: Any) -> str:
    if not isinstance(value, str) or len(value) > LONGEST or "\0" in value:
        raise TypeError(f"text is expected, not {str(value)[:40]!r}")
    return value


def _whole(value: Any, *, least: int = -LARGEST, most: int = LARGEST) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise TypeError(f"a whole number is expected, not {str(value)[:40]!r}")
    return value


def _number(value: Any) -> float:
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not math.isfinite(value)
        or abs(value) > FARTHEST
    ):
        raise TypeError(f"a number is expected, not {str(value)[:40]!r}")
    return float(value)
