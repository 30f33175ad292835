# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects' boxes in the viewport, as one gizmo: it lights up what the pointer is on, and a click chooses it.

A gizmo works whatever tool is active. Hit testing is in ``boxes.pick`` and :func:`box_at`, drawing in :func:`lines_of`.
"""

from __future__ import annotations

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

from . import selection, view
from .boxes import EDGES, pick

__all__ = ["box_at", "lines_of"]

STAYS, GOES, MOVES, POINTED = (
    (0.25, 0.75, 1.0, 0.75),
    (1.0, 0.3, 0.08, 1.0),
    (1.0, 0.75, 0.1, 0.7),
    (1.0, 1.0, 1.0, 1.0),
)
WIDTH_PX, ACTIVE_PX = 1.5, 3.0


def _shown(context: bpy.types.Context) -> list[selection.UnveilObject]:
    """Objects whose boxes are drawn; wire cubes draw themselves and are moved by the artist's own clicks."""
    scene = context.scene
    if not scene.unveil_selection.show_boxes or not selection.current(scene) or view.shown_drive(scene) is None:
        return []
    return [o for o in scene.unveil_selection.objects if o.boxed and o.source != "box"]


def box_at(context: bpy.types.Context, pointer: tuple[float, float]) -> int | None:
    """The id of the object whose box lies under the pointer (pixels of the region), None where there is none."""
    region, perspective = context.region, context.region_data
    matrix = perspective.view_matrix
    things = _shown(context)
    outlines: list[np.ndarray | None] = []
    depths = []
    for thing in things:
        box = selection.box_of(thing)
        assert box is not None
        corners = [location_3d_to_region_2d(region, perspective, c) for c in box.corners]
        before = all(c is not None for c in corners)
        outlines.append(np.array([tuple(c) for c in corners]) if before else None)
        depths.append(-(matrix @ Vector(box.centre)).z)
    found = pick(pointer, outlines, depths)
    return None if found is None else things[found].number


def lines_of(context: bpy.types.Context, pointed: int | None) -> list[tuple[list[tuple], tuple, float]]:
    """What is drawn: (ends of edges, colour, width in pixels) for each box, the one pointed at last."""
    scene = context.scene
    listed = scene.unveil_selection
    active = listed.objects[listed.active].number if 0 <= listed.active < len(listed.objects) else None
    found = []
    for thing in _shown(context):
        box = selection.box_of(thing)
        assert box is not None
        corners = [tuple(float(v) for v in c) for c in box.corners]
        ends = [corners[i] for edge in EDGES for i in edge]
        color = MOVES if thing.moves else GOES if thing.chosen else STAYS
        width = ACTIVE_PX if thing.number == active else WIDTH_PX
        if thing.number == pointed:
            color, width = POINTED, ACTIVE_PX
        found.append((ends, color, width))
    return sorted(found, key=lambda line: line[1] == POINTED)


class UNVEIL_GT_boxes(bpy.types.Gizmo):
    """All boxes of the drive."""

    bl_idname = "UNVEIL_GT_boxes"
    __slots__ = ("clicked", "pointed")

    def setup(self) -> None:
        self.pointed: int | None = None
        # Properties of the operator that a click runs, which makes the undo step, too.
        self.clicked = self.target_set_operator("unveil.toggle_object")

    def draw(self, context: bpy.types.Context) -> None:
        import gpu
        from gpu_extras.batch import batch_for_shader

        shader = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
        width, height = context.region.width, context.region.height
        gpu.state.blend_set("ALPHA")
        gpu.state.depth_test_set("NONE")
        pixel = context.preferences.system.pixel_size
        for ends, color, line_width in lines_of(context, self.pointed if self.is_highlight else None):
            batch = batch_for_shader(shader, "LINES", {"pos": ends})
            shader.bind()
            shader.uniform_float("viewportSize", (width, height))
            shader.uniform_float("lineWidth", line_width * pixel)
            shader.uniform_float("color", color)
            batch.draw(shader)
        gpu.state.blend_set("NONE")

    def test_select(self, context: bpy.types.Context, location: tuple[float, float]) -> int:
        found = box_at(context, (float(location[0]), float(location[1])))
        if found != self.pointed:
            self.pointed = found
            if context.area is not None:
                context.area.tag_redraw()
        if found is None:
            return -1
        self.clicked.number = found
        return 0


class UNVEIL_GGT_boxes(bpy.types.GizmoGroup):
    """Shown in every 3D view of a scene that has a drive."""

    bl_idname = "UNVEIL_GGT_boxes"
    bl_label = "Unveil boxes"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"3D", "PERSISTENT", "SHOW_MODAL_ALL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode == "OBJECT" and bool(_shown(context))

    def setup(self, context: bpy.types.Context) -> None:
        gizmo = self.gizmos.new(UNVEIL_GT_boxes.bl_idname)
        gizmo.use_draw_modal = True
        gizmo.use_draw_scale = False


CLASSES = (UNVEIL_GT_boxes, UNVEIL_GGT_boxes)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
