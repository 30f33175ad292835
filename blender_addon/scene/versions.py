# SPDX-License-Identifier: GPL-3.0-or-later
"""What differs between Blender 4.2 LTS and 5.3: the one module that asks which Blender this is.

Ask whether something is there rather than for a version where that is possible.
"""

from __future__ import annotations

import os
from typing import Any

import bpy
from mathutils import Color

__all__ = [
    "MATH_NODE",
    "MIX_NODE",
    "PATH",
    "alpha_over_sockets",
    "compositor_of",
    "content_length",
    "empty_compositor",
    "fcurve_of",
    "four_floats",
    "has_native_splats",
    "has_window",
    "mix_sockets",
    "new_splat_cloud",
    "place_strip",
    "scale_to_render",
    "set_brush_color",
    "set_map_uv_filter",
    "show_in_sequencer",
    "shown_compositor",
    "still_pictures",
    "strip_files",
    "strips_of",
    "switch_compositor_on",
]


_RELATIVE = "is_path_supports_blend_relative" in bpy.types.Property.bl_rna.properties
PATH = {"ANIMATABLE", "PATH_SUPPORTS_BLEND_RELATIVE"} if _RELATIVE else {"ANIMATABLE"}
"""Options of a property that holds a path: since 5.0 Blender wants to be told that ``//`` may stand in it."""


def has_window() -> bool:
    """Whether events and timers run: not with ``--background``, nor in Blender as a Python module."""
    return not bpy.app.background and not getattr(bpy.app, "module", False)


def fcurve_of(datablock: Any, action: Any, data_path: str, index: int = 0) -> Any:
    """A new f-curve of an action that is already assigned to the data block: an object, a camera, a scene.

    Actions have slots since 4.4; 5.0 dropped ``action.fcurves``.
    """
    if hasattr(action, "fcurve_ensure_for_datablock"):
        return action.fcurve_ensure_for_datablock(datablock, data_path, index=index)
    if hasattr(action, "slots"):
        animation = datablock.animation_data
        if animation.action_slot is None:
            animation.action_slot = action.slots.new(id_type=datablock.id_type, name=datablock.name)
        layer = action.layers[0] if action.layers else action.layers.new("Layer")
        strip = layer.strips[0] if layer.strips else layer.strips.new(type="KEYFRAME")
        curves = strip.channelbag(animation.action_slot, ensure=True).fcurves
    else:
        curves = action.fcurves
    return curves.find(data_path, index=index) or curves.new(data_path, index=index)


def strips_of(scene: Any) -> Any:
    """The strips of a scene's sequence editor, which is made where there is none; called sequences up to 4.3."""
    editor = scene.sequence_editor or scene.sequence_editor_create()
    return editor.strips if hasattr(editor, "strips") else editor.sequences


def show_in_sequencer(context: Any, scene: Any) -> None:
    """Let the Video Sequencer show a scene where it shows none: since 5.0 that need not be the window's scene."""
    workspace = getattr(context, "workspace", None)
    if workspace is not None and getattr(workspace, "sequencer_scene", scene) is None:
        workspace.sequencer_scene = scene


def place_strip(strip: Any, start: int, length: int | None = None) -> None:
    """Let an image strip begin at a frame and, where a length is given, last so many: renamed in 5.1, the old names go in 6.0."""
    is_new = "content_start" in strip.bl_rna.properties
    if length is not None:
        setattr(strip, "duration" if is_new else "frame_final_duration", length)
    setattr(strip, "content_start" if is_new else "frame_start", start)


def content_length(strip: Any) -> int:
    """Pictures of a strip's file, whatever part of it is shown: renamed in 5.1."""
    return int(strip.content_duration if "content_duration" in strip.bl_rna.properties else strip.frame_duration)


def still_pictures(settings: Any) -> None:
    """Let a scene's output be pictures, not a movie: since 5.0 that is said before the format."""
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"


def empty_compositor(scene: Any) -> tuple[Any, Any]:
    """A new compositor of a scene that has none: its node tree, and the socket that takes the result."""
    if not hasattr(scene, "compositor_effects") and not hasattr(scene, "compositing_node_group"):
        scene.use_nodes = True
        scene.node_tree.nodes.clear()
        return scene.node_tree, scene.node_tree.nodes.new("CompositorNodeComposite").inputs[0]
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    if hasattr(scene, "compositor_effects"):
        scene.compositor_effects.new("Compositing").node_group = tree
    else:
        scene.compositing_node_group = tree
    return tree, tree.nodes.new("NodeGroupOutput").inputs[0]


def strip_files(strip: Any) -> list[str]:
    """Absolute paths of an image strip's pictures."""
    folder = bpy.path.abspath(strip.directory)
    return [os.path.join(folder, e.filename) for e in strip.elements]


def has_native_splats() -> bool:
    """Whether this Blender draws Gaussians itself: a point cloud can have that type, and what it needs can be set from Python."""
    return bool(_splat_type()) and four_floats()[0] == "FLOAT4" and "resize" in bpy.types.PointCloud.bl_rna.functions


def _splat_type() -> str:
    """The identifier of Gaussians among the types of point clouds; empty where there is none. 5.3 has GAUSSIAN_SPLAT."""
    kind = bpy.types.PointCloud.bl_rna.properties.get("type")
    if kind is None or kind.type != "ENUM" or kind.is_readonly:
        return ""
    return next((item.identifier for item in kind.enum_items if "SPLAT" in item.identifier), "")


