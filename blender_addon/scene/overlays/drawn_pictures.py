# SPDX-License-Identifier: GPL-3.0-or-later
"""Two pictures compared, over a camera's view and in the Image Editor: wiped, subtracted, or with their origins."""

from __future__ import annotations

from typing import Any

import bpy

from .. import view
from . import compared

__all__ = ["frame_in_view", "part_drawn"]

VERTEX = """
void main()
{
  gl_Position = ModelViewProjectionMatrix * vec4(pos, 0.0, 1.0);
  place = at;
}
"""
FRAGMENT = """
void main()
{
  vec4 b = texture(other, place);
  color = vec4(b.rgb, 1.0);
  if (mode == 1) {
    vec3 off = abs(pow(texture(shown, place).rgb, vec3(1.0 / 2.2)) - pow(b.rgb, vec3(1.0 / 2.2)));
    float much = clamp(4.0 * max(off.r, max(off.g, off.b)), 0.0, 1.0);
    color = vec4(pow(vec3(much, much * much, 0.15 * much), vec3(2.2)), 1.0);
  }
  if (mode == 2) {
    color.a = max(b.r, max(b.g, b.b)) > 0.003 ? 0.55 : 0.0;
  }
}
"""
MODES = {"WIPE": 0, "DIFFERENCE": 1, "ORIGIN": 2}
LINE, LINE_PX = (1.0, 1.0, 1.0, 0.9), 2.0

_handlers: list[tuple[Any, Any]] = []
_shader: Any = None

Rectangle = tuple[float, float, float, float]


def frame_in_view(context: bpy.types.Context) -> Rectangle | None:
    """Left, bottom, right, top of the camera's picture in a 3D view, pixels of the region; None in other views."""
    from bpy_extras.view3d_utils import location_3d_to_region_2d

    scene, space = context.scene, context.space_data
    camera = scene.camera
    if space is None or space.type != "VIEW_3D" or camera is None or space.region_3d.view_perspective != "CAMERA":
        return None
    corners = [
        location_3d_to_region_2d(context.region, space.region_3d, camera.matrix_world @ corner)
        for corner in camera.data.view_frame(scene=scene)
    ]
    if any(c is None for c in corners):
        return None
    return corners[2].x, corners[2].y, corners[0].x, corners[0].y


def part_drawn(mode: str, wipe: float) -> tuple[float, float]:
    """From and to which share of the picture's width the other one is drawn."""
    return (wipe, 1.0) if mode == "WIPE" else (0.0, 1.0)


def _frame_in_editor(context: bpy.types.Context) -> Rectangle | None:
    """The same of an Image Editor that shows a picture of the add-on's."""
    image = getattr(context.space_data, "image", None)
    role = "" if image is None else str(image.get("unveil_role", ""))
    if not role.startswith(("plate:", "fix:", "keyframe:")):
        return None
    to_region = context.region.view2d.view_to_region
    left, bottom = to_region(0.0, 0.0, clip=False)
    right, top = to_region(1.0, 1.0, clip=False)
    return left, bottom, right, top


def _program() -> Any:
    global _shader
    if _shader is None:
        import gpu

        passed = gpu.types.GPUStageInterfaceInfo("unveil_pictures")
        passed.smooth("VEC2", "place")
        told = gpu.types.GPUShaderCreateInfo()
        told.vertex_in(0, "VEC2", "pos")
        told.vertex_in(1, "VEC2", "at")
        told.vertex_out(passed)
        told.fragment_out(0, "VEC4", "color")
        told.push_constant("MAT4", "ModelViewProjectionMatrix")
        told.push_constant("INT", "mode")
        told.sampler(0, "FLOAT_2D", "shown")
        told.sampler(1, "FLOAT_2D", "other")
        told.vertex_source(VERTEX)
        told.fragment_source(FRAGMENT)
        _shader = gpu.shader.create_from_info(told)
    return _shader


def _draw(where: Any) -> None:
    context = bpy.context
    frame, pictures = where(context), compared.pictures_compared(context.scene)
    if frame is None or pictures is None or not getattr(context.space_data.overlay, "show_overlays", True):
        return
    import gpu
    from gpu_extras.batch import batch_for_shader

    shown: view.UnveilView = context.scene.unveil_view
    left, bottom, right, top = frame
    begin, end = part_drawn(shown.compare, shown.wipe)
    across = [left + share * (right - left) for share in (begin, end)]
    corners = [(across[i], (bottom, top)[j]) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    at = [((begin, end)[i], float(j)) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    shader = _program()
    batch = batch_for_shader(shader, "TRIS", {"pos": corners, "at": at}, indices=((0, 1, 2), (0, 2, 3)))
    gpu.state.blend_set("ALPHA")
    shader.bind()
    shader.uniform_float(
        "ModelViewProjectionMatrix", gpu.matrix.get_projection_matrix() @ gpu.matrix.get_model_view_matrix()
    )
    shader.uniform_int("mode", MODES[shown.compare])
    for name, image in zip(("shown", "other"), pictures, strict=True):
        shader.uniform_sampler(name, gpu.texture.from_image(image))
    batch.draw(shader)
    if shown.compare == "WIPE":
        line = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR")
        line.bind()
        line.uniform_float("viewportSize", (context.region.width, context.region.height))
        line.uniform_float("lineWidth", LINE_PX * context.preferences.system.pixel_size)
        line.uniform_float("color", LINE)
        batch_for_shader(line, "LINES", {"pos": [(across[0], bottom, 0.0), (across[0], top, 0.0)]}).draw(line)
    gpu.state.blend_set("NONE")


def register() -> None:
    if bpy.app.background:
        return
    for space, where in ((bpy.types.SpaceView3D, frame_in_view), (bpy.types.SpaceImageEditor, _frame_in_editor)):
        _handlers.append((space, space.draw_handler_add(_draw, (where,), "WINDOW", "POST_PIXEL")))


def unregister() -> None:
    global _shader
    while _handlers:
        space, handler = _handlers.pop()
        space.draw_handler_remove(handler, "WINDOW")
    _shader = None
