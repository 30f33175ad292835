"""Objects that a person marked, because no label knows them: boxes, or sequences of mattes.

A JSON list; each entry is ``{id, class, centre: [x, y, z], size: [length, width, height], yaw}`` in the drive's coordinates, or
``{id, class, mattes: FOLDER, shows, of, moves}`` with pictures of any size that are white (``shows: "black"``: black) where the
imported photographs (``of: "footage"``: the footage, in its lens) show the object.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.named_paths import named_path
from unveil_core.base.checks.numbers_in_names import natural_key
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json
from unveil_core.base.output.stamps import mark_of
from unveil_core.base.output.written import record_of
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives.boxes import TrackedBox, read_boxes
from unveil_core.drives.checks.solved import check_whole
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.importing.frames import at_work_size

__all__ = [
    "CLICKS",
    "SHOWS",
    "MarkedObject",
    "file_of_frame",
    "files_named",
    "marks_of_footage",
    "told_of_footage",
    "marked_ids",
    "marked_objects",
    "matte",
    "read_marked",
    "shown_part",
]

MEND = "an entry is a box {id, class, centre, size, yaw} or {id, class, mattes: FOLDER}"
SHOWS = ("white", "black")
"""Which part of a matte is the object."""
OF = ("photograph", "footage")
"""What a matte lies over: the undistorted photograph of an import, or the footage that it was made of."""
MOST_FILES = 200_000
"""In a folder of mattes: five hours at ten frames a second; a disk has more."""
MOST_FOLDERS = 500
"""In it: one a camera is usual."""
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")


CLICKS = "clicks.json"
"""Beside the list where ``unveil mask`` wrote it: what was said of the objects, and of which footage."""


@dataclass(frozen=True)
class MarkedObject:
    """One marked object.

    Attributes:
        id: 1 to 65535, unlike all others of the drive.
        class_name: what the person calls it.
        box: in the drive's coordinates, or None.
        mattes: folder of pictures, or None.
        shows: which part of them is the object, one of :data:`SHOWS`.
        of: what they lie over, one of :data:`OF`.
        moves: it is elsewhere in each frame, as its mattes show.
    """

    id: int
    class_name: str
    box: TrackedBox | None = None
    mattes: Path | None = None
    shows: str = "white"
    of: str = "photograph"
    moves: bool = False


def read_marked(path: Path) -> tuple[MarkedObject, ...]:
    """The checked objects of a file; folders are relative to it.

    Raises:
        DriveError: no such file, half exchanged with those beside it, not a list, an entry that is neither a box nor mattes, or
            an id used twice.
    """
    check_whole(path)
    entries = read_json(path)
    if not isinstance(entries, list):
        raise DriveError("holds no list of marked objects", path=path, mend=MEND)
    found = [_entry(i, entry, path) for i, entry in enumerate(entries)]
    twice = [number for number, times in Counter(m.id for m in found).items() if times > 1]
    if twice:
        raise DriveError(f"id {twice[0]} occurs twice", path=path, mend="an id stands for one object")
    return tuple(found)


def marked_objects(setting: str | None) -> tuple[MarkedObject, ...]:
    """Those of the file that a run's settings name; none where they name none."""
    return () if setting is None else read_marked(Path(setting))


def marks_of_footage(frames: Sequence[Frame]) -> list[str]:
    """A mark of the footage of each frame, see :func:`unveil_core.base.output.stamps.mark_of`."""
    return [mark_of(f.footage_path, f.name) for f in frames]


def told_of_footage(marked: Path, frames: Sequence[Frame]) -> tuple[str, ...]:
    """A line where the objects of a list were clicked in other footage than these frames are of: their names alone may agree."""
    held = record_of(marked.with_name(CLICKS)) or {}
    marks = held.get("footage")
    if not isinstance(marks, list) or not marks or set(marks) & set(marks_of_footage(frames)):
        return ()
    return (f"{marked.name}: its objects were clicked in other footage; look whether they lie right here",)


def marked_ids(setting: str | None) -> tuple[int, ...]:
    """The ids of :func:`marked_objects`: where nothing else labels a drive, all that is marked goes."""
    return tuple(m.id for m in marked_objects(setting))


