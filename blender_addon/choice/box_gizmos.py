# SPDX-License-Identifier: GPL-3.0-or-later
"""The objects' boxes in the viewport, as one gizmo: it lights up what the pointer is on, and a click chooses it.

It answers in a tool of its own, and while the sidebar shows the add-on's tab. Hit testing is in ``boxes.pick`` and
:func:`box_at`, drawing in :func:`lines_of`.
"""

from __future__ import annotations

import bpy
import numpy as np

from ..formats.boxes import EDGES, corners_of, pick
from ..scene import view
from . import selection
from .tool import answers_clicks, is_tool

__all__ = ["GOES", "MOVES", "STAYS", "box_at", "corners_shown", "ghosts_of", "lines_of"]

STAYS, GOES, MOVES, POINTED = (
    (0.25, 0.75, 1.0, 0.75),
    (1.0, 0.3, 0.08, 1.0),
    (1.0, 0.75, 0.1, 0.7),
    (1.0, 1.0, 1.0, 1.0),
)
GHOST = (1.0, 0.45, 0.1, 0.12)
WIDTH_PX, ACTIVE_PX = 1.5, 3.0
FACES = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 5, 7],
        [4, 7, 6],
        [0, 1, 5],
        [0, 5, 4],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 3, 7],
        [1, 7, 5],
    ]
)
"""Triangles of a box's six sides."""
MOST_HITS, BEHIND = 4, 1e-3
"""Surfaces of the drive's own that are looked behind for an object of the artist's, and how far behind each."""


def _shown(context: bpy.types.Context) -> np.ndarray | None:
    """Indices of the objects whose boxes are drawn, None where none is; wire cubes are Blender's to draw and to select."""
    scene = context.scene
    listed = scene.unveil_selection
    if listed.boxes == "NONE" or not selection.current(scene) or view.shown_drive(scene) is None:
        return None
    wanted = selection.column(listed, "boxed", bool)
    if listed.boxes == "GOING":
        wanted &= _goes(listed)
    if listed.boxes == "ACTIVE":
        wanted &= np.arange(len(wanted)) == listed.active
    shown = np.flatnonzero(wanted)
    return shown if len(shown) else None


def _goes(listed: selection.UnveilSelection) -> np.ndarray:
    """(N,) whether an object is to go."""
    return selection.column(listed, "chosen", bool) | selection.column(listed, "moves", bool)


def corners_shown(context: bpy.types.Context) -> tuple[np.ndarray, np.ndarray]:
    """Corners (N, 8, 3) of the boxes that are drawn, and the indices (N,) of their objects."""
    shown = _shown(context)
    shown = np.zeros(0, np.int64) if shown is None else shown
    return _corners(context.scene, shown), shown


def _corners(scene: bpy.types.Scene, shown: np.ndarray) -> np.ndarray:
    """(N, 8, 3)."""
    parts = (("centre", 3), ("size", 3), ("yaw", 1))
    columns = (selection.column(scene.unveil_selection, name, float, width) for name, width in parts)
    return corners_of(*(c[shown].astype(np.float64) for c in columns))


def box_at(context: bpy.types.Context, pointer: tuple[float, float]) -> int | None:
    """The id of the object whose box lies under the pointer (pixels of the region), None where there is none."""
    shown = _shown(context)
    if shown is None:
        return None
    perspective = np.array(context.region_data.perspective_matrix, np.float64)
    size = context.region.width, context.region.height
    found = pick(pointer, _corners(context.scene, shown), perspective, size)
    return None if found is None else int(selection.column(context.scene.unveil_selection, "number", int)[shown[found]])


def hits_artists_object(context: bpy.types.Context, pointer: tuple[float, float]) -> bool:
    """Whether the pointer is on an object that is none of the drive's: with other tools than ours a click is for that."""
    from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d

    region, region_data = context.region, context.region_data
    origin = region_2d_to_origin_3d(region, region_data, pointer)
    direction = region_2d_to_vector_3d(region, region_data, pointer)
    graph = context.evaluated_depsgraph_get()
    for _ in range(MOST_HITS):
        found, place, _, _, thing, _ = context.scene.ray_cast(graph, origin, direction)
        if not found:
            return False
        if not thing.original.get("unveil_role"):
            return True
        origin = place + direction * BEHIND
    return False


