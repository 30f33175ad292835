# SPDX-License-Identifier: GPL-3.0-or-later
"""The tool with which a click chooses what goes, whether or not the sidebar's tab is open."""

from __future__ import annotations

import bpy

__all__ = ["TAB", "answers_clicks"]

TAB = "Unveil"
"""The sidebar's tab."""
BOX_SELECT = "unveil.choose_in_box"


class UNVEIL_WST_choose(bpy.types.WorkSpaceTool):
    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = "unveil_choose"
    bl_label = "Choose What to Remove"
    bl_description = (
        "Click the box of an object to take it out of the street, or to leave it in.\n"
        "Drag a rectangle to take out all in it; with Ctrl, to leave them in"
    )
    bl_icon = "ops.generic.select_box"
    bl_keymap = (
        (BOX_SELECT, {"type": "LEFTMOUSE", "value": "CLICK_DRAG"}, {"properties": [("wait", False)]}),
        (BOX_SELECT, {"type": "LEFTMOUSE", "value": "CLICK_DRAG", "ctrl": True}, {"properties": [("wait", False)]}),
    )


def is_tool(context: bpy.types.Context) -> bool:
    """Whether the tool is the active one."""
    tool = context.workspace.tools.from_space_view3d_mode("OBJECT", create=False)
    return tool is not None and tool.idname == UNVEIL_WST_choose.bl_idname


def answers_clicks(context: bpy.types.Context) -> bool:
    """Whether boxes take the clicks of a 3D view: with the tool, or while the view's sidebar shows the tab."""
    area = context.area
    if area is None or area.type != "VIEW_3D":
        return area is None  # without a window nothing is in the way of anybody
    if is_tool(context):
        return True
    sidebars = [r for r in area.regions if r.type == "UI" and r.width > 1]
    shown = area.spaces.active.show_region_ui
    return shown and any(getattr(r, "active_panel_category", TAB) == TAB for r in sidebars)


def register() -> None:
    bpy.utils.register_tool(UNVEIL_WST_choose, after={"builtin.cursor"}, separator=True)


def unregister() -> None:
    bpy.utils.unregister_tool(UNVEIL_WST_choose)
