# SPDX-License-Identifier: GPL-3.0-or-later
"""Walks through the frames of a result, the most doubtful first."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty

from ...formats.drive_files import read_drive
from ...formats.figures.doubts import DoubtfulFrame, read_doubts
from ...formats.files import one_line
from ...formats.timeline import timeline_of
from ...scene import blocks, drive_scene, view

__all__ = ["was_looked_through"]

LOOKED, PLACE = "unveil_looked", "unveil_doubt"
"""Custom properties of a drive's collection: the figures that were walked through, and the place in the list."""


def was_looked_through(collection: bpy.types.Collection) -> bool:
    """Whether somebody has walked through the doubtful frames of what is loaded."""
    return LOOKED in collection and collection[LOOKED] == collection.get(view.FIGURES, "")


class UNVEIL_OT_next_doubtful(bpy.types.Operator):
    """Go to the next frame, by how much of it no frame has seen and was made up; the worst comes first"""

    bl_idname = "unveil.next_doubtful"
    bl_label = "Next Doubtful Frame"
    bl_options = {"REGISTER", "UNDO"}

    again: BoolProperty(name="From the Worst", description="Begin with the worst frame anew", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return view.has_results(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene, collection = context.scene, view.shown_drive(context.scene)
        assert collection is not None
        workspace = Path(blocks.workspace_of(collection))
        try:
            told = read_doubts(workspace)
            timeline = timeline_of(read_drive(workspace, drive_scene.metre_of(scene)), scene.unveil.start_frame)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, one_line(error, workspace))
            return {"CANCELLED"}
        collection[LOOKED] = collection.get(view.FIGURES, "")
        if not told.frames:
            self.report({"WARNING"}, "The results have no figures yet: run Unveil to its end")
            return {"CANCELLED"}
        known = [f for f in told.worst_first() if f.track in timeline.frames]
        if not known:
            self.report({"INFO"}, "Nothing was made up: every removed pixel is seen in another frame")
            return {"FINISHED"}
        place = 0 if self.again else int(collection.get(PLACE, -1)) + 1
        place %= len(known)
        collection[PLACE] = place
        self._go(scene, known[place], read_drive(workspace), timeline)
        share = known[place].doubt / max(known[place].removed, 1)
        self.report(
            {"INFO"},
            f"Frame {scene.frame_current} ({place + 1} of {len(known)}): {100 * share:.0f} % of what was removed is made up",
        )
        return {"FINISHED"}

    def _go(self, scene: bpy.types.Scene, frame: DoubtfulFrame, drive, timeline) -> None:  # type: ignore[no-untyped-def]
        names = [f.name for f in drive.tracks[frame.track]]
        if frame.name in names:
            scene.frame_set(timeline.frames[frame.track][names.index(frame.name)])
        bpy.ops.unveil.look_through(track=frame.track)
        scene.unveil_view.state = "AFTER"


CLASSES = (UNVEIL_OT_next_doubtful,)
