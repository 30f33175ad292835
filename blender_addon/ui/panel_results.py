# SPDX-License-Identifier: GPL-3.0-or-later
"""The Results section of the sidebar: what of a run is shown."""

from __future__ import annotations

import bpy

from ..scene import view
from ..scene.images import compositing, preview
from .panels import Section

__all__ = ["UNVEIL_PT_results"]


class UNVEIL_PT_results(Section, bpy.types.Panel):
    """What is shown of the results."""

    bl_idname = "UNVEIL_PT_results"
    bl_label = "Results"
    bl_order = 4

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return view.shown_drive(context.scene) is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout, shown = self.layout, context.scene.unveil_view
        layout.row(align=True).prop(shown, "shown")
        column = layout.column()
        column.use_property_split, column.use_property_decorate = True, False
        column.prop(shown, "background")
        tried = list(context.scene.camera.get(preview.TRIED, ())) if context.scene.camera is not None else []
        if shown.background == "preview" and tried:
            layout.label(text=f"Preview: {len(tried)} frames, {tried[0]} to {tried[-1]}", icon="HIDE_OFF")
        mesh = view.shown_mesh(context.scene)
        if mesh is not None and (view.is_decimated(mesh) or mesh.get(view.FULL_DETAIL)):
            detail = f"Full detail: {mesh['unveil_triangles']:,} triangles"
            layout.operator("unveil.full_detail", text=detail, depress=bool(mesh.get(view.FULL_DETAIL)))
        layout.operator("unveil.load_workspace", text="Reload results", icon="FILE_REFRESH").ask = False
        _draw_plates(layout.box().column(), context)


def _draw_plates(column: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Full-size plates and mattes; where the footage has a lens, the button asks in which."""
    column.label(text="Compositing", icon="NODE_COMPOSITING")
    if compositing.in_lens(context.scene):
        column.operator_menu_enum("unveil.plates", "lens")
    else:
        column.operator("unveil.plates")
    column.operator("unveil.add_to_compositor")


CLASSES = (UNVEIL_PT_results,)
