# SPDX-License-Identifier: GPL-3.0-or-later
"""Import a drive, or the workspace of one, by menu, sidebar or script."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ..choice import selection
from ..formats.object_files import recorded_drive
from ..worker.job_state import JobState
from ..worker.run_arguments import default_workspace, selection_arguments, settings_arguments
from .job_operator import JobOperator, UserError
from .loading import loaded

__all__: list[str] = []


class UNVEIL_OT_import_drive(JobOperator, bpy.types.Operator):
    """Bring the scene's drive into its workspace, and what could be removed into the lists"""

    bl_idname = "unveil.import_drive"
    bl_label = "Import drive"
    bl_options = {"REGISTER", "UNDO"}

    filepath: StringProperty(
        name="Drive", subtype="FILE_PATH", description="Empty: the scene's", options={"SKIP_SAVE", "HIDDEN"}
    )
    workspace: StringProperty(
        name="Workspace",
        subtype="DIR_PATH",
        description="Empty: the scene's, or beside the drive",
        options={"SKIP_SAVE", "HIDDEN"},
    )

    def arguments(self, context: bpy.types.Context) -> list[str]:
        settings = context.scene.unveil
        if self.filepath:
            drive = _absolute(self.filepath)
            if not drive.exists():
                raise UserError(f"{drive}: there is no such drive")
            if not settings.drive or _absolute(settings.drive) != drive:
                settings.workspace = ""
            settings.drive = str(drive)
        if not settings.drive:
            raise UserError("There is no drive yet: choose a transforms.json or the folder of a drive")
        drive = _absolute(settings.drive)
        if not drive.exists():
            raise UserError(f"{drive}: there is no such drive")
        if self.workspace:
            settings.workspace = self.workspace
        if not settings.workspace:
            settings.workspace = str(default_workspace(drive, bpy.data.filepath))
        place = _absolute(settings.workspace)
        options = [
            *settings_arguments(settings, bpy.path.abspath),
            *selection_arguments(selection.arguments(context.scene)),
        ]
        return ["import", str(drive), "-o", str(place), *options]

    def finished(self, context: bpy.types.Context, state: JobState) -> None:
        loaded(self, context, self.workspace_used)


def _absolute(path: str) -> Path:
    return Path(bpy.path.abspath(path)).absolute()


class UNVEIL_OT_open_drive(bpy.types.Operator, ImportHelper):
    """Import a street drive: a transforms.json, or the folder of any drive that unveil knows"""

    bl_idname = "unveil.open_drive"
    bl_label = "Import street drive"

    filename_ext = ""
    filter_glob: StringProperty(default="*.json;*.bin;*.txt", options={"HIDDEN"})
    workspace: StringProperty(
        name="Workspace", subtype="DIR_PATH", description="Folder of the results; empty: beside the drive"
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(bpy.ops.unveil.import_drive.poll())

    def execute(self, context: bpy.types.Context) -> set[str]:
        path = _drive_of(_absolute(self.filepath))
        return bpy.ops.unveil.import_drive("INVOKE_DEFAULT", filepath=str(path), workspace=self.workspace)


def _drive_of(path: Path) -> Path:
    """What to import for what was picked: a transforms file itself, else the folder it lies in."""
    if not path.is_file() or (path.suffix.lower() == ".json" and path.name != "cameras.json"):
        return path
    folder = path.parent  # of a COLMAP model, or of a workspace's drive
    if folder.parent.name == "sparse":
        folder = folder.parent
    return folder.parent if folder.name == "sparse" else folder


class UNVEIL_OT_load_workspace(bpy.types.Operator):
    """Bring what the workspace holds into the scene, or up to date where it is there"""

    bl_idname = "unveil.load_workspace"
    bl_label = "Load workspace"
    bl_options = {"REGISTER", "UNDO"}

    directory: StringProperty(
        name="Workspace", subtype="DIR_PATH", description="Empty: the scene's", options={"SKIP_SAVE"}
    )
    ask: BoolProperty(default=False, options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.ask:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.unveil
        place = self.directory or settings.workspace
        if not place:
            self.report({"ERROR"}, "There is no workspace yet: import a drive, or choose the folder of one")
            return {"CANCELLED"}
        if not (_absolute(place) / "workspace.json").is_file():
            self.report({"ERROR"}, f"{_absolute(place)}: is no workspace (choose the folder that holds workspace.json)")
            return {"CANCELLED"}
        settings.workspace = str(_absolute(place)) if self.directory else place
        if not loaded(self, context, settings.workspace):
            return {"CANCELLED"}
        try:
            drive = recorded_drive(_absolute(place))
        except ValueError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if Path(drive).is_absolute() and (Path(drive).exists() or not settings.drive):
            settings.drive = drive
        return {"FINISHED"}


def _menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.operator(UNVEIL_OT_open_drive.bl_idname, text="Street drive (Unveil)")


CLASSES = (UNVEIL_OT_import_drive, UNVEIL_OT_open_drive, UNVEIL_OT_load_workspace)


def register() -> None:
    bpy.types.TOPBAR_MT_file_import.append(_menu)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_import.remove(_menu)
