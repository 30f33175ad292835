# SPDX-License-Identifier: GPL-3.0-or-later
"""Import a drive, or the workspace of one, by menu, sidebar or script."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..choice import selection
from ..formats.object_files import recorded_drive
from ..scene import blocks, versions
from ..scene.settings import CAMERAS, SET_UP_SCENE, START_FRAME
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
        name="Workspace",
        subtype="DIR_PATH",
        description="Empty: the scene's, or beside the drive",
        options={"SKIP_SAVE", "HIDDEN"},
    )
    replace: BoolProperty(
        name="Replace results of another drive",
        description="Where the workspace has results of another drive, have them replaced by this one's",
        default=False,
        options={"SKIP_SAVE", "HIDDEN"},
    )
    asked: BoolProperty(default=False, options={"SKIP_SAVE", "HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        other = "" if self.replace or not versions.has_window() else self._other_drive(context)
        if not other:
            return super().invoke(context, event)
        self.replace = self.asked = True
        message = f"The workspace has results of {other}. They are replaced, stage by stage."
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
                raise UserError(f"{drive}: there is no such drive")
            if not settings.drive or blocks.absolute(settings.drive) != drive:
                settings.workspace = ""
            settings.drive = str(drive)
        if not settings.drive:
            raise UserError("There is no drive yet: choose a transforms.json or the folder of a drive")
        drive = blocks.absolute(settings.drive)
        if not drive.exists():
            raise UserError(f"{drive}: there is no such drive")
        if self.workspace:
            settings.workspace = self.workspace
        if not settings.workspace:
            settings.workspace = str(default_workspace(drive, bpy.data.filepath))
        place = blocks.absolute(settings.workspace)
        options = [
            *settings_arguments(settings, bpy.path.abspath),
            *selection_arguments(selection.arguments(context.scene)),
        ]
        return ["import", str(drive), "-o", str(place), *options, *["--replace"] * self.replace]

    def task(self, context: bpy.types.Context) -> Task:
        return replace(super().task(context), load=load)


class UNVEIL_OT_open_drive(bpy.types.Operator, ImportHelper):
    """Import a street drive: a transforms.json, or the folder of any drive that unveil knows"""

    bl_idname = "unveil.open_drive"
    bl_label = "Import Street Drive"

    filename_ext = ""
    filter_glob: StringProperty(default="*.json;*.bin;*.txt", options={"HIDDEN"})
    workspace: StringProperty(
        name="Workspace", subtype="DIR_PATH", description="Folder of the results; empty: beside the drive"
    )
    set_up_scene: BoolProperty(**SET_UP_SCENE)
    start_frame: IntProperty(**START_FRAME)
    every_nth: IntProperty(
        name="Every Nth frame", default=1, min=1, soft_max=20, description="1: all frames of the drive"
    )
    cameras: StringProperty(**CAMERAS)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(bpy.ops.unveil.import_drive.poll())

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        settings = context.scene.unveil
        self.set_up_scene, self.start_frame = settings.set_up_scene, settings.start_frame
        if self.properties.is_property_set("filepath"):  # dropped onto the window
            manager = context.window_manager
            return manager.invoke_props_dialog(self, width=420, title=self.bl_label, confirm_text="Import")
        return super().invoke(context, event)

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split, layout.use_property_decorate = True, False
        for name in ("set_up_scene", "start_frame", "every_nth", "cameras", "workspace"):
            layout.prop(self, name)

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings, given = context.scene.unveil, self.properties.is_property_set
        for name in ("set_up_scene", "start_frame", "cameras"):
            if given(name):
                setattr(settings, name, getattr(self, name))
        if given("every_nth"):
            settings.frames = "" if self.every_nth == 1 else f"::{self.every_nth}"
        path = _drive_of(blocks.absolute(self.filepath))
        begun = bpy.ops.unveil.import_drive("INVOKE_DEFAULT", filepath=str(path), workspace=self.workspace)
        return {"CANCELLED"} if "CANCELLED" in begun else {"FINISHED"}  # it may be asking something


class UNVEIL_FH_drive(bpy.types.FileHandler):
    """A drive's file dropped onto a 3D view"""

    bl_idname = "UNVEIL_FH_drive"
    bl_label = "Street drive (Unveil)"
    bl_import_operator = "unveil.open_drive"
    bl_file_extensions = ".json;.bin"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D"


def _drive_of(path: Path) -> Path:
    """What to import for what was picked: a transforms file itself, else the folder it lies in."""
    if not path.is_file() or (path.suffix.lower() == ".json" and path.name != "cameras.json"):
        return path
    folder = path.parent  # of a COLMAP model, or of a workspace's drive
    if folder.parent.name == "sparse":
        folder = folder.parent
    return folder.parent if folder.name == "sparse" else folder


def _menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.operator(UNVEIL_OT_open_drive.bl_idname, text="Street drive (Unveil)")


CLASSES = (UNVEIL_OT_import_drive, UNVEIL_OT_open_drive, UNVEIL_FH_drive)


def register() -> None:
    bpy.types.TOPBAR_MT_file_import.append(_menu)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_import.remove(_menu)
