# SPDX-License-Identifier: GPL-3.0-or-later
"""Open a workspace, or find it again where it was moved to."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, StringProperty

from ..formats.object_files import recorded_drive, recorded_settings
from ..scene import blocks
from ..scene.settings import ON_TYPED
from ..worker.run_arguments import adopt, other_drive
from .loading import loaded
from .saved.moved_workspace import follow

__all__: list[str] = []


class UNVEIL_OT_load_workspace(bpy.types.Operator):
    """Load the results of the workspace into the scene; what is there already is brought up to date"""

    bl_idname = "unveil.load_workspace"
    bl_label = "Open Results"
    bl_options = {"REGISTER", "UNDO"}

    directory: StringProperty(
        name="Results Folder", subtype="DIR_PATH", description="Empty: the scene's", options={"SKIP_SAVE"}
    )
    ask: BoolProperty(default=False, options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.ask:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def _adopt(self, settings: Any, workspace: Path) -> None:
        """What it was made with is what a run goes on with: otherwise all of it would be stale."""
        with suppress(ValueError):  # a damaged file is told of below
            adopt(settings, recorded_settings(workspace))

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.unveil
        place = self.directory or settings.workspace
        if not place:
            self.report({"ERROR"}, "No results yet: import a drive, or choose a results folder")
            return {"CANCELLED"}
        if not (blocks.absolute(place) / "workspace.json").is_file():
            self.report(
                {"ERROR"}, f"{blocks.absolute(place)}: Not a results folder (choose the one that holds workspace.json)"
            )
            return {"CANCELLED"}
        if self.directory:
            settings.workspace = str(blocks.absolute(place))
            self._adopt(settings, blocks.absolute(place))
        if not loaded(self, context, settings.workspace):
            return {"CANCELLED"}
        try:
            drive = recorded_drive(blocks.absolute(place))
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if Path(drive).is_absolute() and (Path(drive).exists() or not settings.drive):
            settings.drive = drive
        return {"FINISHED"}


class UNVEIL_OT_find_workspace(bpy.types.Operator):
    """Choose the folder that the workspace was moved to; pictures, strips and lists are found there again"""

    bl_idname = "unveil.find_workspace"
    bl_label = "Find Results…"
    bl_options = {"REGISTER", "UNDO"}

    directory: StringProperty(name="Results Folder", subtype="DIR_PATH", options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.unveil.workspace:
            cls.poll_message_set("No results folder is named yet")
        return bool(context.scene.unveil.workspace)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        new = blocks.absolute(self.directory)
        if not (new / "workspace.json").is_file():
            self.report({"ERROR"}, f"{new}: Not a results folder (choose the one that holds workspace.json)")
            return {"CANCELLED"}
        follow(context.scene, blocks.absolute(context.scene.unveil.workspace), new)
        return {"FINISHED"}


def _typed(settings: Any) -> None:
    """A folder named by hand that holds results of this drive: a run goes on with what they were made with."""
    place = blocks.absolute(settings.workspace)
    try:
        known, made = recorded_drive(place), recorded_settings(place)
    except (OSError, ValueError):
        return  # told when it is opened
    if not known or (settings.drive and other_drive(blocks.absolute(settings.drive), known)):
        return
    adopt(settings, made)
    settings.drive = settings.drive or known


CLASSES = (UNVEIL_OT_load_workspace, UNVEIL_OT_find_workspace)


def register() -> None:
    ON_TYPED.append(_typed)


def unregister() -> None:
    ON_TYPED.remove(_typed)
