# SPDX-License-Identifier: GPL-3.0-or-later
"""Import a drive into its workspace, by sidebar or script; menus and dropped files ask first, see ``opening/``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from ..choice import selection
from ..formats.object_files import recorded_drive
from ..scene import blocks, versions
from ..worker.run_arguments import default_workspace, other_drive, selection_arguments, settings_arguments
from .job.job_operator import JobOperator, UserError
from .job.task import Task
from .loading import load

__all__: list[str] = []


class UNVEIL_OT_import_drive(JobOperator, bpy.types.Operator):
    """Import the drive into its workspace, and list the objects that could be removed"""

    bl_idname = "unveil.import_drive"
    bl_label = "Import Drive"

    filepath: StringProperty(
        name="Drive", subtype="FILE_PATH", description="Empty: the scene's", options={"SKIP_SAVE", "HIDDEN"}
    )
    workspace: StringProperty(
        name="Results Folder",
        subtype="DIR_PATH",
        description="Empty: the scene's, or beside the drive",
        options={"SKIP_SAVE", "HIDDEN"},
    )
    replace: BoolProperty(
        name="Replace results of another drive",
        description="Where the folder has results of another drive, have them replaced by this one's",
        default=False,
        options={"SKIP_SAVE", "HIDDEN"},
    )
    yes: BoolProperty(
        name="Import all the same",
        description="Go on where a check of the drive would ask",
        default=False,
        options={"SKIP_SAVE", "HIDDEN"},
    )
    asked: BoolProperty(default=False, options={"SKIP_SAVE", "HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        other = "" if self.replace or not versions.has_window() else self._other_drive(context)
        if not other:
            return super().invoke(context, event)
        self.replace = self.asked = True
        message = f"The results folder has results of {other}. They are replaced, stage by stage."
        manager = context.window_manager
        return manager.invoke_confirm(
            self, event, title="Import another drive?", message=message, confirm_text="Replace results", icon="WARNING"
        )

    def execute(self, context: bpy.types.Context) -> set[str]:
        # Who has answered a question does not wait in a window that stands still.
        return self.start_following(context) if self.asked else super().execute(context)

    def _other_drive(self, context: bpy.types.Context) -> str:
        """The drive that the workspace has results of, where it is another one; empty where there is nothing to ask."""
        try:
            _, drive, _, workspace, *_ = self.arguments(context)
            return other_drive(drive, recorded_drive(Path(workspace)))
        except (UserError, OSError, ValueError):
            return ""  # told when the job is begun

    def arguments(self, context: bpy.types.Context) -> list[str]:
        settings = context.scene.unveil
        if self.filepath:
            drive = blocks.absolute(self.filepath)
            if not drive.exists():
                raise UserError(f"{drive}: Not found")
            if not settings.drive or blocks.absolute(settings.drive) != drive:
                settings.workspace = ""
            settings.drive = str(drive)
        if not settings.drive:
            raise UserError("No drive yet: choose a transforms.json or the folder of a drive")
        drive = blocks.absolute(settings.drive)
        if not drive.exists():
            raise UserError(f"{drive}: Not found")
        if self.workspace:
            settings.workspace = self.workspace
        if not settings.workspace:
            settings.workspace = str(default_workspace(drive, bpy.data.filepath))
        place = blocks.absolute(settings.workspace)
        options = [
            *settings_arguments(settings, bpy.path.abspath),
            *selection_arguments(selection.arguments(context.scene)),
        ]
        return ["import", str(drive), "-o", str(place), *options, *["--replace"] * self.replace, *["--yes"] * self.yes]

    def task(self, context: bpy.types.Context) -> Task:
        return replace(super().task(context), load=load, names=True)


CLASSES = (UNVEIL_OT_import_drive,)
