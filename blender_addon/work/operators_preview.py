# SPDX-License-Identifier: GPL-3.0-or-later
"""Try before you wait: a few frames at draft quality, in a workspace of their own within the workspace."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy

from ..choice import selection
from ..formats.drive_files import read_drive
from ..formats.timeline import timeline_of
from ..formats.windows import chosen_pictures, windows
from ..scene import cameras, view
from ..scene.images import preview
from ..worker.run_arguments import replaced, selection_arguments, settings_arguments
from .job.job_operator import JobOperator, UserError
from .job.task import Task
from .loading import load
from .operators_run import drive_of, workspace_of

__all__: list[str] = []


class UNVEIL_OT_preview(JobOperator, bpy.types.Operator):
    """Try this frame at draft quality, in a minute: a few frames before and after it are read, for what they see behind"""

    bl_idname = "unveil.preview"
    bl_label = "Preview"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if view.shown_drive(context.scene) is None:
            cls.poll_message_set("Import a drive first")
            return False
        return super().poll(context)

    def arguments(self, context: bpy.types.Context) -> list[str]:
        scene = context.scene
        if problem := selection.problem(scene):
            raise UserError(problem)
        root = workspace_of(scene)
        assert root is not None  # its drive is shown
        place = root / preview.FOLDER
        settings = settings_arguments(scene.unveil, bpy.path.abspath)
        chosen = selection_arguments(selection.preview_arguments(scene, place))
        own = replaced(settings, quality="draft", keyframes="auto", frames=_frames(scene, root))
        # Of whatever drive the preview before was: it is nobody's work.
        return ["run", drive_of(scene), "-o", str(place), "--replace", *own, *chosen, "--until", "reoptimize"]

    def task(self, context: bpy.types.Context) -> Task:
        return replace(super().task(context), load=_show)


def _frames(scene: bpy.types.Scene, root: Path) -> str:
    """Of the drive, as ``--frames`` takes them."""
    drive = read_drive(root)
    timeline = timeline_of(drive, scene.unveil.start_frame)
    track = max(drive.tracks, key=lambda name: len(drive.tracks[name]))  # in which frames are counted
    count = len(drive.tracks[track])
    try:
        named = [timeline.at(track, int(part)) for part in scene.unveil.preview_frames.split(",") if part.strip()]
    except ValueError as error:
        raise UserError(
            f"Preview frames {scene.unveil.preview_frames!r}: give numbers of frames, as 1004,1050"
        ) from error
    chosen = chosen_pictures(timeline.at(track, scene.frame_current), count, named)
    return windows(chosen, count, scene.unveil.frames)


def _show(context: bpy.types.Context, workspace: str) -> None:
    load(context, workspace)
    if cameras.track_of(context.scene.camera) is not None:
        shown = context.scene.unveil_view
        shown.background = "preview"
        shown.shown = set()  # points of what is removed would lie over it


CLASSES = (UNVEIL_OT_preview,)
