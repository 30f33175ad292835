# SPDX-License-Identifier: GPL-3.0-or-later
"""What a preview has made: its few clean frames behind the drive's cameras, and nothing where it made none."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...formats import sequences
from ...formats.drive_files import ImportedDrive, read_drive
from ...formats.files import own_folder, write_changed
from ...formats.timeline import Timeline
from . import plates

__all__ = ["FOLDER", "TRIED", "load"]

FOLDER = "preview"
"""Of the workspace: a workspace of its own."""
TRIED = "unveil_tried"
"""Frames of the timeline that a camera's preview shows."""


def load(camera: bpy.types.Object, mark: str, drive: ImportedDrive, timeline: Timeline) -> list[str]:
    """Put a preview's frames behind a track's camera; returns the kind where there are some.

    Raises:
        ValueError: a file is damaged; one line that names it.
        OSError: a copy cannot be made.
    """
    track, place = str(camera["unveil_track"]), drive.workspace / FOLDER
    folder = place / "clean" / track  # of working size: delivery at that of the footage would take as long again
    if not folder.is_dir():
        return []
    tried = {f.name for f in read_drive(place).tracks.get(track, ())}
    nothing = own_folder(drive.workspace, "blender", FOLDER) / "nothing.png"
    write_changed(nothing, sequences.transparent())
    files = [folder / f"{f.name}.png" for f in drive.tracks[track]]
    shown = [file if file.stem in tried and file.is_file() else nothing for file in files]
    if not any(file is not nothing for file in shown):
        return []
    frames = timeline.frames[track]
    whole: list[Path] = [nothing] * (frames[-1] - frames[0] + 1)
    for frame, file in zip(frames, shown, strict=True):
        whole[frame - frames[0]] = file
    camera[TRIED] = [frame for frame, file in zip(frames, shown, strict=True) if file is not nothing]
    pictures = sequences.numbered(whole, drive.workspace, "blender", FOLDER, track)
    plates.set_plate(camera, mark, "preview", pictures, timeline.first(track))
    return ["preview"]
