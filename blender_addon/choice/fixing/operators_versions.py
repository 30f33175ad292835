# SPDX-License-Identifier: GPL-3.0-or-later
"""Keeps versions of a result, and shows one of them beside what there is now."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
from bpy.props import IntProperty

from ...formats.drive_files import ImportedDrive, read_drive
from ...formats.files import one_line
from ...formats.timeline import timeline_of
from ...scene import blocks, drive_scene, view
from ...scene.images import versions_kept

__all__: list[str] = []


def _with_drive(
    operator: bpy.types.Operator, context: bpy.types.Context, act: Callable[[bpy.types.Collection, ImportedDrive], str]
) -> set[str]:
    """Do something with the shown drive and say what; what is wrong is reported in one line."""
    collection = view.shown_drive(context.scene)
    assert collection is not None
    workspace = Path(blocks.workspace_of(collection))
    try:
        told = act(collection, read_drive(workspace, drive_scene.metre_of(context.scene)))
    except (OSError, ValueError) as error:
        operator.report({"ERROR"}, one_line(error, workspace))
        return {"CANCELLED"}
    operator.report({"INFO"}, told)
    return {"FINISHED"}


def _show(context: bpy.types.Context, collection: bpy.types.Collection, drive: ImportedDrive, number: int) -> None:
    timeline = timeline_of(drive, context.scene.unveil.start_frame)
    tracks = drive_scene.tracks_of(collection)
    versions_kept.show(collection, blocks.drive_of(collection), tracks, drive, timeline, number)


class UNVEIL_OT_keep_version(bpy.types.Operator):
    """Keep a copy of the clean frames as they are now, to compare later results with"""

    bl_idname = "unveil.keep_version"
    bl_label = "Keep This Version"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return view.has_results(cls, context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        def act(collection: bpy.types.Collection, drive: ImportedDrive) -> str:
            number = versions_kept.keep(drive, drive_scene.tracks_of(collection))
            _show(context, collection, drive, number)
            return f"Version {number} is kept"

        return _with_drive(self, context, act)


class UNVEIL_OT_compare_version(bpy.types.Operator):
    """Wipe between what there is now and this version"""

    bl_idname = "unveil.compare_version"
    bl_label = "Compare with Version"
    bl_options = {"REGISTER", "UNDO"}

    number: IntProperty(name="Version", default=1, min=1)

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        collection = view.shown_drive(context.scene)
        if collection is None or not collection.get(versions_kept.KEPT):
            cls.poll_message_set("No version is kept yet: press Keep This Version")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        def act(collection: bpy.types.Collection, drive: ImportedDrive) -> str:
            _show(context, collection, drive, self.number)
            shown = context.scene.unveil_view
            shown.state, shown.background, shown.compare_with = "AFTER", "clean", "kept"
            shown.compare = "DIFFERENCE" if shown.compare == "DIFFERENCE" else "WIPE"
            return f"Left of the line: now. Right: version {self.number}"

        return _with_drive(self, context, act)


CLASSES = (UNVEIL_OT_keep_version, UNVEIL_OT_compare_version)
