# SPDX-License-Identifier: GPL-3.0-or-later
"""Mending clean frames by hand: paint on one, or mark in it what is wrong."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import IntProperty

from ..formats.files import one_line
from ..scene import view
from . import fixes
from .fixing.brush_color import take_color

__all__ = ["show_picture"]


class UNVEIL_OT_paint_frame(bpy.types.Operator):
    """Paint on a copy of this clean frame, in an Image Editor; all other frames will follow"""

    bl_idname = "unveil.paint_frame"
    bl_label = "Paint This Frame"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        ready = fixes.can_begin(context.scene)
        if not ready:
            cls.poll_message_set("Run Unveil first, and look through a camera of the drive")
        return ready

    def execute(self, context: bpy.types.Context) -> set[str]:
        is_first = not len(context.scene.unveil_selection.fixes)
        try:
            fix = fixes.begin(context.scene)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, one_line(error, Path(context.scene.unveil_selection.workspace)))
            return {"CANCELLED"}
        if not bpy.app.background and context.window_manager.windows:
            show_picture(context, fix.image)
        if is_first:  # from then on the colour is the artist's
            removed = Path(context.scene.unveil_selection.workspace, "masks/removed", fix.track, f"{fix.frame}.png")
            take_color(context, fix.image, removed)
        return {"FINISHED"}


def show_picture(context: bpy.types.Context, image: bpy.types.Image) -> None:
    """In an Image Editor that is open, else in a window of its own."""
    areas = [a for w in context.window_manager.windows for a in w.screen.areas if a.type == "IMAGE_EDITOR"]
    if not areas:
        bpy.ops.wm.window_new()
        areas = [context.window_manager.windows[-1].screen.areas[0]]
        areas[0].type = "IMAGE_EDITOR"
    space = areas[0].spaces.active
    space.image = image
    space.ui_mode = "PAINT"
    space.show_region_tool_header = True  # the brush's colour and size
    region = next((r for r in areas[0].regions if r.type == "WINDOW"), None)
    window = next(w for w in context.window_manager.windows if areas[0] in list(w.screen.areas))
    if region is not None:
        with context.temp_override(window=window, area=areas[0], region=region):
            bpy.ops.image.view_all(fit_view=True)


class _OfOneFix:
    """What operators share that do something with one of the fixes, ``index`` of the list."""

    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty()

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return len(context.scene.unveil_selection.fixes) > 0

    def is_there(self, context: bpy.types.Context) -> bool:
        """Whether there is such a fix; else it is reported."""
        there = 0 <= self.index < len(context.scene.unveil_selection.fixes)
        if not there:
            self.report({"ERROR"}, f"Not found: fix {self.index}")  # type: ignore[attr-defined]
        return there


class UNVEIL_OT_forget_fix(_OfOneFix, bpy.types.Operator):
    """Forget what was painted on this frame"""

    bl_idname = "unveil.forget_fix"
    bl_label = "Forget"

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self.is_there(context):
            return {"CANCELLED"}
        try:
            fixes.forget(context.scene, self.index)
        except (OSError, ValueError) as error:
            self.report({"ERROR"}, one_line(error, Path(context.scene.unveil_selection.workspace)))
            return {"CANCELLED"}
        return {"FINISHED"}


class UNVEIL_OT_go_to_fix(_OfOneFix, bpy.types.Operator):
    """Go to this frame, and open what was painted on it"""

    bl_idname = "unveil.go_to_fix"
    bl_label = "Go to Fix"

    def execute(self, context: bpy.types.Context) -> set[str]:
        if not self.is_there(context):
            return {"CANCELLED"}
        listed = context.scene.unveil_selection
        fix = listed.fixes[self.index]
        listed.active_fix = self.index
        context.scene.frame_set(fix.time)
        if view.shown_drive(context.scene) is not None:
            bpy.ops.unveil.look_through(track=fix.track)
        if fix.image is not None and not bpy.app.background and context.window_manager.windows:
            show_picture(context, fix.image)
        return {"FINISHED"}


CLASSES = (UNVEIL_OT_paint_frame, UNVEIL_OT_forget_fix, UNVEIL_OT_go_to_fix)
