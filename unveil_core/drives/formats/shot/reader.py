"""Shots: a camera path of a matchmove or of photogrammetry beside plates, as a drive.

The path is a ``.chan`` or another file of columns, Metashape's XML or RealityScan's CSV. What it cannot tell of itself stands in
``shot.json`` beside it. Alembic, FBX and USD are read by Blender, see docs/shots.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from unveil_core.base.checks.named_paths import named_path
from unveil_core.base.errors import DriveError
from unveil_core.base.plates.files import plate_facts
from unveil_core.base.plates.library import PLATES
from unveil_core.drives.checks.conventions import pose_in
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.formats.cameras import picture_size
from unveil_core.drives.formats.on_disk.masks import with_masks_beside
from unveil_core.drives.formats.shot.columns import read_columns
from unveil_core.drives.formats.shot.described import FILE, Described, described
from unveil_core.drives.formats.shot.metashape import read_metashape
from unveil_core.drives.formats.shot.path import CameraPath
from unveil_core.drives.formats.shot.plates import (
    Matched,
    by_name,
    by_number,
    named_pictures,
    plates_beside,
    sequence_of,
)
from unveil_core.drives.formats.shot.points import read_shot_points
from unveil_core.drives.formats.shot.realityscan import read_realityscan
from unveil_core.drives.scale_and_up import UP_AXES
from unveil_core.geometry.camera import Camera

__all__ = ["read_shot", "recognizes"]

READERS: dict[str, Callable[[Path, Described], CameraPath]] = {
    ".chan": read_columns,
    ".txt": read_columns,
    ".xml": lambda path, _: read_metashape(path),
    ".csv": lambda path, _: read_realityscan(path),
}
"""By suffix."""
NAMES = ("cameras.xml", "cameras.csv", "camera.txt")
"""Paths that are known in a folder by their names, beside any .chan."""


def recognizes(path: Path) -> bool:
    """Whether a file is a camera path or a shot.json, or a folder holds one, with plates: exported cameras alone are no drive."""
    if path.is_file():
        name = path.name.lower()
        return path.suffix.lower() in (".chan", ".xml", ".csv") or name == FILE or name in NAMES
    held = _held(path)
    return bool(held) and (held[0].name.lower() == FILE or plates_beside(held[0]))


def _held(folder: Path) -> list[Path]:
    """What makes a folder a shot: its shot.json, else its camera paths."""
    found: list[Path] = []
    with suppress(OSError):
        files = sorted(p for p in folder.iterdir() if p.is_file())
        found = [p for p in files if p.name.lower() == FILE]
        found = found or [p for p in files if p.suffix.lower() == ".chan" or p.name.lower() in NAMES]
    return found


def read_shot(path: Path) -> Drive:
    """Read a shot: its camera path, or its shot.json, or the folder of one.

    Raises:
        DriveError: with the file and the mend.
    """
    root = path
    if path.is_dir():
        held = _held(path)
        if len(held) > 1:
            names = ", ".join(p.name for p in held[:4])
            raise DriveError(
                f"holds {len(held)} camera paths: {names}",
                path=path,
                mend='give one, or name it by "path" in shot.json',
            )
        path = held[0]
    beside = next((p for p in path.parent.iterdir() if p.name.lower() == FILE), None)
    said = Described() if beside is None else described(beside)
    if path.name.lower() == FILE:
        path = _named_path(path, said)
    found = READERS[path.suffix.lower()](path, said)
    matched = _matched(path, said, found)
    frames = _frames(found, matched, said, path)
    frames, masked = with_masks_beside(
        frames, path.parent, frames[0].image_path.parent, "a transforms.json with mask_path", usual=True
    )
    points, sources, told = read_shot_points(path, said)
    up = found.up if said.up is None else UP_AXES[said.up]
    units = found.units_per_metre if said.units_per_metre is None else said.units_per_metre
    return Drive(
        root=root,
        frames=tuple(frames),
        points=points,
        units_per_metre=units,
        scale_source="" if units is None else "metric" if said.units_per_metre is None else "given",
        up=up,
        sources=(path, *sources, *(() if said.source is None else (said.source,))),
        notices=(*found.notices, *matched.notices, *masked, *told),
        pose_convention=found.convention,
    )


def _named_path(file: Path, said: Described) -> Path:
    """The camera path that a shot.json names, or the only one beside it."""
    if said.path is not None:
        path = named_path(file.parent, said.path, file, "path")
        if not path.is_file() or path.suffix.lower() not in READERS:
            kinds = ", ".join(READERS)
            raise DriveError(f"names a camera path that is none: {said.path[:60]}", path=file, mend=f"give {kinds}")
        return path
    files = sorted(p for p in file.parent.iterdir() if p.is_file())
    paths = [p for p in files if p.suffix.lower() == ".chan" or p.name.lower() in NAMES]
    if len(paths) != 1:
        what = "no camera path" if not paths else f"{len(paths)} camera paths"
        raise DriveError(f"has {what} beside it", path=file, mend='name one by "path", as "path": "camera.chan"')
    return paths[0]


def _matched(path: Path, said: Described, found: CameraPath) -> Matched:
    if found.frames[0].name is not None:
        return by_name([f.name or "" for f in found.frames], named_pictures(path, said), path)
    return by_number([f.number or 0 for f in found.frames], sequence_of(path, said), said, path)


def _frames(found: CameraPath, matched: Matched, said: Described, path: Path) -> list[Frame]:
    sizes: dict[tuple[Path, str], tuple[tuple[int, int], float]] = {}
    frames = []
    for i, picture in sorted(matched.pictures.items()):
        entry = found.frames[i]
        kind = (picture.parent, picture.suffix)
        if kind not in sizes:
            sizes[kind] = _size_and_aspect(picture)
        lens = entry.lens(*sizes[kind])
        if not (
            np.isfinite((*lens.focal, *lens.centre)).all() and min(lens.focal) > 0 and np.isfinite(entry.pose).all()
        ):
            raise DriveError(f"frame {entry.number or entry.name} makes no camera", path=path, mend="export it again")
        camera = Camera(*lens.size, *lens.focal, *lens.centre, pose_in(entry.pose, found.convention))
        bent = lens.distortion
        frames.append(
            Frame(
                name=picture.stem,
                camera_name=entry.camera,
                camera=camera,
                image_path=picture,
                distortion=None if bent is None or bent.is_zero else bent,
                timestamp=_time(entry.number, said),
            )
        )
    return _with_own_names(frames)


def _size_and_aspect(picture: Path) -> tuple[tuple[int, int], float]:
    """Of plates, as their headers have it; pixels of other pictures are square."""
    if picture.suffix.lower() in PLATES:
        facts = plate_facts(picture)
        return facts.size, facts.pixel_aspect
    return picture_size(picture), 1.0


def _time(number: int | None, said: Described) -> float | None:
    return None if said.fps is None or number is None else number / said.fps


def _with_own_names(frames: Sequence[Frame]) -> list[Frame]:
    """Frames whose names are their own; by folder and name where pictures of several folders are called the same."""
    names = [(f.camera_name, f.name) for f in frames]
    if len(set(names)) == len(names):
        return list(frames)
    return [replace(f, name=f"{f.image_path.parent.name}_{f.name}") for f in frames]
