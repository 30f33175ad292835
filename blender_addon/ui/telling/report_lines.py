# SPDX-License-Identifier: GPL-3.0-or-later
"""What a run has made, in a few lines of a name and a value."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...choice import selection
from ...formats.drive_files import read_drive
from ...formats.figures.doubts import DoubtfulFrame, read_doubts
from ...formats.files import one_line
from ...formats.timeline import timeline_of
from ...scene import blocks, drive_scene
from ...worker.job_state import duration
from ...worker.session import session

__all__ = ["lines_of", "page_of", "what_goes"]

MOST_ROWS = 30
"""Of the table: more would not fit on a screen."""


def page_of(scene: bpy.types.Scene) -> Path:
    """The report page of the scene's results."""
    return blocks.absolute(scene.unveil.workspace) / "report" / "index.html"


def lines_of(context: bpy.types.Context) -> list[tuple[str, str]]:
    """Name and value of each line; what a workspace does not tell is left out."""
    scene, state = context.scene, session.last
    found: list[tuple[str, str]] = []
    if state is not None and not session.busy:
        found.append(("Status", state.error or state.status.capitalize()))
        found.append(("Time", duration(session.took_s)))
    if selection.current(scene):
        gone = [o for o in scene.unveil_selection.objects if o.chosen or o.moves]
        found.append(("Removed", f"{len(gone)} of {len(scene.unveil_selection.objects)} objects"))
    if scene.unveil.workspace:
        workspace = blocks.absolute(scene.unveil.workspace)
        try:
            told = read_doubts(workspace)
        except (OSError, ValueError) as error:
            return [*found, ("Figures", one_line(error, workspace))]
        if told.frames:
            found.append(("Frames", str(len(told.frames))))
        if told.removed is not None:
            found.append(("Removed Pixels", f"{100 * told.removed:.1f} % of the frames"))
        if told.seen is not None:
            found.append(("Seen in Other Frames", f"{100 * told.seen:.0f} % of them"))
            found.append(("Made Up", f"{100 * (1 - told.seen):.0f} % of them"))
        if told.frames:
            found.append(("Most Doubtful", _frames(scene, workspace, told.worst_first()[:3])))
        found.append(("Results", str(workspace)))
    return found


def _frames(scene: bpy.types.Scene, workspace: Path, frames: list[DoubtfulFrame]) -> str:
    """Frames by the numbers of the timeline, with their cameras where there are several."""
    try:
        drive = read_drive(workspace)
    except (OSError, ValueError):
        return ", ".join(f.name for f in frames)
    timeline, found = timeline_of(drive, scene.unveil.start_frame), []
    for frame in frames:
        names = [f.name for f in drive.tracks.get(frame.track, ())]
        if frame.name in names:
            camera = f" ({frame.track})" if len(drive.tracks) > 1 else ""
            found.append(f"{timeline.frames[frame.track][names.index(frame.name)]}{camera}")
    return ", ".join(found)


def what_goes(scene: bpy.types.Scene) -> list[tuple[str, str, str, str]]:
    """A heading, and a row for each object that will be removed: name, longest side, distance, frames; the nearest first."""
    listed, metre = scene.unveil_selection, drive_scene.metre_of(scene)
    goes = [o for o in listed.objects if o.moves or (o.chosen and selection.stands(o))]
    goes.sort(key=lambda o: (o.distance < 0, o.distance, o.number))
    found = [("Object", "Size", "Nearest", "Frames")]
    for thing in goes[:MOST_ROWS]:
        box = selection.box_of(thing)
        found.append(
            (
                thing.name,
                f"{max(box.size) / metre:.1f} m" if box is not None else "",
                f"{thing.distance:.0f} m" if thing.distance >= 0 else "",
                str(thing.frames or ""),
            )
        )
    found += [(f"Every {c.name}", "", "", "") for c in listed.classes if c.alone and not c.objects]
    if len(goes) > MOST_ROWS:
        found.append((f"And {len(goes) - MOST_ROWS} more", "", "", ""))
    return found
