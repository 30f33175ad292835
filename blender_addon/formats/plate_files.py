# SPDX-License-Identifier: GPL-3.0-or-later
"""Plates for compositing, as ``unveil export --to png,mattes`` leaves them in ``plates/`` of a workspace. No bpy here."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .drive_files import ImportedDrive, file_below, read_json

__all__ = ["FOLDER", "FORMATS", "OTHER", "Matte", "TrackPlates", "read_plates", "st_maps_of"]

FOLDER, FORMATS = "plates", ("png", "mattes")
"""Where in a workspace they are, and the formats of the export."""
OTHER = "other"
"""The matte of what has no number, and its name for people."""
MOST_OBJECTS = 65535
LONGEST_NAME = 200
"""Of a class, characters."""
MEND = "make the plates again"


@dataclass(frozen=True)
class Matte:
    """One removed object.

    Attributes:
        name: for people, as the list of objects has it: "car 5".
        key: of its files, "car_0005".
        files: one a picture of the track.
    """

    name: str
    key: str
    files: tuple[Path, ...]


@dataclass(frozen=True)
class TrackPlates:
    """The plates of one camera; each has one file a picture, of the size and lens of the footage.

    Attributes:
        clean: the clean frames.
        mattes: of what was removed, by object.
        provenance: where the pixels come from; empty where the workspace does not tell.
        certainty: how sure they are; likewise, and empty where plates are of an earlier version.
    """

    clean: tuple[Path, ...]
    mattes: tuple[Matte, ...]
    provenance: tuple[Path, ...]
    certainty: tuple[Path, ...]


def read_plates(drive: ImportedDrive) -> dict[str, TrackPlates]:
    """The plates of a workspace by track.

    Raises:
        ValueError: there are none, they are damaged, or not of these frames; one line that names the file.
    """
    folder = drive.workspace / FOLDER
    path = folder / "mattes" / "export.json"
    data = read_json(path)
    if data is None:
        raise ValueError(f"{path}: there are no plates yet ({MEND})")
    try:
        objects = [_object(entry) for entry in data["mattes"]]
        return {track: _track(folder, track, data, objects, drive) for track in drive.tracks}
    except KeyError as error:
        raise ValueError(f"{path}: Damaged: {error} is missing ({MEND})") from error
    except (TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"{path}: {error} ({MEND})") from error


def st_maps_of(drive: ImportedDrive, track: str) -> dict[str, Path]:
    """The lens of a track's footage as ST maps, "undistort" and "redistort"; none where it has no lens."""
    files = {name: drive.workspace / "st_maps" / track / f"{name}.exr" for name in ("undistort", "redistort")}
    return files if all(f.is_file() for f in files.values()) else {}


def _object(entry: Any) -> tuple[str, str]:
    """Name and key."""
    number, kind = entry["id"], entry["class"]
    if type(number) is not int or not 0 < number <= MOST_OBJECTS or not isinstance(kind, str):
        raise ValueError("a matte is of no object")
    return f"{kind[:LONGEST_NAME]} {number}", str(entry["name"])


def _track(
    folder: Path, track: str, data: dict[str, Any], objects: list[tuple[str, str]], drive: ImportedDrive
) -> TrackPlates:
    numbers = _numbers(data["cameras"], track, [f.name for f in drive.tracks[track]])

    def sequence(place: Path, stem: str) -> tuple[Path, ...]:
        files = tuple(file_below(place, f"{stem}.{number}.png") for number in numbers)
        missing = next((f for f in files if not f.is_file()), None)
        if missing is not None:
            raise ValueError(f"{missing.relative_to(folder)} is missing")
        return files

    # As the command names it: a camera may be called as the file that tells of the export.
    place = f"camera_{track}" if track.casefold() == "export.json" else track
    own = file_below(folder / "mattes", place)
    wanted = [*objects, *([(OTHER, OTHER)] if track in data["other"] else [])]
    mattes = tuple(Matte(name, key, sequence(file_below(own, key), key)) for name, key in wanted)
    provenance, certainty = (
        sequence(own / name, name) if (own / name).is_dir() else () for name in ("provenance", "certainty")
    )
    return TrackPlates(sequence(file_below(folder / "png", place), place), mattes, provenance, certainty)


def _numbers(cameras: Any, track: str, names: list[str]) -> list[str]:
    """Of the files, in the order of a track's frames."""
    told = cameras.get(track) or {}
    found = {str(entry["source"]): int(number) for number, entry in told.items()}
    if [name for name in found] != names:
        raise ValueError(f"is of other frames of {track} than the drive has")
    width = max(4, *(len(str(number)) for number in found.values()))
    return [f"{number:0{width}d}" for number in found.values()]
