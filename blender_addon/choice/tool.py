# SPDX-License-Identifier: GPL-3.0-or-later
"""The tool with which a click chooses what goes, whether or not the sidebar's tab is open."""

from __future__ import annotations

import bpy

__all__ = ["TAB", "answers_clicks"]

TAB = "Unveil"
"""The sidebar's tab."""


class UNVEIL_WST_choose(bpy.types.WorkSpaceTool):
    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = "unveil_choose"
    bl_label = "Choose what to remove"
    bl_description = "Click the box of an object to take it out of the street, or to leave it in"
    bl_icon = "ops.generic.select"
    bl_keymap = ()


def answers_clicks(context: bpy.types.Context) -> bool:
    """Whether boxes take the clicks of a 3D view: with the tool, or while the view's sidebar shows the tab."""
    area = context.area
    if area is None or area.type != "VIEW_3D":
        return area is None  # without a window nothing is in the way of anybody
    tool = context.workspace.tools.from_space_view3d_mode("OBJECT", create=False)
    if tool is not None and tool.idname == UNVEIL_WST_choose.bl_idname:
        return True
    sidebars = [r for r in area.regions if r.type == "UI" and r.width > 1]
    shown = area.spaces.active.show_region_ui
    return shown and any(getattr(r, "active_panel_category", TAB) == TAB for r in sidebars)


def register() -> None:
    bpy.utils.register_tool(UNVEIL_WST_choose, after={"builtin.cursor"}, separator=True)


def unregister() -> None:
    bpy.utils.unregister_tool(UNVEIL_WST_choose)
