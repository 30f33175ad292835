# SPDX-License-Identifier: GPL-3.0-or-later
"""The section Fix by hand of the sidebar: clean frames that are painted over, which all others follow."""

from __future__ import annotations

import bpy

from ..choice import fixes
from .panels import Section

__all__ = ["UNVEIL_PT_fixes"]


class UNVEIL_PT_fixes(Section, bpy.types.Panel):
    """Frames that were mended."""

    bl_idname = "UNVEIL_PT_fixes"
    bl_label = "Fix by hand"
    bl_order = 5

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return fixes.can_begin(context.scene) or len(context.scene.unveil_selection.fixes) > 0

    def draw(self, context: bpy.types.Context) -> None:
        layout, listed = self.layout, context.scene.unveil_selection
        layout.operator("unveil.paint_frame", icon="BRUSH_DATA")
        for i, fix in enumerate(listed.fixes):
            row = layout.row(align=True)
            row.label(text=fix.name, icon="IMAGE_DATA")
            row.prop(fix, "invent", toggle=True)
            row.operator("unveil.forget_fix", text="", icon="X").index = i
        if len(listed.fixes):
            row = layout.row()
            row.scale_y = 1.3
            row.operator("unveil.run", text="Redo from here", icon="FILE_REFRESH")
            layout.label(text="All other frames follow", icon="INFO")


CLASSES = (UNVEIL_PT_fixes,)
