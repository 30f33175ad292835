# SPDX-License-Identifier: GPL-3.0-or-later
"""The section Look of the sidebar: before and after, what of the drive and its results is shown, and how."""

from __future__ import annotations

import bpy

from ..formats import sequences
from ..scene import versions, view
from ..scene.images import preview, versions_kept
from . import previews
from .panels import Section, split

__all__ = ["UNVEIL_PT_points", "UNVEIL_PT_results"]

MOST_VERSIONS = 6
"""The latest have a button."""
ORIGINS = ("Relit", "Other Frames", "Continued", "Made Up")
"""Of removed pixels, in the order of their colors."""


class UNVEIL_PT_results(Section, bpy.types.Panel):
    """What is shown."""

    bl_idname = "UNVEIL_PT_results"
    bl_label = "Look"
    bl_order = 4
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return view.shown_drive(context.scene) is not None

    def draw(self, context: bpy.types.Context) -> None:
        layout, shown = self.layout, context.scene.unveil_view
        kinds = ["POINTS", "MESH", *(["SPLATS"] if versions.has_native_splats() else [])]
        row = layout.row(align=True)
        for kind in kinds:
            row.prop_enum(shown, "shown", kind)
        column = split(layout)
        column.prop(shown, "background")
        column.prop(shown, "compare")
        if shown.compare == "WIPE":
            column.prop(shown, "wipe", slider=True)
        if shown.compare in ("WIPE", "DIFFERENCE"):
            column.prop(shown, "compare_with")
        if shown.compare == "ORIGIN" or shown.background == "provenance":
            flow = layout.grid_flow(columns=2, align=True)
            for text, color in zip(ORIGINS, sequences.ORIGIN_COLORS[1:], strict=True):
                flow.label(text=text, icon_value=previews.plain_chip(text, [c / 255 for c in color]))
        column.prop(context.scene.unveil_selection, "boxes")
        self._versions(context)
        tried = list(context.scene.camera.get(preview.TRIED, ())) if context.scene.camera is not None else []
        if shown.background == "preview" and tried:
            frames = "1 frame" if len(tried) == 1 else f"{len(tried)} frames"
            layout.label(text=f"Preview: {frames}, {tried[0]} to {tried[-1]}", icon="HIDE_OFF")
        mesh = view.shown_mesh(context.scene)
        if mesh is not None and (view.is_decimated(mesh) or mesh.get(view.FULL_DETAIL)):
            detail = f"Full Detail: {mesh['unveil_triangles']:,} Triangles"
            layout.operator("unveil.full_detail", text=detail, depress=bool(mesh.get(view.FULL_DETAIL)))
        layout.operator("unveil.load_workspace", text="Reload Results", icon="FILE_REFRESH").ask = False

    def _versions(self, context: bpy.types.Context) -> None:
        collection = view.shown_drive(context.scene)
        if collection is None or not collection.get("unveil_clean"):
            return
        kept = list(collection.get(versions_kept.KEPT, ()))
        row = self.layout.row(align=True)
        row.operator("unveil.keep_version", text="" if kept else "Keep This Version", icon="ADD")
        for number in kept[-MOST_VERSIONS:]:
            row.operator("unveil.compare_version", text=f"v{number}").number = number


class UNVEIL_PT_points(Section, bpy.types.Panel):
    """How points are drawn."""

    bl_idname = "UNVEIL_PT_points"
    bl_label = "Points"
    bl_parent_id = "UNVEIL_PT_results"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        column, shown = split(self.layout), context.scene.unveil_view
        column.row().prop(shown, "points", text="Color", expand=True)
        column.prop(shown, "point_size", text="Size")
        column.prop(shown, "point_reach", text="Distance (m)")
        column.prop(shown, "points_in_camera", text="In Camera View")


CLASSES = (UNVEIL_PT_results, UNVEIL_PT_points)