def four_floats() -> tuple[str, str]:
    """The type of an attribute of four floats, and the name of its value; a colour where there is none for plain numbers."""
    known = bpy.types.Attribute.bl_rna.properties["data_type"].enum_items
    return ("FLOAT4", "vector") if "FLOAT4" in known else ("FLOAT_COLOR", "color")


def new_splat_cloud(name: str, count: int) -> Any:
    """A point cloud of Gaussians with so many points, for a Blender that has them."""
    cloud = bpy.data.pointclouds.new(name)
    cloud.type = _splat_type()
    cloud.resize(count)
    return cloud


MATH_NODE, MIX_NODE = (
    ("CompositorNodeMath", "CompositorNodeMixRGB")
    if hasattr(bpy.types, "CompositorNodeMixRGB")
    else ("ShaderNodeMath", "ShaderNodeMix")
)
"""Nodes of the compositor: since 5.0 it shares these with shaders."""


def mix_sockets(node: Any, blend: str) -> tuple[Any, Any, Any, Any]:
    """Factor, the two colours and the result of a mix node, set to mix colours in that way."""
    if node.bl_idname == "ShaderNodeMix":
        node.data_type = "RGBA"
    node.blend_type = blend
    if node.bl_idname != "ShaderNodeMix":
        return (*node.inputs[:3], node.outputs[0])
    inputs = {s.identifier: s for s in node.inputs}
    result = next(s for s in node.outputs if s.identifier == "Result_Color")
    return inputs["Factor_Float"], inputs["A_Color"], inputs["B_Color"], result


def set_map_uv_filter(node: Any, smooth: bool) -> None:
    """How a Map UV node reads between pixels: as sharply as it can, or the nearest. A property up to 4.5, an input since 5.0.

    Of a wave of 19 pixels bilinear is off by 0.5 % of the amplitude, bicubic by 1.1 %, anisotropic by 2 %: these two smooth.
    Where the filter is a property, nothing else is as sharp as anisotropic (1.5 %).
    """
    if hasattr(node, "filter_type"):
        node.filter_type = "ANISOTROPIC" if smooth else "NEAREST"
    else:
        node.inputs["Interpolation"].default_value = "Bilinear" if smooth else "Nearest"


def _plain_compositor(scene: Any) -> Any:
    """A new tree that gives what was rendered."""
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    rendered, result = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("NodeGroupOutput")
    rendered.scene = scene
    result.location.x = 400
    tree.links.new(rendered.outputs["Image"], result.inputs["Image"])
    return tree


def compositor_of(scene: Any) -> Any:
    """The compositor's node tree of a scene; where there is none, one that gives what was rendered.

    Up to 4.5 a tree may be there and be switched off: so it stays. Since 5.3 a scene has a list of effects, each with a tree: it is
    that of the active one.
    """
    effects = getattr(scene, "compositor_effects", None)
    if effects is not None:
        effect = effects.active or (effects[0] if len(effects) else effects.new("Compositing"))
        if effect.node_group is None:
            effect.node_group = _plain_compositor(scene)
        return effect.node_group
    if not hasattr(scene, "compositing_node_group"):
        if scene.node_tree is None:
            scene.use_nodes = True  # Blender makes the tree
        return scene.node_tree
    if scene.compositing_node_group is None:
        scene.compositing_node_group = _plain_compositor(scene)
    return scene.compositing_node_group


def alpha_over_sockets(node: Any) -> tuple[Any, Any]:
    """What lies below and what lies above, of an Alpha Over node: named and ordered anew in 5.0."""
    named = {s.name: s for s in node.inputs}
    if "Background" in named:
        return named["Background"], named["Foreground"]
    return node.inputs[1], node.inputs[2]


def scale_to_render(node: Any) -> None:
    """Let a Scale node of the compositor give its picture the size of the render: a property up to 4.5, an input since 5.0."""
    if hasattr(node, "space"):
        node.space, node.frame_method = "RENDER_SIZE", "STRETCH"
    else:
        node.inputs["Type"].default_value, node.inputs["Frame Type"].default_value = "Render Size", "Stretch"


def shown_compositor(scene: Any) -> Any:
    """The compositor's node tree of a scene as it is, None where there is none: drawing makes nothing."""
    effects = getattr(scene, "compositor_effects", None)
    if effects is not None:
        return None if effects.active is None else effects.active.node_group
    if hasattr(scene, "compositing_node_group"):
        return scene.compositing_node_group
    return scene.node_tree


def switch_compositor_on(scene: Any) -> None:
    """Let a render go through the scene's compositor: up to 4.5 its tree may be there and be switched off."""
    scene.render.use_compositing = True
    if "compositing_node_group" not in scene.bl_rna.properties:  # asked of the class: the name is deprecated in 5.3
        scene.use_nodes = True


def set_brush_color(settings: Any, linear: tuple[float, float, float]) -> None:
    """Give the brush of Image Editors a colour, scene linear: its own, and the one that brushes share.

    The shared one is of all modes up to 4.5, of each since 5.0. Colours of brushes are encoded as sRGB up to 4.5.
    """
    paint = settings.image_paint
    shared = getattr(paint, "unified_paint_settings", None) or settings.unified_paint_settings
    for holder in (shared, paint.brush):
        if holder is None:
            continue
        encoded = holder.bl_rna.properties["color"].subtype == "COLOR_GAMMA"
        color = Color(linear)
        holder.color = color.from_scene_linear_to_srgb() if encoded else color
