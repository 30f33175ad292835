# SPDX-License-Identifier: GPL-3.0-or-later
"""The section Shot of the sidebar: what is imported, and through which camera it is seen."""

from __future__ import annotations

import bpy

from ..choice import selection
from ..scene import drive_scene, view
from .panels import Section, split

__all__ = ["UNVEIL_PT_drive"]


class UNVEIL_PT_drive(Section, bpy.types.Panel):
    """What is imported."""

    bl_idname = "UNVEIL_PT_drive"
    bl_label = "Shot"
    bl_order = 1
    bl_options = {"DEFAULT_CLOSED"}  # before there is one, the next step is to import it

    def draw(self, context: bpy.types.Context) -> None:
        layout, scene = self.layout, context.scene
        row = layout.row(align=True)
        row.operator("unveil.open_drive", text="Drive…", icon="IMPORT")
        row.operator("unveil.import_footage", text="Footage…", icon="FILE_MOVIE")
        layout.operator("unveil.use_shot", icon="CAMERA_DATA")
        layout.operator("unveil.load_workspace", text="Open Results…", icon="FILE_FOLDER").ask = True
        if scene.unveil.drive:
            row = layout.row(align=True)
            row.prop(scene.unveil, "drive", text="")
            again = "Import Again" if selection.current(scene) else "Import"
            row.operator("unveil.import_drive", text="" if selection.current(scene) else again, icon="FILE_REFRESH")
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
        column = split(layout)
        column.prop(scene.unveil, "start_frame")
        column.prop(scene.unveil, "set_up_scene")


CLASSES = (UNVEIL_PT_drive,)
