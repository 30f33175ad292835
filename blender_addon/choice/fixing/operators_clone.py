# SPDX-License-Identifier: GPL-3.0-or-later
"""Paint taken from another frame: its picture as what the Clone brush copies, in the Image Editor."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import EnumProperty, IntProperty

from ...formats.open_safely import LARGEST_PICTURE, open_file
from ...scene import cameras
from ...scene.overlays import compared

__all__: list[str] = []

NAME = "Unveil Clone Source"
BRUSH = "brushes/essentials_brushes-mesh_texture.blend/Brush/Clone"


class UNVEIL_OT_clone_from(bpy.types.Operator):
    """Let the Clone brush copy from another frame: drag its picture into place with the right button, then paint"""

    bl_idname = "unveil.clone_from"
    bl_label = "Clone from Another Frame"
    bl_options = {"REGISTER", "UNDO"}

    offset: IntProperty(
        name="Frames On", description="How many frames after the present one; negative: before it", default=5
    )
    kind: EnumProperty(
        name="Picture",
        items=(
            ("original", "Photograph", "As it was taken"),
            ("clean", "Clean Frame", "The result of that frame"),
        ),
        default="clean",
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        ready = cameras.track_of(context.scene.camera) is not None
        if not ready:
            cls.poll_message_set("Look through a camera of the drive first")
        return ready

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        file = compared.file_at(scene.camera, self.kind, scene.frame_current + self.offset)
        try:
            open_file(file, LARGEST_PICTURE).close()
        except (OSError, ValueError):
            self.report({"ERROR"}, f"Frame {scene.frame_current + self.offset} has no such picture (run Unveil first)")
            return {"CANCELLED"}
        image = bpy.data.images.get(NAME)
        if image is None:
            image = bpy.data.images.load(file, check_existing=False)
            image.name = NAME
        elif image.filepath != file:
            image.filepath = file
            image.reload()
        paint = context.tool_settings.image_paint
        _take_brush(context)
        for holder in (paint, paint.brush):  # alpha and offset moved from the brush to the settings after 4.2
            for name, value in (("clone_image", image), ("clone_alpha", 0.5), ("clone_offset", (0.0, 0.0))):
                if holder is not None and name in holder.bl_rna.properties:
                    setattr(holder, name, value)
        self.report({"INFO"}, "Paint with the Clone brush; drag its picture with the right button")
        return {"FINISHED"}


def _take_brush(context: bpy.types.Context) -> None:
    """The Clone brush in an Image Editor that paints, where a window has one; elsewhere the artist takes it."""
    manager: Any = context.window_manager
    for window in manager.windows:
        for area in window.screen.areas:
            if area.type != "IMAGE_EDITOR" or area.spaces.active.ui_mode != "PAINT":
                continue
            region = next(r for r in area.regions if r.type == "WINDOW")
            with context.temp_override(window=window, area=area, region=region):
                if hasattr(bpy.ops.brush, "asset_activate"):
                    bpy.ops.brush.asset_activate(asset_library_type="ESSENTIALS", relative_asset_identifier=BRUSH)
                else:
                    bpy.ops.wm.tool_set_by_id(name="builtin_brush.Clone")
            return


CLASSES = (UNVEIL_OT_clone_from,)
