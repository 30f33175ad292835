# SPDX-License-Identifier: GPL-3.0-or-later
"""Run Unveil: everything, or one stage; cancel; show the log."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
from bpy.props import EnumProperty

from ..choice import selection
from ..scene import blocks, drive_scene
from ..worker import workspace_state
from ..worker.job_state import duration
from ..worker.run_arguments import default_workspace, selection_arguments, settings_arguments
from ..worker.session import session
from .job import logs
from .job.job_operator import JobOperator, UserError
from .job.redrawing import redraw
from .job.task import Task
from .loading import load

__all__ = ["workspace_of"]

NEED_A_SELECTION = ("remove", "inpaint", "reoptimize", "deliver")
"""Stages that are of no use as long as nothing is chosen to go."""
SHOWN_EARLY = ("objects", "deliver", "mesh")
"""Stages of a run after which what it has made so far is loaded: the drive, the clean frames, the meshes."""
ASKED_AFTER_S = 60
"""Older work is not cancelled without a question: by then a slip of the hand costs more than an answer."""


def drive_of(scene: bpy.types.Scene) -> str:
    """The scene's drive, absolute.

    Raises:
        UserError: none is named.
    """
    if not scene.unveil.drive:
        raise UserError("No drive yet: import one first")
    return str(blocks.absolute(scene.unveil.drive))


def workspace_of(scene: bpy.types.Scene) -> Path | None:
    """The scene's workspace, absolute; None if none is named."""
    name = scene.unveil.workspace
    return blocks.absolute(name) if name else None


class UNVEIL_OT_run(JobOperator, bpy.types.Operator):
    """Remove the chosen objects from every frame and from the 3D scene; runs only the stages that are to do or stale"""

    bl_idname = "unveil.run"
    bl_label = "Unveil"

    def arguments(self, context: bpy.types.Context) -> list[str]:
        scene = context.scene
        drive = drive_of(scene)
        if problem := selection.problem(scene):
            raise UserError(problem)
        if not scene.unveil.workspace:
            scene.unveil.workspace = str(default_workspace(drive, bpy.data.filepath))
        settings = settings_arguments(scene.unveil, bpy.path.abspath)
        return [
            "run",
            drive,
            "-o",
            str(workspace_of(scene)),
            *settings,
            *selection_arguments(selection.arguments(scene)),
        ]

    def task(self, context: bpy.types.Context) -> Task:
        return replace(super().task(context), load=_show, shown_early=SHOWN_EARLY)


def _show(context: bpy.types.Context, workspace: str) -> None:
    """What was run for is what is shown, not what was tried before."""
    found = load(context, workspace)
    if "clean" in found and context.scene.unveil_view.background == "preview":
        context.scene.unveil_view.background = "clean"
    if "clean" in found and drive_scene.looks_through_camera(context):
        context.scene.unveil_view.shown = context.scene.unveil_view.shown - {"POINTS"}


class UNVEIL_OT_stage(JobOperator, bpy.types.Operator):
    """Run this stage alone, with the settings as they are now"""

    bl_idname = "unveil.stage"
    bl_label = "Run Stage"

    stage: EnumProperty(name="Stage", items=[(name, label, "") for name, label in workspace_state.STAGES.items()])

    def title(self) -> str:
        return workspace_state.STAGES[self.stage]

    def arguments(self, context: bpy.types.Context) -> list[str]:
        scene = context.scene
        workspace = workspace_of(scene)
        if workspace is None:
            raise UserError("No results yet: import a drive, or name a results folder")
        if self.stage in NEED_A_SELECTION and (problem := selection.problem(scene)):
            raise UserError(problem)
        chosen = selection_arguments(selection.arguments(scene))
        settings = [*settings_arguments(scene.unveil, bpy.path.abspath), *chosen]
        if self.stage == "import":
            return ["import", drive_of(scene), "-o", str(workspace), *settings]
        return [self.stage, str(workspace), *settings]

    def task(self, context: bpy.types.Context) -> Task:
        return replace(super().task(context), load=load)


class UNVEIL_OT_cancel(bpy.types.Operator):
    """End the work within two seconds; what is finished stays, and starting again goes on from there"""

    bl_idname = "unveil.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return session.busy

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        age = session.age_s
        if age < ASKED_AFTER_S:
            return self.execute(context)
        message = f"It has run for {duration(age)}. What its finished stages made stays."
        manager = context.window_manager
        return manager.invoke_confirm(
            self, event, title=f"End {session.title}?", message=message, confirm_text="End the work"
        )

    def execute(self, context: bpy.types.Context) -> set[str]:
        session.cancel()
        redraw(context)
        return {"FINISHED"}


class UNVEIL_OT_show_log(bpy.types.Operator):
    """Open the full log of the latest job in a text editor"""

    bl_idname = "unveil.show_log"
    bl_label = "Show Log"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return session.last is not None or logs.log_text() is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        text = logs.write_log(session.last) if session.last is not None else logs.log_text()
        if bpy.app.background or not context.window_manager.windows:
            return {"FINISHED"}
        area = next((a for a in context.screen.areas if a.type == "TEXT_EDITOR"), None)
        if area is None:
            bpy.ops.wm.window_new()
            area = context.window_manager.windows[-1].screen.areas[0]
            area.type = "TEXT_EDITOR"
        area.spaces.active.text = text
        return {"FINISHED"}


CLASSES = (UNVEIL_OT_run, UNVEIL_OT_stage, UNVEIL_OT_cancel, UNVEIL_OT_show_log)
