"""Whole drives of all formats, of which one file at a time is changed; slower, so with fewer inputs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.drives.formats.street.all_formats import WRITERS
from tests.drives.formats.street.street import tiny_street
from tests.fuzz.reader import Opened, Reader
from tests.fuzz.sound import sound_drive, sound_names, sound_points
from unveil_core.drives import open_drive

__all__ = ["READERS"]

SLOW = ("Waymo Open v2",)
"""Its range images take a second to read: they are left out, the tables are opened."""


def _prepare(kind: str) -> Callable[[Path], Opened]:
    def prepare(folder: Path) -> Opened:
        folder.mkdir(parents=True)
        path = WRITERS[kind](folder, tiny_street(2))

        def read(_: Path) -> None:
            drive = sound_drive(open_drive(path))
            sound_names(drive)
            for frame in drive.frames[:1]:
                for late in (frame.labels, frame.image_bytes):
                    if late is not None:
                        late()
            for sweep in drive.sweeps[: 0 if kind in SLOW else 1]:
                sound_points(sweep.read())

        return Opened(tuple(sorted(p for p in folder.rglob("*") if p.is_file())), read)

    return prepare


READERS = tuple(Reader(f"drive: {kind}", "drive", _prepare(kind)) for kind in WRITERS)
