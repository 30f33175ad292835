# SPDX-License-Identifier: GPL-3.0-or-later
"""The section Masks of the sidebar: objects that the artist draws or paints; and the button that keeps edited Gaussians."""

from __future__ import annotations

import bpy

from ..choice import selection
from .panels import Section

__all__ = ["UNVEIL_PT_masks"]


class UNVEIL_PT_masks(Section, bpy.types.Panel):
    """Drawn and painted masks."""

    bl_idname = "UNVEIL_PT_masks"
    bl_label = "Masks"
    bl_order = 2
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return selection.current(context.scene)

    def draw(self, context: bpy.types.Context) -> None:
        column = self.layout.column()
        row = column.row(align=True)
        row.operator("unveil.paint_mask", icon="BRUSH_DATA")
        row.operator("unveil.use_painted", text="", icon="CHECKMARK")
        for mask in bpy.data.masks:
            row = column.row(align=True)
            row.label(text=mask.name, icon="MOD_MASK", translate=False)
            row.operator("unveil.use_mask").mask = mask.name


def _keep(self: bpy.types.Menu, context: bpy.types.Context) -> None:
    """Where a point cloud's other operators are."""
    thing = context.active_object
    if thing is not None and thing.get("unveil_role") == "splats:empty":
        self.layout.separator()
        self.layout.operator("unveil.keep_splats", icon="FILE_TICK")


CLASSES = (UNVEIL_PT_masks,)


def register() -> None:
    for menu in _menus():
        menu.append(_keep)


def unregister() -> None:
    for menu in _menus():
        menu.remove(_keep)


def _menus() -> list[type]:
    """Of the 3D view, in Object Mode and, where there is one, in Edit Mode of point clouds."""
    names = ("VIEW3D_MT_object", "VIEW3D_MT_object_context_menu", "VIEW3D_MT_edit_pointcloud")
    return [found for name in names if (found := getattr(bpy.types, name, None)) is not None]