def lines_of(context: bpy.types.Context, pointed: int | None) -> list[tuple[np.ndarray, tuple, float]]:
    """What is drawn: (ends of edges (M, 3), colour, width in pixels) of all boxes that look alike, the one pointed at last."""
    scene, shown = context.scene, _shown(context)
    if shown is None:
        return []
    listed = scene.unveil_selection
    number, chosen, moves = (
        selection.column(listed, n, k)[shown] for n, k in (("number", int), ("chosen", bool), ("moves", bool))
    )
    ends = _corners(scene, shown)[:, np.array(EDGES).ravel()].astype(np.float32)
    is_pointed = number == (-1 if pointed is None else pointed)
    is_active = (shown == listed.active) & ~is_pointed
    if scene.unveil_view.state == "AFTER" and listed.boxes == "ALL":  # they would cover the result
        chosen, moves, stays = chosen & is_active, moves & is_active, ~chosen & ~moves & is_active
    else:
        stays = ~chosen & ~moves
    found = []
    for color, own in ((STAYS, stays), (GOES, chosen & ~moves), (MOVES, moves)):
        for width, part in ((WIDTH_PX, own & ~is_active & ~is_pointed), (ACTIVE_PX, own & is_active)):
            found.append((ends[part].reshape(-1, 3), color, width))
    found.append((ends[is_pointed].reshape(-1, 3), POINTED, ACTIVE_PX))
    return [line for line in found if len(line[0])]


def ghosts_of(context: bpy.types.Context) -> np.ndarray:
    """(M, 3) corners of triangles that fill the boxes of what goes; none where no ghosts are wanted."""
    listed, (corners, shown) = context.scene.unveil_selection, corners_shown(context)
    if not listed.ghosts or not len(shown):
        return np.zeros((0, 3), np.float32)
    faces = corners[_goes(listed)[shown]][:, FACES.ravel()]
    return faces.reshape(-1, 3).astype(np.float32)


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
        ghosts = ghosts_of(context)
        if len(ghosts):
            filled = gpu.shader.from_builtin("UNIFORM_COLOR")
            filled.bind()
            filled.uniform_float("color", GHOST)
            batch_for_shader(filled, "TRIS", {"pos": ghosts}).draw(filled)
        for ends, color, line_width in lines_of(context, self.pointed if self.is_highlight else None):
            batch = batch_for_shader(shader, "LINES", {"pos": ends})
            shader.bind()
            shader.uniform_float("viewportSize", (width, height))
            shader.uniform_float("lineWidth", line_width * pixel)
            shader.uniform_float("color", color)
            batch.draw(shader)
        gpu.state.blend_set("NONE")

    def test_select(self, context: bpy.types.Context, location: tuple[float, float]) -> int:
        place = float(location[0]), float(location[1])
        found = box_at(context, place)
        if found is not None and not is_tool(context) and hits_artists_object(context, place):
            found = None  # it is a click on that
        if found != self.pointed:
            self.pointed = found
            if context.area is not None:
                context.area.tag_redraw()
        if found is None:
            return -1
        self.clicked.number = found
        return 0


class UNVEIL_GGT_boxes(bpy.types.GizmoGroup):
    """Shown in the 3D views that answer clicks, of a scene that has a drive."""

    bl_idname = "UNVEIL_GGT_boxes"
    bl_label = "Unveil boxes"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"3D", "PERSISTENT", "SHOW_MODAL_ALL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.mode == "OBJECT" and answers_clicks(context) and _shown(context) is not None

    def setup(self, context: bpy.types.Context) -> None:
        gizmo = self.gizmos.new(UNVEIL_GT_boxes.bl_idname)
        gizmo.use_draw_modal = True
        gizmo.use_draw_scale = False


CLASSES = (UNVEIL_GT_boxes, UNVEIL_GGT_boxes)
