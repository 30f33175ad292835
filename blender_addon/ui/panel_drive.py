# SPDX-License-Identifier: GPL-3.0-or-later
"""The Drive section of the sidebar: what is imported, and through which camera it is seen."""

from __future__ import annotations

import bpy

from ..choice import selection
from ..scene import drive_scene, view
from .panels import Section

__all__ = ["UNVEIL_PT_drive"]


class UNVEIL_PT_drive(Section, bpy.types.Panel):
    """What is imported."""

    bl_idname = "UNVEIL_PT_drive"
    bl_label = "Drive"
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        layout.operator("unveil.open_drive", text="Import street drive…", icon="IMPORT")
        layout.operator("unveil.use_shot", icon="CAMERA_DATA")
        layout.operator("unveil.load_workspace", text="Open results…", icon="FILE_FOLDER").ask = True
        if scene.unveil.drive:
            column = layout.column()
            column.use_property_split, column.use_property_decorate = True, False
            column.prop(scene.unveil, "drive")
            again = "Import again" if selection.current(scene) else "Import"
            layout.operator("unveil.import_drive", text=again, icon="FILE_REFRESH")
        collection = view.shown_drive(scene)
        if collection is None:
            return
        tracks = drive_scene.tracks_of(collection)
        if len(tracks) > 1:
            flow = layout.grid_flow(columns=2, align=True)
            for camera in tracks:
                flow.operator(
                    "unveil.look_through",
                    text=camera["unveil_track"],
                    icon="VIEW_CAMERA",
                    depress=camera == scene.camera,
                ).track = camera["unveil_track"]
        column = layout.column()
        column.use_property_split, column.use_property_decorate = True, False
        column.row().prop(scene.unveil_view, "points", expand=True)
        column.prop(scene.unveil, "start_frame")
        column.prop(scene.unveil, "set_up_scene")


CLASSES = (UNVEIL_PT_drive,)
