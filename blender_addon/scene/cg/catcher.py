# SPDX-License-Identifier: GPL-3.0-or-later
"""The mesh of the empty street as what takes shadows and hides what is behind it, itself unseen in the render."""

from __future__ import annotations

import math

import bpy

from .. import blocks

__all__ = ["add_sky", "add_sun", "catch"]

SUN = "cg:sun"
STRENGTH, ANGLE = 3.0, math.radians(0.53)
"""W/m², and the angle that the sun is wide."""
FACTORY_SKY, SKY = 0.0509, (0.20, 0.24, 0.30, 1.0)
"""What a new file has, in which a shadow is black; and what makes it a third as bright as the sunlit street."""


def catch(mark: str, thing: bpy.types.Object) -> None:
    """Make the street's mesh a shadow catcher, with a material that light falls on: that of the views is unlit."""
    thing.is_shadow_catcher = True
    thing.hide_render = False
    if not thing.material_slots:
        return
    slot = thing.material_slots[0]
    slot.link = "OBJECT"
    slot.material = _lit(mark)


def _lit(mark: str) -> bpy.types.Material:
    material = blocks.find(bpy.data.materials, mark, "cg:material")
    if material is not None:
        return material
    material = bpy.data.materials.new("Street for Shadows")
    blocks.mark(material, mark, "cg:material")
    if material.node_tree is None:
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    kinds = ("ShaderNodeVertexColor", "ShaderNodeBsdfDiffuse", "ShaderNodeOutputMaterial")
    colors, surface, output = (nodes.new(kind) for kind in kinds)
    for i, node in enumerate((colors, surface, output)):
        node.location = (220 * i, 0)
    links.new(colors.outputs["Color"], surface.inputs["Color"])
    links.new(surface.outputs["BSDF"], output.inputs["Surface"])
    return material


def add_sun(
    scene: bpy.types.Scene, collection: bpy.types.Collection, azimuth: float, elevation: float
) -> bpy.types.Object | None:
    """A sun from that direction, where no light is in the scene yet; None where the artist has lit it.

    Args:
        azimuth: clockwise from the y axis, radians; elevation: above the horizon, radians.
    """
    mark = blocks.drive_of(collection)
    own = blocks.find(bpy.data.objects, mark, SUN)
    lights = [o for o in scene.objects if o.type == "LIGHT" and o != own and not o.hide_render and o.visible_get()]
    if lights and own is None:
        return None
    light = blocks.ensure(bpy.data.lights, mark, SUN, lambda: bpy.data.lights.new("Street Sun", "SUN"))
    light.energy, light.angle = STRENGTH, ANGLE
    thing = blocks.ensure_object(light, mark, SUN, "Street Sun", collection)
    thing.rotation_mode = "XYZ"
    thing.rotation_euler = (math.pi / 2 - elevation, 0.0, math.pi - azimuth)
    return thing


def add_sky(scene: bpy.types.Scene) -> bool:
    """Brighten the world of a new file, where nobody has touched it; returns whether that was done."""
    tree = None if scene.world is None or not blocks.is_own(scene.world) else scene.world.node_tree
    nodes = [] if tree is None else [n for n in tree.nodes if n.type == "BACKGROUND"]
    if len(nodes) != 1 or nodes[0].inputs["Color"].is_linked or nodes[0].inputs["Strength"].default_value != 1.0:
        return False
    color = nodes[0].inputs["Color"]
    if any(abs(v - FACTORY_SKY) > 1e-3 for v in color.default_value[:3]):
        return False
    color.default_value = SKY
    return True
