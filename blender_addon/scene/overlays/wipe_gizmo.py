# SPDX-License-Identifier: GPL-3.0-or-later
"""The line between two pictures that are compared, dragged in the camera's view."""

from __future__ import annotations

import bpy

from .drawn_pictures import Rectangle, frame_in_view

__all__ = ["is_on_line", "share_at"]

NEAR_PX = 8
"""From the line, at the usual scale of the interface."""


def is_on_line(pointer: tuple[float, float], frame: Rectangle, wipe: float, near: float) -> bool:
    """Whether a place is on the line.

    Args:
        pointer: pixels of the region; frame: left, bottom, right, top of the picture; wipe: share of its width; near: pixels.
    """
    left, bottom, right, top = frame
    at = left + wipe * (right - left)
    return abs(pointer[0] - at) <= near and bottom <= pointer[1] <= top


def share_at(x: float, frame: Rectangle) -> float:
    """Where a line stands that is dragged to ``x``: 0 to 1 of the picture's width."""
    left, _, right, _ = frame
    return min(max((x - left) / max(right - left, 1.0), 0.0), 1.0)


class UNVEIL_GT_wipe(bpy.types.Gizmo):
    """Drawn with the pictures; this one answers the pointer."""

    bl_idname = "UNVEIL_GT_wipe"
    __slots__ = ("began",)

    def draw(self, context: bpy.types.Context) -> None:
        pass

    def test_select(self, context: bpy.types.Context, location: tuple[float, float]) -> int:
        frame = frame_in_view(context)
        if frame is None:
            return -1
        near = NEAR_PX * context.preferences.system.ui_scale
        return 0 if is_on_line((location[0], location[1]), frame, context.scene.unveil_view.wipe, near) else -1

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.began = context.scene.unveil_view.wipe
        context.window.cursor_modal_set("MOVE_X")
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event, tweak: set[str]) -> set[str]:
        frame = frame_in_view(context)
        if frame is not None:
            context.scene.unveil_view.wipe = share_at(event.mouse_region_x, frame)
        return {"RUNNING_MODAL"}

    def exit(self, context: bpy.types.Context, cancel: bool) -> None:
        context.window.cursor_modal_restore()
        if cancel:
            context.scene.unveil_view.wipe = self.began


class UNVEIL_GGT_wipe(bpy.types.GizmoGroup):
    """In the 3D views of a scene whose pictures are wiped."""

    bl_idname = "UNVEIL_GGT_wipe"
    bl_label = "Unveil Wipe"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"PERSISTENT", "SCALE"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.scene.unveil_view.compare == "WIPE"

    def setup(self, context: bpy.types.Context) -> None:
        gizmo = self.gizmos.new(UNVEIL_GT_wipe.bl_idname)
        gizmo.use_draw_modal = True


CLASSES = (UNVEIL_GT_wipe, UNVEIL_GGT_wipe)
