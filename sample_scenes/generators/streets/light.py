"""Sun, sky and lamps."""

from __future__ import annotations

import math

import bpy

from sample_scenes.generators.streets.furniture import lamp_place
from sample_scenes.generators.streets.plan import Light, Plan

LAMPS_LIT = 10
"""So many lamps, the nearest to the way, give light at dusk: each costs samples."""
LAMP_WATTS = 90.0


def build_light(scene: bpy.types.Scene, plan: Plan) -> None:
    """All light of the street."""
    light = plan.light
    if light.sun > 0:
        _sun(scene, light)
    _sky(scene, light)
    if light.kind == "dusk":
        places = [(post.s, lamp_place(leg, post)) for leg in plan.legs for post in leg.posts if post.kind == "lamp"]
        places.sort(key=lambda p: min(math.dist(p[1][:2], q[:2]) for q in plan.route_xyz[::20]))
        for _, place in places[:LAMPS_LIT]:
            data = bpy.data.lights.new("lamp", "SPOT")
            data.energy, data.color, data.shadow_soft_size = LAMP_WATTS, (1.0, 0.74, 0.42), 0.25
            data.spot_size, data.spot_blend = math.radians(150), 0.6
            lamp = bpy.data.objects.new("lamp", data)
            lamp.location = tuple(place)
            scene.collection.objects.link(lamp)


def _sun(scene: bpy.types.Scene, light: Light) -> None:
    data = bpy.data.lights.new("sun", "SUN")
    low = max(0.0, 1 - light.elevation / 40)
    data.energy, data.angle = light.sun, math.radians(0.6 if light.kind == "sun" else 8.0)
    data.color = (1.0, 0.95 - 0.22 * low, 0.87 - 0.42 * low)
    sun = bpy.data.objects.new("sun", data)
    sun.rotation_euler = (math.radians(90 - light.elevation), 0.0, math.radians(light.azimuth))
    scene.collection.objects.link(sun)


def _sky(scene: bpy.types.Scene, light: Light) -> None:
    """A gradient from the horizon up with soft clouds; brown below the horizon."""
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    scene.world = world
    world.cycles.sampling_method = "MANUAL"
    world.cycles.sample_map_resolution = 256
    tree = world.node_tree
    tree.nodes.clear()
    new, wire = tree.nodes.new, tree.links.new
    output, background = new("ShaderNodeOutputWorld"), new("ShaderNodeBackground")
    place, split, ramp = new("ShaderNodeTexCoord"), new("ShaderNodeSeparateXYZ"), new("ShaderNodeValToRGB")
    low, high = {
        "sun": ((0.62, 0.74, 0.88), (0.13, 0.31, 0.68)), "overcast": ((0.72, 0.75, 0.78), (0.84, 0.86, 0.88)),
        "dusk": ((0.85, 0.52, 0.34), (0.10, 0.14, 0.32)),
    }[light.kind]  # fmt: skip
    elements = ramp.color_ramp.elements
    elements[0].position, elements[0].color = 0.0, (0.22, 0.21, 0.18, 1)
    elements[1].position, elements[1].color = 1.0, (*high, 1)
    for position, color in ((0.499, (0.24, 0.23, 0.2)), (0.503, low), (0.72, high)):
        element = elements.new(position)
        element.color = (*color, 1)
    half = new("ShaderNodeMath")
    half.operation = "MULTIPLY_ADD"
    half.inputs[1].default_value = half.inputs[2].default_value = 0.5
    wire(place.outputs["Generated"], split.inputs[0])
    wire(split.outputs[2], half.inputs[0])
    wire(half.outputs[0], ramp.inputs[0])
    color = ramp.outputs[0]
    if 0 < light.clouds < 1:
        noise, clouds, mix = new("ShaderNodeTexNoise"), new("ShaderNodeValToRGB"), new("ShaderNodeMix")
        noise.inputs["Scale"].default_value, noise.inputs["Detail"].default_value = 3.0, 4.0
        start = 0.68 - 0.3 * light.clouds
        clouds.color_ramp.elements[0].position, clouds.color_ramp.elements[1].position = start, start + 0.2
        above, factor = new("ShaderNodeMath"), new("ShaderNodeMath")
        above.operation, factor.operation = "GREATER_THAN", "MULTIPLY"
        above.inputs[1].default_value = 0.01
        mix.data_type = "RGBA"
        mix.inputs[7].default_value = (0.93, 0.94, 0.96, 1) if light.kind == "sun" else (0.42, 0.33, 0.36, 1)
        wire(place.outputs["Generated"], noise.inputs["Vector"])
        wire(noise.outputs[0], clouds.inputs[0])
        wire(split.outputs[2], above.inputs[0])
        wire(clouds.outputs[0], factor.inputs[0])
        wire(above.outputs[0], factor.inputs[1])
        wire(factor.outputs[0], mix.inputs[0])
        wire(color, mix.inputs[6])
        color = mix.outputs[2]
    wire(color, background.inputs[0])
    background.inputs[1].default_value = light.sky
    wire(background.outputs[0], output.inputs[0])
