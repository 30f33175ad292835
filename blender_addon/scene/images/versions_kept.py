# SPDX-License-Identifier: GPL-3.0-or-later
"""Versions of a result: copies of its clean frames in ``blender/versions/`` of the workspace, to compare later ones with."""

from __future__ import annotations

import re
from pathlib import Path

import bpy

from ...formats import sequences
from ...formats.drive_files import ImportedDrive
from ...formats.files import copied, own_folder
from ...formats.timeline import Timeline
from . import plates

__all__ = ["FOLDERS", "KEPT", "keep", "numbers_in", "show"]

FOLDERS = ("blender", "versions")
KEPT, SHOWN = "unveil_versions", "unveil_version"
"""Custom properties of a drive's collection: the numbers of the versions that are kept, and of the one that is shown."""
NUMBER = re.compile(r"[1-9]\d{0,3}")


def numbers_in(workspace: Path) -> list[int]:
    """The versions that a workspace keeps, in order."""
    folder = workspace.joinpath(*FOLDERS)
    if folder.is_symlink() or not folder.is_dir():
        return []
    return sorted(int(p.name) for p in folder.iterdir() if NUMBER.fullmatch(p.name) and p.is_dir())


def keep(drive: ImportedDrive, cameras: list[bpy.types.Object]) -> int:
    """Copy the clean frames behind the cameras; returns the new version's number.

    Raises:
        OSError: a copy cannot be made. ValueError: there are no clean frames; one line.
    """
    found = {str(c["unveil_track"]): plates.files_of(c, "clean") for c in cameras}
    if not any(found.values()):
        raise ValueError(f"{drive.workspace}: has no clean frames yet (run Unveil first)")
    number = max(numbers_in(drive.workspace), default=0) + 1
    for track, files in found.items():
        folder = own_folder(drive.workspace, *FOLDERS, str(number), track)
        for i, file in enumerate(files):
            copied(Path(file), folder / f"{i:06d}{Path(file).suffix.lower()}")
    return number


def show(
    collection: bpy.types.Collection,
    mark: str,
    cameras: list[bpy.types.Object],
    drive: ImportedDrive,
    timeline: Timeline,
    number: int,
) -> None:
    """Put a version behind the cameras, as the kind of plate ``kept``.

    Raises:
        ValueError: the workspace keeps no such version; one line.
    """
    for camera in cameras:
        track = str(camera["unveil_track"])
        files = sorted(drive.workspace.joinpath(*FOLDERS, str(number), track).glob("[0-9]*.png"))
        if not files:
            raise ValueError(f"{drive.workspace}: keeps no version {number} (keep one first)")
        pictures = sequences.PictureSequence(tuple(files), 0)
        plates.set_plate(camera, mark, "kept", pictures, timeline.first(track))
    collection[SHOWN] = number
    collection[KEPT] = numbers_in(drive.workspace)
