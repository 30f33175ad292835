# SPDX-License-Identifier: GPL-3.0-or-later
"""Small operators of the panels: the preferences, the report of a job, and its outcome read."""

from __future__ import annotations

from typing import Any

import bpy

from ... import __package__ as ADDON
from ...choice import selection
from .. import status_bar
from . import report_lines

__all__: list[str] = []

WIDTH_PX = 380


class UNVEIL_OT_show_preferences(bpy.types.Operator):
    """Open the add-on's preferences, where the Python of Unveil is installed or named"""

    bl_idname = "unveil.show_preferences"
    bl_label = "Unveil Preferences"

    def execute(self, context: bpy.types.Context) -> set[str]:
        if bpy.app.background or not context.window_manager.windows:
            return {"FINISHED"}
        bpy.ops.preferences.addon_show(module=ADDON)
        return {"FINISHED"}


class UNVEIL_OT_show_report(bpy.types.Operator):
    """What the latest run has made, how long it took, and what to look at"""

    bl_idname = "unveil.show_report"
    bl_label = "Unveil Report"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self._lines = report_lines.lines_of(context)
        return set(context.window_manager.invoke_popup(self, width=int(WIDTH_PX)))

    def draw(self, context: bpy.types.Context) -> None:
        column: Any = self.layout.column(align=True)
        column.label(text="Unveil Report", icon="DOCUMENTS")
        for name, value in self._lines:
            row = column.split(factor=0.42)
            row.label(text=name)
            row.label(text=value)
        row = self.layout.row()
        row.operator("unveil.open_report", icon="URL")
        row.operator("unveil.show_log", icon="TEXT")

    def execute(self, context: bpy.types.Context) -> set[str]:
        for name, value in report_lines.lines_of(context):
            self.report({"INFO"}, f"{name}: {value}")
        return {"FINISHED"}


class UNVEIL_OT_what_goes(bpy.types.Operator):
    """A table of all that will be removed, with sizes, distances and frames"""

    bl_idname = "unveil.what_goes"
    bl_label = "What Goes"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        ready = selection.current(context.scene)
        if not ready:
            cls.poll_message_set("Import footage first")
        return ready

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return set(context.window_manager.invoke_popup(self, width=WIDTH_PX))

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.label(text="Will Be Removed", icon="PRESET")
        table = self.layout.column(align=True)
        for i, cells in enumerate(report_lines.what_goes(context.scene)):
            row = table.row()
            row.enabled = i > 0  # the heading
            for cell in cells:
                row.label(text=cell)

    def execute(self, context: bpy.types.Context) -> set[str]:
        for cells in report_lines.what_goes(context.scene):
            self.report({"INFO"}, "  ".join(cells))
        return {"FINISHED"}


class UNVEIL_OT_open_report(bpy.types.Operator):
    """Open the report page of the results in the web browser"""

    bl_idname = "unveil.open_report"
    bl_label = "Report Page"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        there = bool(context.scene.unveil.workspace)
        if not there:
            cls.poll_message_set("No results yet: press Unveil first")
        return there

    def execute(self, context: bpy.types.Context) -> set[str]:
        page = report_lines.page_of(context.scene)
        if not page.is_file():
            self.report({"ERROR"}, f"{page}: Not made yet (run Unveil to its end)")
            return {"CANCELLED"}
        bpy.ops.wm.url_open(url=page.as_uri())
        return {"FINISHED"}


class UNVEIL_OT_dismiss(bpy.types.Operator):
    """Say no more of the latest job in the status bar"""

    bl_idname = "unveil.dismiss"
    bl_label = "Dismiss"

    def execute(self, context: bpy.types.Context) -> set[str]:
        status_bar.dismiss()
        status_bar.redraw_bars()
        return {"FINISHED"}


CLASSES = (
    UNVEIL_OT_show_preferences,
    UNVEIL_OT_show_report,
    UNVEIL_OT_what_goes,
    UNVEIL_OT_open_report,
    UNVEIL_OT_dismiss,
)
