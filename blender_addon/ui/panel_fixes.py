# SPDX-License-Identifier: GPL-3.0-or-later
"""The section Fix of the sidebar: clean frames that are painted over, which all others follow."""

from __future__ import annotations

import bpy

from ..choice import fixes
from ..work.stage_states import stage_states
from .panels import Section

__all__ = ["UNVEIL_PT_fixes"]


class UNVEIL_PT_fixes(Section, bpy.types.Panel):
    """Frames that were mended."""

    bl_idname = "UNVEIL_PT_fixes"
    bl_label = "Fix"
    bl_order = 5
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return fixes.can_begin(context.scene) or len(context.scene.unveil_selection.fixes) > 0

    def draw(self, context: bpy.types.Context) -> None:
        layout, listed = self.layout, context.scene.unveil_selection
        row = layout.row(align=True)
        row.operator("unveil.next_doubtful", text="Worst First", icon="VIEWZOOM").again = True
        row.operator("unveil.next_doubtful", text="Next", icon="TRIA_RIGHT").again = False
        row = layout.row(align=True)
        row.operator("unveil.paint_frame", icon="BRUSH_DATA")
        row.operator("unveil.clone_from", text="", icon="DUPLICATE")
        for i, fix in enumerate(listed.fixes):
            row = layout.row(align=True)
            row.operator("unveil.go_to_fix", text=f"{fix.time} {fix.track}", icon="IMAGE_DATA").index = i
            row.prop(fix, "invent", text="Fill", toggle=True)
            row.operator("unveil.forget_fix", text="", icon="X").index = i
        if len(listed.fixes):
            row = layout.row()
            row.scale_y = 1.3
            row.operator("unveil.run", text="Unveil Again from Here", icon="FILE_REFRESH")
            layout.label(text="All other frames follow", icon="INFO")
        elif _is_forgotten(context.scene):
            row = layout.row()
            row.scale_y = 1.3
            row.operator("unveil.run", text="Redo without It", icon="FILE_REFRESH")
            layout.label(text="Forgotten, but still in the results", icon="INFO")


def _is_forgotten(scene: bpy.types.Scene) -> bool:
    """Whether results hold what was painted before and is in no list any more."""
    found = stage_states(scene)
    return found is not None and "corrections" in found.stages["reoptimize"].changed


def _header(self: bpy.types.Header, context: bpy.types.Context) -> None:
    """What to do with a painted frame stands over it."""
    image = getattr(context.space_data, "image", None)
    if image is not None and str(image.get("unveil_role", "")).startswith("fix:"):
        self.layout.operator("unveil.run", text="Unveil Again from Here", icon="FILE_REFRESH")


CLASSES = (UNVEIL_PT_fixes,)


def register() -> None:
    bpy.types.IMAGE_HT_header.append(_header)


def unregister() -> None:
    bpy.types.IMAGE_HT_header.remove(_header)
