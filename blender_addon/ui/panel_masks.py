# SPDX-License-Identifier: GPL-3.0-or-later
"""The section Masks of the sidebar: objects that the artist draws or paints."""

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


CLASSES = (UNVEIL_PT_masks,)
