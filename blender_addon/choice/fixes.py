# SPDX-License-Identifier: GPL-3.0-or-later
"""Clean frames that the artist mends: copies that are painted over, and the file that tells a run of them."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, IntProperty, PointerProperty, StringProperty

from ..formats.drive_files import DriveFrame, ImportedDrive, file_name, read_drive
from ..formats.files import discard, own_folder, write_changed
from ..formats.object_files import read_fixes
from ..formats.open_safely import LARGEST_PICTURE, read_bytes
from ..formats.sequences import SIGNATURE
from ..formats.timeline import Timeline, timeline_of
from ..scene import blocks, cameras, view
from ..scene.images.painted_copies import copy_to_paint, has_unsaved, save_copy
from .painted_files import BEFORE, begin_copy, is_painted, leave

__all__ = ["FILE", "UnveilFix", "begin", "can_begin", "file_of", "forget", "restore", "write"]

FILE, FOLDER = "corrections.json", "corrections"


class UnveilFix(bpy.types.PropertyGroup):
    """One clean frame that was mended."""

    track: StringProperty()
    frame: StringProperty(description="Name of the frame")
    time: IntProperty(description="Frame of the timeline")
    image: PointerProperty(type=bpy.types.Image, description="The copy that is painted on")
    invent: BoolProperty(
        name="Fill In Again",
        description="What is painted over is a hole, and is filled in again; off: it looks as it was painted",
    )


def can_begin(scene: bpy.types.Scene) -> bool:
    """Whether the scene looks through a camera of its drive, and that has clean frames."""
    collection = view.shown_drive(scene)
    track = cameras.track_of(scene.camera)
    return collection is not None and track is not None and bool(collection.get("unveil_clean"))


def begin(scene: bpy.types.Scene) -> UnveilFix:
    """The copy of the clean frame that the scene's camera shows now; made where there is none.

    Raises:
        ValueError: the workspace is damaged, or the frame was not delivered; one line that names the file.
        OSError: the copy cannot be made.
    """
    drive = read_drive(Path(scene.unveil_selection.workspace))
    track = str(cameras.track_of(scene.camera))
    timeline = timeline_of(drive, scene.unveil.start_frame)
    frame = drive.tracks[track][timeline.at(track, scene.frame_current)]
    fixes = scene.unveil_selection.fixes
    known = next((f for f in fixes if (f.track, f.frame) == (track, frame.name) and f.image is not None), None)
    invent = known is not None and known.invent
    folder = own_folder(drive.workspace, FOLDER, track)
    # An undo step, or a .blend that was not saved, may have lost what was painted from the list.
    if (known is not None and has_unsaved(known.image)) or is_painted(folder, frame.name):
        return _listed(scene, drive, timeline, track, frame, invent=invent)
    delivered = drive.workspace / "frames" / track / f"{frame.name}.png"
    try:
        content = read_bytes(delivered, LARGEST_PICTURE)
    except FileNotFoundError:
        raise ValueError(f"{delivered}: Not made yet (run Unveil first)") from None
    if not content.startswith(SIGNATURE):
        raise ValueError(f"{delivered}: Not a PNG (run the stage Deliver again)")
    begin_copy(folder, frame.name, content, like=delivered)
    return _listed(scene, drive, timeline, track, frame, invent=invent)


def _listed(
    scene: bpy.types.Scene, drive: ImportedDrive, timeline: Timeline, track: str, frame: DriveFrame, *, invent: bool
) -> UnveilFix:
    path = drive.workspace / FOLDER / track / f"{frame.name}.png"
    collection = view.shown_drive(scene)
    mark = "" if collection is None else blocks.drive_of(collection)
    image = copy_to_paint(mark, f"fix:{track}:{frame.name}", path, f"Fix {track} {frame.name}")
    fixes = scene.unveil_selection.fixes
    fix = next((f for f in fixes if (f.track, f.frame) == (track, frame.name)), None) or fixes.add()
    order = [f.name for f in drive.tracks[track]].index(frame.name)
    fix.track, fix.frame, fix.time = track, frame.name, timeline.frames[track][order]
    fix.name = f"{track}, frame {fix.time}"
    fix.image, fix.invent = image, invent
    scene.unveil_selection.active_fix = list(fixes).index(fix)
    return fix


def forget(scene: bpy.types.Scene, index: int) -> None:
    """Take one out of the list and out of the file.

    Raises:
        OSError: the file cannot be written.
    """
    listed = scene.unveil_selection
    image, file = listed.fixes[index].image, Path(listed.workspace) / FILE
    fix = listed.fixes[index]
    leave(own_folder(Path(listed.workspace), FOLDER, file_name(fix.track)), file_name(fix.frame))
    listed.fixes.remove(index)
    listed.active_fix = min(listed.active_fix, max(len(listed.fixes) - 1, 0))
    blocks.remove(bpy.data.images, image)
    if not len(listed.fixes):
        discard(file)
    else:
        write(scene)


def file_of(scene: Any) -> str:
    """The file that tells a run of what was mended; empty where nothing was. Touches no disk."""
    listed = scene.unveil_selection
    if not listed.workspace or not len(listed.fixes):
        return str(listed.corrections_from)
    return str(Path(listed.workspace) / FILE)


def write(scene: Any) -> str:
    """Save what was painted, and write the file; empty where nothing was mended.

    Raises:
        OSError: it cannot be written.
        ValueError: an image cannot be saved; one line that names it.
    """
    path = file_of(scene)
    if not len(scene.unveil_selection.fixes):
        return path  # none, or a file of somebody
    entries = []
    for fix in scene.unveil_selection.fixes:
        if fix.image is not None and has_unsaved(fix.image):
            _save(fix, Path(scene.unveil_selection.workspace))
        image, over = (f"{FOLDER}/{fix.track}/{fix.frame}{end}.png" for end in ("", BEFORE))
        entry = {"camera": fix.track, "frame": fix.frame, "image": image, "over": over}
        entries.append({**entry, "invent": True} if fix.invent else entry)
    write_changed(Path(path), (json.dumps(entries, indent=1) + "\n").encode())
    return path


def _save(fix: UnveilFix, workspace: Path) -> None:
    """Save what was painted: into the copy alone, whatever file a .blend says that it is of, and through no link.

    Raises:
        OSError, ValueError: see :func:`write`.
    """
    folder, name = own_folder(workspace, FOLDER, file_name(fix.track)), f"{file_name(fix.frame)}.png"
    copy = blocks.absolute(fix.image.filepath)
    if os.path.realpath(copy) != os.path.join(os.path.realpath(folder), name):
        raise ValueError(f"{copy}: Not the copy that is painted on (save it by hand as {folder / name})")
    save_copy(fix.image, copy)


def restore(scene: bpy.types.Scene, drive: ImportedDrive) -> None:
    """List what was mended in a workspace; what is listed already stays.

    Raises:
        ValueError: its file is damaged; one line that names it.
    """
    timeline = timeline_of(drive, scene.unveil.start_frame)
    known = {(f.track, f.frame) for f in scene.unveil_selection.fixes}
    for told in read_fixes(drive):
        frame = next((f for f in drive.tracks.get(told.camera, ()) if f.name == told.frame), None)
        copy = drive.workspace / FOLDER / told.camera / f"{told.frame}.png"
        if frame is not None and (told.camera, told.frame) not in known and copy.is_file():
            _listed(scene, drive, timeline, told.camera, frame, invent=told.invent)


CLASSES = (UnveilFix,)
