"""Objects that a person marked, because no label knows them: boxes, or sequences of mattes.

A JSON list; each entry is ``{id, class, centre: [x, y, z], size: [length, width, height], yaw}`` in the drive's coordinates, or
``{id, class, mattes: FOLDER}`` with pictures of any size that are white where the imported photographs show the object.
"""

from __future__ import annotations

import os
from collections import Counter
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
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives.boxes import TrackedBox, read_boxes
from unveil_core.drives.drive import Drive, Frame

__all__ = ["MarkedObject", "files_named", "marked_objects", "matte", "read_marked"]

MEND = "an entry is a box {id, class, centre, size, yaw} or {id, class, mattes: FOLDER}"
MOST_FILES = 200_000
"""In a folder of mattes: five hours at ten frames a second; a disk has more."""
MOST_FOLDERS = 500
"""In it: one a camera is usual."""
PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")


@dataclass(frozen=True)
class MarkedObject:
    """One marked object.

    Attributes:
        id: 1 to 65535, unlike all others of the drive.
        class_name: what the person calls it.
        box: in the drive's coordinates, or None.
        mattes: folder of pictures, or None.
    """

    id: int
    class_name: str
    box: TrackedBox | None = None
    mattes: Path | None = None


def read_marked(path: Path) -> tuple[MarkedObject, ...]:
    """The checked objects of a file; folders are relative to it.

    Raises:
        DriveError: no such file, not a list, an entry that is neither a box nor mattes, or an id used twice.
    """
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


def _entry(i: int, entry: Any, path: Path) -> MarkedObject:
    if not isinstance(entry, dict):
        raise DriveError(f"entry {i} is no object", path=path, mend=MEND)
    if "mattes" not in entry:
        (box,) = read_boxes([{"class": "object", **entry}], path, str(i))
        return MarkedObject(box.id, box.class_name, box=box)
    number, folder = entry.get("id"), named_path(path.parent, entry["mattes"], path, f"mattes of entry {i}")
    if isinstance(number, bool) or not isinstance(number, int) or not 0 < number < 65536:
        raise DriveError(f"entry {i}: id {number!r} is no number from 1 to 65535", path=path, mend=MEND)
    if not files_named(folder):
        raise DriveError("holds no pictures to take as mattes", path=folder, mend="name a folder of PNG files")
    return MarkedObject(number, str(entry.get("class", "object")), mattes=folder)


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


def matte(folder: Path, drive: Drive, frame: Frame) -> NDArray[np.bool_] | None:
    """(H, W) where the matte of a frame is white, None where it has none.

    A matte belongs to the frame of its name, ``CAMERA/FRAME.png`` or ``FRAME.png``; where no name fits and there are as many
    files as the drive has frames, to the frame of its place.

    Raises:
        DriveError: it cannot be read.
    """
    files = files_named(folder)
    own = {p.stem: p for p in files if p.parent == folder}
    own |= {p.stem: p for p in files if p.parent == folder / frame.camera_name}
    path = own.get(frame.name)
    stems = {f.name for f in drive.frames}
    if path is None and len(files) == len(drive.frames) and not any(p.stem in stems for p in files):
        path = files[drive.frames.index(frame)]
    if path is None:
        return None
    picture = read_image(path).max(axis=2)
    size = (frame.camera.width, frame.camera.height)
    if picture.shape != size[::-1]:
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    white: NDArray[np.bool_] = picture > 127
    return white
