"""What was said of the objects of a folder, and what was written of them: so that more clicks add, and what a person painted stays.

marked.json                          the objects, as a run reads them: ``--marked``
mattes/NAME/CAMERA/FRAME.png         white where the footage shows the object; may be painted over
given/NAME/CAMERA/FRAME_stroke.png   what was drawn
clicks.json                          this record
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from unveil_core.base.errors import SettingsError
from unveil_core.base.files import read_own_json, write_json_atomic
from unveil_core.base.output.own_folder import OwnFolder
from unveil_core.base.output.stamps import is_unchanged
from unveil_core.base.output.written import GENERATOR, is_ours
from unveil_core.drives.drive import Frame
from unveil_core.drives.marked import CLICKS

__all__ = [
    "MARKED",
    "OfFrame",
    "Recorded",
    "edited",
    "key_of",
    "matte_name",
    "read_record",
    "write_record",
]

MARKED = "marked.json"
FIRST_NUMBER = 1001
"""Ids of marked objects begin here, where few drives have ids of their own."""


@dataclass
class OfFrame:
    """What was said of an object in one frame.

    Attributes:
        inside, outside: clicks (x, y) on it and beside it, pixels of the footage from its outer corner.
        stroke, matte: names of pictures in the folder, of part of it and of all of it; None where there is none.
    """

    inside: list[tuple[float, float]] = field(default_factory=list)
    outside: list[tuple[float, float]] = field(default_factory=list)
    stroke: str | None = None
    matte: str | None = None


@dataclass
class Recorded:
    """One object of the folder.

    Attributes:
        name: what the person calls it; folder: of its mattes, in ``mattes/``.
        id: in ``marked.json``.
        frames: what was said, by ``CAMERA/FRAME``.
        moves: it was found by its motion.
    """

    name: str
    folder: str
    id: int
    frames: dict[str, OfFrame] = field(default_factory=dict)
    moves: bool = False


def key_of(frame: Frame) -> str:
    """``CAMERA/FRAME``, unique in a drive."""
    return f"{frame.camera_name}/{frame.name}"


def matte_name(thing: Recorded, key: str) -> str:
    """The file of an object's matte in the folder."""
    return f"mattes/{thing.folder}/{key}.png"


def edited(own: OwnFolder, thing: Recorded) -> list[str]:
    """Frames, as ``CAMERA/FRAME``, whose mattes were painted over since they were written, or are somebody's from the start."""
    folder = own.root / "mattes" / thing.folder
    files = sorted(folder.rglob("*.png")) if folder.is_dir() else []
    somebodys = [f for f in files if not is_unchanged(f, own.written.get(f.relative_to(own.root).as_posix()))]
    return [f.relative_to(folder).with_suffix("").as_posix() for f in somebodys]


def new_object(name: str, things: Iterable[Recorded], taken: Iterable[int]) -> Recorded:
    """An object of a name that none has, with an id that none has."""
    safe = "".join(c if c.isalnum() or c in "-_" else "_" for c in name)[:60] or "object"
    folders = {t.folder for t in things}
    folder = next(f for f in (safe, *(f"{safe}_{k}" for k in range(2, 10_000))) if f not in folders)
    return Recorded(name, folder, max([FIRST_NUMBER - 1, *taken, *(t.id for t in things)]) + 1)


def read_record(folder: Path) -> list[Recorded]:
    """The objects of a folder; none where it has no record.

    Raises:
        SettingsError: its clicks.json is damaged, or another program's.
    """
    path = folder / CLICKS
    if not path.is_file():
        return []
    try:
        content: Any = read_own_json(path)
        if not is_ours(content):
            raise ValueError("another program wrote it")
        return [_recorded(entry) for entry in content["objects"]]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise SettingsError(
            f"Not a record of clicks: {error}", path=path, mend="name another folder with -o"
        ) from error


def _recorded(entry: Any) -> Recorded:
    frames = {
        str(key): OfFrame(
            [(float(x), float(y)) for x, y in said["inside"]],
            [(float(x), float(y)) for x, y in said["outside"]],
            None if said["stroke"] is None else str(said["stroke"]),
            None if said["matte"] is None else str(said["matte"]),
        )
        for key, said in entry["frames"].items()
    }
    folder = str(entry["folder"])
    if not folder.replace("-", "_").replace("_", "a").isalnum():
        raise ValueError(f"not the name of a folder: {folder[:40]!r}")
    return Recorded(str(entry["name"]), folder, int(entry["id"]), frames, bool(entry["moves"]))


def write_record(folder: Path, things: list[Recorded], footage: list[str]) -> None:
    """Write ``clicks.json``, with marks of the footage, and ``marked.json``."""
    objects = [
        {
            "name": t.name,
            "folder": t.folder,
            "id": t.id,
            "frames": {key: vars(said) for key, said in t.frames.items()},
            "moves": t.moves,
        }
        for t in things
    ]
    write_json_atomic(folder / CLICKS, {"generator": GENERATOR, "footage": footage, "objects": objects})
    marked = [
        {
            "id": t.id,
            "class": t.name,
            "mattes": f"mattes/{t.folder}",
            "of": "footage",
            **({"moves": True} if t.moves else {}),
        }
        for t in things
    ]
    write_json_atomic(folder / MARKED, marked)
