# SPDX-License-Identifier: GPL-3.0-or-later
"""Pick or drop a drive: it is looked at in the worker's process, and a dialog tells what was found before anything is imported."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...formats.files import shown
from ...formats.object_files import recorded_drive, recorded_settings
from ...formats.table.run_settings import SHOWN
from ...scene import blocks, versions
from ...worker.job_state import JobState
from ...worker.jobs import own_folder
from ...worker.run_arguments import adopt, default_workspace, other_drive, settings_arguments
from ..job.calling import called
from ..job.job_operator import JobOperator, UserError
from ..job.sidebar import open_tab
from ..job.task import Task
from .checked import Checked, checked_of
from .checked_drawing import draw_checked
from .dialog_settings import DialogSettings, Overlaid

__all__ = ["drive_of"]

PAGE = "check.html"
_checked: Checked | None = None
"""What the latest check told."""


def drive_of(path: Path) -> Path:
    """What to import for what was picked: a transforms file itself, else the folder it lies in."""
    if (
        not path.exists() and path.parent.is_dir()
    ):  # Blender proposes the .blend's name in a folder where nothing is picked
        path = path.parent
    if not path.is_file() or (path.suffix.lower() == ".json" and path.name != "cameras.json"):
        return path
    folder = path.parent  # of a COLMAP model, or of a workspace's drive
    if folder.parent.name == "sparse":
        folder = folder.parent
    return folder.parent if folder.name == "sparse" else folder


class UNVEIL_OT_open_drive(DialogSettings, bpy.types.Operator, ImportHelper):
    """Import a street drive: a transforms.json, or the folder of any drive that unveil knows"""

    bl_idname = "unveil.open_drive"
    bl_label = "Import Street Drive"

    filename_ext = ""
    filter_glob: StringProperty(default="*.json;*.bin;*.txt", options={"HIDDEN"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(bpy.ops.unveil.import_drive.poll())

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if self.properties.is_property_set("filepath"):  # dropped onto the window
            return self.execute(context)
        return super().invoke(context, event)

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column()
        for line in (
            "Pick its file, or open its folder",
            "and pick nothing: Unveil looks at",
            "it and asks for settings.",
        ):
            column.label(text=line)

    def execute(self, context: bpy.types.Context) -> set[str]:
        path = str(drive_of(blocks.absolute(self.filepath)))
        if versions.has_window():
            return called(self, bpy.ops.unveil.check_drive, "INVOKE_DEFAULT", filepath=path, **self.words())
        return called(self, bpy.ops.unveil.import_street, filepath=path, **self.words())


class UNVEIL_OT_check_drive(DialogSettings, JobOperator, bpy.types.Operator):
    """Look at a drive: what it is, what is assumed of it, and what looks wrong"""

    bl_idname = "unveil.check_drive"
    bl_label = "Check Drive"

    filepath: StringProperty(name="Drive", subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN"})

    def arguments(self, context: bpy.types.Context) -> list[str]:
        drive = blocks.absolute(self.filepath)
        if not self.filepath or not drive.exists():
            raise UserError(f"{shown(str(drive))}: Not found (pick its file, or its folder)")
        settings = Overlaid(context.scene.unveil, dict(self.given()))
        page = Path(own_folder()) / PAGE
        options = settings_arguments(settings, bpy.path.abspath)
        return ["check", str(drive), "-o", str(page), "--replace", *options]

    def task(self, context: bpy.types.Context) -> Task:
        ended = partial(_told, Path(self.arguments(context)[1]), self.words())
        return replace(super().task(context), ended=ended, tells=False)


def _told(drive: Path, words: dict[str, Any], context: bpy.types.Context, state: JobState) -> None:
    """The check has ended: the dialog shows what it told."""
    global _checked
    if state.status == "cancelled":
        return
    _checked = checked_of(drive, state)
    if versions.has_window():
        bpy.ops.unveil.import_street("INVOKE_DEFAULT", filepath=str(drive), **words)


class UNVEIL_OT_import_street(DialogSettings, bpy.types.Operator):
    """Import a drive that was looked at"""

    bl_idname = "unveil.import_street"
    bl_label = "Import Street Drive"
    bl_options = {"INTERNAL"}

    filepath: StringProperty(name="Drive", subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN"})
    go_on: BoolProperty(
        name="Import All the Same",
        description="Go on though the drive is surely not what it is taken for",
        options={"SKIP_SAVE"},
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        settings = context.scene.unveil
        made = _made_with(context, self)
        if made is not None:  # a dialog that is called off leaves the scene as it is
            settings = Overlaid(settings, _properties(made))
        self.fill(context, settings)
        found = self._found()
        self.more = self.is_asked_more() or (found is not None and bool(found.error or found.findings))
        confirm = "Check Again" if found is not None and found.error else "Import"
        return context.window_manager.invoke_props_dialog(self, width=520, title=self.bl_label, confirm_text=confirm)

    def _found(self) -> Checked | None:
        return _checked if _checked is not None and _checked.drive == str(blocks.absolute(self.filepath)) else None

    def draw(self, context: bpy.types.Context) -> None:
        draw_checked(self.layout, self._found(), self.filepath)
        found = self._found()
        if found is not None and found.asks:
            self.layout.prop(self, "go_on")
        self.draw_settings(self.layout)

    def execute(self, context: bpy.types.Context) -> set[str]:
        found = self._found() if versions.has_window() else None
        if found is not None and (found.error or (found.asks and not self.go_on)):
            return called(self, bpy.ops.unveil.check_drive, "INVOKE_DEFAULT", filepath=self.filepath, **self.words())
        settings = context.scene.unveil
        made = _made_with(context, self)
        if made is not None:  # what it was made with stays: otherwise all of it would be made anew
            adopt(settings, made)
        for name, value in self.given():
            setattr(settings, name, value)
        if versions.has_window():
            open_tab(context)
        words = {"filepath": self.filepath, "workspace": self.workspace, "yes": self.go_on}
        return called(self, bpy.ops.unveil.import_drive, "INVOKE_DEFAULT", **words)


def _made_with(context: bpy.types.Context, asked: UNVEIL_OT_import_street) -> dict[str, object] | None:
    """The settings of the workspace that an import would go into, where it holds that drive and the scene does not show it."""
    drive, settings = blocks.absolute(asked.filepath), context.scene.unveil
    place = blocks.absolute(asked.workspace) if asked.workspace else default_workspace(drive, bpy.data.filepath)
    if settings.workspace and blocks.absolute(settings.workspace) == place:
        return None
    try:
        known = recorded_drive(place)
        return dict(recorded_settings(place)) if known and not other_drive(drive, known) else None
    except (OSError, ValueError):
        return None  # told when it is imported


def _properties(made: dict[str, object]) -> dict[str, Any]:
    """Recorded settings as properties have them."""
    found = {s.name: s.shown(made[s.name]) for s in SHOWN if s.name in made}
    return {name: value for name, value in found.items() if value is not None}


class UNVEIL_FH_drive(bpy.types.FileHandler):
    """A drive's file dropped onto a 3D view"""

    bl_idname = "UNVEIL_FH_drive"
    bl_label = "Street drive (Unveil)"
    bl_import_operator = "unveil.open_drive"
    bl_file_extensions = ".json;.bin"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D"


def _menu(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    self.layout.operator(UNVEIL_OT_open_drive.bl_idname, text="Street Drive (Unveil)")


CLASSES = (UNVEIL_OT_open_drive, UNVEIL_OT_check_drive, UNVEIL_OT_import_street, UNVEIL_FH_drive)


def register() -> None:
    bpy.types.TOPBAR_MT_file_import.append(_menu)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_import.remove(_menu)
