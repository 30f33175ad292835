# SPDX-License-Identifier: GPL-3.0-or-later
"""Choosing many objects at once: similar ones, those that the list shows, those in a rectangle; one's settings for all."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatProperty, IntProperty

from ...formats.boxes import within
from ...scene import drive_scene
from .. import box_gizmos, selection
from . import filters

__all__: list[str] = []

LEAST_PX = 4
"""A shorter way is a click that trembled."""
COLOR, WIDTH_PX = (1.0, 1.0, 1.0, 0.8), 1.5
HELP = "Draw around the objects · Ctrl: leave them in · Esc"


class _OfList:
    """What these operators share."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        ready = selection.current(context.scene)
        if not ready:
            cls.poll_message_set("Import a drive first")  # type: ignore[attr-defined]
        return ready

    def choose(self, context: bpy.types.Context, which: Any, chosen: bool) -> set[str]:
        """Choose the objects of these indices, or leave them in the street; says how many."""
        objects = context.scene.unveil_selection.objects
        changed = [objects[int(i)] for i in which if objects[int(i)].chosen != chosen and not objects[int(i)].moves]
        for thing in changed:
            thing.chosen = chosen
        what = "1 object" if len(changed) == 1 else f"{len(changed)} objects"
        self.report({"INFO"}, f"{what} {'removed' if chosen else 'left in'}")  # type: ignore[attr-defined]
        return {"FINISHED"}


class UNVEIL_OT_choose_similar(_OfList, bpy.types.Operator):
    """Remove all objects of the active one's class and of about its size"""

    bl_idname = "unveil.choose_similar"
    bl_label = "Select Similar"

    tolerance: FloatProperty(
        name="Tolerance",
        description="By which share the longest side may be another",
        subtype="FACTOR",
        default=0.25,
        min=0,
        max=1,
    )
    chosen: BoolProperty(name="Remove", description="Off: leave them in the street", default=True)

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        listed, metre = scene.unveil_selection, drive_scene.metre_of(scene)
        if not 0 <= listed.active < len(listed.objects):
            self.report({"ERROR"}, "No object is active: click one in the list")
            return {"CANCELLED"}
        sizes = filters.sizes(listed, metre)
        own, size = listed.objects[listed.active], sizes[listed.active]
        alike = np.array([o.class_name == own.class_name for o in listed.objects], np.bool_)
        if size > 0:
            alike &= np.abs(sizes - size) <= self.tolerance * size
        return self.choose(context, np.flatnonzero(alike), self.chosen)


class UNVEIL_OT_choose_shown(_OfList, bpy.types.Operator):
    """Remove all objects that the list shows, as it is filtered"""

    bl_idname = "unveil.choose_shown"
    bl_label = "Select Filtered"

    chosen: BoolProperty(name="Remove", description="Off: leave them in the street", default=True)

    def execute(self, context: bpy.types.Context) -> set[str]:
        scene = context.scene
        shown = filters.shown(scene.unveil_selection, drive_scene.metre_of(scene))
        return self.choose(context, np.flatnonzero(shown), self.chosen)


class UNVEIL_OT_set_like_active(_OfList, bpy.types.Operator):
    """Give all removed objects the Grow and Keep Shadow of the active one"""

    bl_idname = "unveil.set_like_active"
    bl_label = "Copy to All Removed"

    def execute(self, context: bpy.types.Context) -> set[str]:
        listed = context.scene.unveil_selection
        if not 0 <= listed.active < len(listed.objects):
            self.report({"ERROR"}, "No object is active: click one in the list")
            return {"CANCELLED"}
        own = listed.objects[listed.active]
        others = [o for o in listed.objects if (o.chosen or o.moves) and o != own]
        for thing in others:
            thing.grow, thing.keep_shadow = own.grow, own.keep_shadow
        self.report({"INFO"}, f"{len(others)} others have them now")
        return {"FINISHED"}


class UNVEIL_OT_choose_in_box(_OfList, bpy.types.Operator):
    """Draw a rectangle around objects that are to go; with Ctrl they are left in the street"""

    bl_idname = "unveil.choose_in_box"
    bl_label = "Box Select"

    left: IntProperty(options={"HIDDEN", "SKIP_SAVE"})
    bottom: IntProperty(options={"HIDDEN", "SKIP_SAVE"})
    right: IntProperty(options={"HIDDEN", "SKIP_SAVE"})
    top: IntProperty(options={"HIDDEN", "SKIP_SAVE"})
    chosen: BoolProperty(name="Remove", default=True, options={"SKIP_SAVE"})
    wait: BoolProperty(
        name="Wait for a Press", default=True, options={"HIDDEN", "SKIP_SAVE"}, description="Off: the button is held"
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if context.region_data is None or context.area is None:
            self.report({"ERROR"}, "Start it in a 3D view")
            return {"CANCELLED"}
        self._start: tuple[int, int] | None = None
        if not self.wait:
            self._start = event.mouse_region_x, event.mouse_region_y
        self._end = event.mouse_region_x, event.mouse_region_y
        self._drawn = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_PIXEL")
        context.workspace.status_text_set(HELP)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.area.tag_redraw()
        if event.type in {"ESC", "RIGHTMOUSE"}:
            return self._ended(context, {"CANCELLED"})
        self._end = event.mouse_region_x, event.mouse_region_y
        if event.type == "LEFTMOUSE" and event.value == "PRESS":
            self._start = self._end
        elif event.type == "LEFTMOUSE" and event.value == "RELEASE" and self._start is not None:
            (x, y), (u, v) = self._start, self._end
            self._ended(context, {"FINISHED"})
            if max(abs(x - u), abs(y - v)) < LEAST_PX:
                return {"CANCELLED"}
            self.left, self.right, self.bottom, self.top = min(x, u), max(x, u), min(y, v), max(y, v)
            self.chosen = not event.ctrl
            return self.execute(context)
        return {"RUNNING_MODAL"}

    def _ended(self, context: bpy.types.Context, how: set[str]) -> set[str]:
        bpy.types.SpaceView3D.draw_handler_remove(self._drawn, "WINDOW")
        context.workspace.status_text_set(None)
        return how

    def _draw(self) -> None:
        import gpu
        from gpu_extras.batch import batch_for_shader

        if self._start is None:
            return
        (x, y), (u, v) = self._start, self._end
        ring = [(x, y, 0.0), (u, y, 0.0), (u, v, 0.0), (x, v, 0.0), (x, y, 0.0)]
        shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
        region = bpy.context.region
        shader.bind()
        shader.uniform_float("viewportSize", (region.width, region.height))
        shader.uniform_float("lineWidth", WIDTH_PX)
        shader.uniform_float("color", COLOR)
        batch_for_shader(shader, "LINE_STRIP", {"pos": ring}).draw(shader)

    def execute(self, context: bpy.types.Context) -> set[str]:
        corners, indices = box_gizmos.corners_shown(context)
        perspective = np.array(context.region_data.perspective_matrix, np.float64)
        size = context.region.width, context.region.height
        inside = within((self.left, self.bottom, self.right, self.top), corners, perspective, size)
        return self.choose(context, indices[inside], self.chosen)


CLASSES = (
    UNVEIL_OT_choose_similar,
    UNVEIL_OT_choose_shown,
    UNVEIL_OT_set_like_active,
    UNVEIL_OT_choose_in_box,
)
