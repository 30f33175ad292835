# SPDX-License-Identifier: GPL-3.0-or-later
"""What of a drive is looked at: before or after, through which of its cameras."""

from __future__ import annotations

import bpy
from bpy.props import StringProperty

from . import cameras, drive_scene, view

__all__: list[str] = []


class UNVEIL_OT_before_after(bpy.types.Operator):
    """Switch between the street as it was and the empty one: background and meshes at once"""

    bl_idname = "unveil.before_after"
    bl_label = "Before / After"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return view.shown_drive(context.scene) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        shown = context.scene.unveil_view
        after = shown.state == "BEFORE"
        shown.state = "AFTER" if after else "BEFORE"
        shown.background = "clean" if after else "original"
        return {"FINISHED"}


class UNVEIL_OT_look_through(bpy.types.Operator):
    """Look through this camera, with the resolution and pixel aspect of its pictures"""

    bl_idname = "unveil.look_through"
    bl_label = "Look through Camera"
    bl_options = {"REGISTER", "UNDO"}

    track: StringProperty(options={"SKIP_SAVE"})

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return view.shown_drive(context.scene) is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        collection = view.shown_drive(context.scene)
        tracks = [] if collection is None else drive_scene.tracks_of(collection)
        camera = next((c for c in tracks if not self.track or c["unveil_track"] == self.track), None)
        if camera is None:
            self.report({"ERROR"}, f"Not found: the camera {self.track}")
            return {"CANCELLED"}
        cameras.fit_scene_to(context.scene, camera)
        drive_scene.show_cameras_view(context)
        return {"FINISHED"}


CLASSES = (UNVEIL_OT_before_after, UNVEIL_OT_look_through)