def _entry(i: int, entry: Any, path: Path) -> MarkedObject:
    if not isinstance(entry, dict):
        raise DriveError(f"Not an object: entry {i}", path=path, mend=MEND)
    if "mattes" not in entry:
        (box,) = read_boxes([{"class": "object", **entry}], path, str(i))
        return MarkedObject(box.id, box.class_name, box=box)
    number, folder = entry.get("id"), named_path(path.parent, entry["mattes"], path, f"mattes of entry {i}")
    if isinstance(number, bool) or not isinstance(number, int) or not 0 < number < 65536:
        raise DriveError(f"Not an id from 1 to 65535: {number!r} in entry {i}", path=path, mend=MEND)
    if not files_named(folder):
        raise DriveError("holds no pictures to take as mattes", path=folder, mend="name a folder of PNG files")
    shows, of = (
        _one_of(entry.get(key, known[0]), known, f"entry {i}: {key}", path)
        for key, known in (("shows", SHOWS), ("of", OF))
    )
    return MarkedObject(
        number, str(entry.get("class", "object")), mattes=folder, shows=shows, of=of, moves=entry.get("moves") is True
    )


def _one_of(value: Any, known: Sequence[str], what: str, path: Path) -> str:
    if value not in known:
        raise DriveError(f"Not a known {what}: {value}", path=path, mend=f"use {' or '.join(known)}")
    return str(value)


def files_named(folder: Path) -> list[Path]:
    """The pictures in a folder and its sub-folders, in order: numbers in names count as numbers.

    Raises:
        DriveError: it holds more than mattes can be, as the root of a disk does.
    """
    found, held, inner = [], 0, 0
    # Not Path.rglob, which takes ten times as long: a folder that holds a whole disk is to be refused soon.
    for place, folders, files in os.walk(folder):
        held, inner = held + len(files), inner + len(folders)
        if held > MOST_FILES or inner > MOST_FOLDERS:
            problem = f"holds more than {MOST_FILES:,} files or {MOST_FOLDERS:,} folders"
            raise DriveError(problem, path=folder, mend="name a folder of mattes alone")
        found += [Path(place, n) for n in files if n.lower().endswith(PICTURES) and not n.startswith(".")]
    return sorted(found, key=lambda p: natural_key(p.as_posix()))


def matte(mark: MarkedObject, drive: Drive, frame: Frame) -> NDArray[np.bool_] | None:
    """(H, W) where a frame shows a marked object, by its matte; None where it has none.

    A matte belongs to the frame of its name, ``CAMERA/FRAME.png`` or ``FRAME.png``; where no name fits and there are as many
    files as the drive has frames, to the frame of its place.

    Args:
        mark: an object with mattes.
        drive: imported; frame: one of its frames.
    Raises:
        DriveError: it cannot be read.
    """
    assert mark.mattes is not None
    path = file_of_frame(files_named(mark.mattes), mark.mattes, drive, frame)
    if path is None:
        return None
    found = shown_part(read_image(path), mark.shows)
    if mark.of == "footage" and frame.footage is not None and frame.footage.distortion is not None:
        whole = frame.footage.camera
        levels = at_work_size(
            _resized(found, (whole.width, whole.height))[..., None].repeat(3, 2), frame.footage, frame.camera
        )
        return np.asarray(levels[..., 0] > 127)
    return np.asarray(_resized(found, (frame.camera.width, frame.camera.height)) > 127)


def file_of_frame(files: Sequence[Path], folder: Path, drive: Drive, frame: Frame) -> Path | None:
    """Of the pictures in a folder of mattes, as :func:`files_named` has them, that of a frame; None where it has none."""
    own = {p.stem: p for p in files if p.parent == folder}
    own |= {p.stem: p for p in files if p.parent == folder / frame.camera_name}
    path = own.get(frame.name)
    stems = {f.name for f in drive.frames}
    if path is None and len(files) == len(drive.frames) and not any(p.stem in stems for p in files):
        path = files[drive.frames.index(frame)]
    return path


def shown_part(picture: NDArray[np.uint8], shows: str) -> NDArray[np.uint8]:
    """(H, W) levels of a matte (H, W, 3), white where the object is."""
    levels: NDArray[np.uint8] = picture.max(axis=2)
    return levels if shows == "white" else (255 - levels).astype(np.uint8)


def _resized(levels: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    return (
        levels
        if levels.shape == size[::-1]
        else cv2.resize(levels, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    )
