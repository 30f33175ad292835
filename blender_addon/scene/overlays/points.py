# SPDX-License-Identifier: GPL-3.0-or-later
"""A drive's points as dots of a few pixels, drawn over the 3D views: small, in their colours, and no farther than is wished.

They are vertices of a mesh that has no faces, which costs 24 bytes a point in memory, undo steps and the .blend. Blender draws such
a mesh without its colours, and a face for each point is eight times as much; so they are drawn here.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .. import blocks, drive_scene, view

__all__ = ["arrays_of", "shown_points"]

VERTEX = """
void main()
{
  gl_Position = perspective * vec4(pos, 1.0);
  shade = vec4(tone.rgb, 1.0);
  bool far_off = reach > 0.0 && gl_Position.w > reach;
  gl_PointSize = clamp(size * near / max(gl_Position.w, 1e-6), 1.0, 2.0 * size);
  if (far_off) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  }
}
"""
FRAGMENT = """
void main()
{
  vec2 off = gl_PointCoord - vec2(0.5);
  if (dot(off, off) > 0.25) {
    discard;
  }
  color = shade;
}
"""
NEAR_M = 12.0
"""At this distance a dot has the size that was asked for; nearer it grows to twice that, farther it shrinks to a pixel."""

_drawn: Any = None
_made: tuple[Any, Any] | None = None
_shader: Any = None


def shown_points(context: bpy.types.Context) -> bpy.types.Object | None:
    """The object whose points this 3D view shows as dots, None where it shows none.

    Through a camera of the drive they would lie over the photograph that the artist judges: there they are shown on demand alone.
    """
    scene, space = context.scene, context.space_data
    shown = scene.unveil_view
    if "POINTS" not in shown.shown or space is None or not space.overlay.show_overlays:
        return None
    if space.region_3d.view_perspective == "CAMERA" and not shown.points_in_camera:
        return None
    collection = view.shown_drive(scene)
    thing = None if collection is None else blocks.find(bpy.data.objects, blocks.drive_of(collection), "points")
    if thing is None or not any(_is_visible(context.view_layer.layer_collection, c) for c in thing.users_collection):
        return None
    return thing


def _is_visible(layer: bpy.types.LayerCollection, collection: bpy.types.Collection) -> bool:
    """Whether the view layer shows a collection: the object itself is hidden, so that Blender does not draw it, too."""
    if layer.collection == collection:
        return bool(layer.is_visible)
    return any(_is_visible(child, collection) for child in layer.children)


def arrays_of(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) places and (N, 4) colours, linear from 0 to 1, of the points of a mesh; its active colours."""
    places = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", places)
    tones = np.ones(4 * len(mesh.vertices), np.float32)
    active = mesh.color_attributes.active_color
    if active is not None:
        active.data.foreach_get("color", tones)  # what is drawn is encoded by the view
    return places.reshape(-1, 3), tones.reshape(-1, 4)


def _batch(mesh: bpy.types.Mesh) -> Any:
    """On the graphics card; made anew where the points or their colours are others."""
    global _made
    active = mesh.color_attributes.active_color
    key = (mesh.session_uid, mesh.get("unveil_stamp"), len(mesh.vertices), active.name if active else "")
    if _made is None or _made[0] != key:
        from gpu_extras.batch import batch_for_shader

        places, tones = arrays_of(mesh)
        _made = key, batch_for_shader(_program(), "POINTS", {"pos": places, "tone": tones})
    return _made[1]


def _program() -> Any:
    global _shader
    if _shader is None:
        import gpu

        passed = gpu.types.GPUStageInterfaceInfo("unveil_points")
        passed.smooth("VEC4", "shade")
        told = gpu.types.GPUShaderCreateInfo()
        told.vertex_in(0, "VEC3", "pos")
        told.vertex_in(1, "VEC4", "tone")
        told.vertex_out(passed)
        told.fragment_out(0, "VEC4", "color")
        told.push_constant("MAT4", "perspective")
        for name in ("size", "near", "reach"):
            told.push_constant("FLOAT", name)
        told.vertex_source(VERTEX)
        told.fragment_source(FRAGMENT)
        _shader = gpu.shader.create_from_info(told)
    return _shader


def _draw() -> None:
    context = bpy.context
    thing = shown_points(context)
    if thing is None or not len(thing.data.vertices):
        return
    import gpu

    shown, metre = context.scene.unveil_view, drive_scene.metre_of(context.scene)
    batch, shader = _batch(thing.data), _program()
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    gpu.state.program_point_size_set(True)
    shader.bind()
    shader.uniform_float("perspective", context.region_data.perspective_matrix @ thing.matrix_world)
    shader.uniform_float("size", shown.point_size * context.preferences.system.pixel_size)
    shader.uniform_float("near", NEAR_M * metre)
    shader.uniform_float("reach", shown.point_reach * metre)
    batch.draw(shader)
    gpu.state.program_point_size_set(False)
    gpu.state.depth_mask_set(False)
    gpu.state.depth_test_set("NONE")


def register() -> None:
    global _drawn
    if not bpy.app.background:
        _drawn = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_VIEW")


def unregister() -> None:
    global _drawn, _made, _shader
    if _drawn is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_drawn, "WINDOW")
    _drawn = _made = _shader = None
