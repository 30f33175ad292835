"""A country road: open land, little texture, a slope, much vegetation, no house; built with the street's own tools."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "parked_street"))
import build_street as street  # noqa: E402

LENGTH = (-14.0, 120.0)
LANES, SHOULDER = 3.3, 4.1
"""Half the width of the asphalt's lanes, and of all asphalt."""


def bend() -> None:
    """This road's own course: to the right, uphill by one in eighteen."""
    street.RADIUS, street.SLOPE, street.LENGTH = -130.0, 0.055, LENGTH


def smooth_asphalt():  # type: ignore[no-untyped-def]
    """New asphalt: hardly anything to hold on to."""
    n = street.Nodes("smooth asphalt")
    noise = n.add("ShaderNodeTexNoise", Scale=1.3, Detail=2.0)
    n.link(n.ramp(noise.outputs[0], [(0.35, (0.105, 0.107, 0.11)), (0.65, (0.125, 0.126, 0.128))]), n.bsdf.inputs["Base Color"])
    return n.material


def grass(name: str, low: tuple[float, float, float], high: tuple[float, float, float]):  # type: ignore[no-untyped-def]
    """Grass from afar: two greens in patches of half a metre, and a fine grain."""
    n = street.Nodes(name)
    patches = n.add("ShaderNodeTexNoise", Scale=0.8, Detail=6.0)
    grain = n.add("ShaderNodeTexNoise", Scale=22.0, Detail=2.0)
    position = n.add("ShaderNodeNewGeometry")
    for texture in (patches, grain):
        n.link(position.outputs["Position"], texture.inputs["Vector"])
    color = n.ramp(patches.outputs[0], [(0.35, low), (0.65, high)])
    fine = n.ramp(grain.outputs[0], [(0.3, (0.75, 0.75, 0.75)), (0.7, (1.0, 1.0, 1.0))])
    n.link(n.mix(1.0, color, fine, "MULTIPLY"), n.bsdf.inputs["Base Color"])
    n.bsdf.inputs["Roughness"].default_value = 0.95
    return n.material


def land(materials) -> None:  # type: ignore[no-untyped-def]
    """Road, lines, verges, a bank on the left, a meadow falling away on the right, hills behind."""
    s0, s1 = LENGTH
    road = [(-SHOULDER, 0.0), (-2.0, 0.035), (0.0, 0.05), (2.0, 0.035), (SHOULDER, 0.0)]
    street.strip("road", road, materials["asphalt"], street.ROAD, s0, s1)
    for side in (-1, 1):
        line = [(side * LANES, 0.022), (side * (LANES + 0.12), 0.02)]
        street.strip("edge line", line, materials["paint"], street.ROAD, s0, s1)
    s = s0
    while s < s1:
        street.strip("dash", [(-0.06, 0.055), (0.06, 0.055)], materials["paint"], street.ROAD, s, min(s + 4.0, s1), 0.5)
        s += 12.0
    left = [(SHOULDER, 0.0), (5.2, -0.12), (6.4, 0.0), (9.0, 0.9), (14.0, 2.3), (22.0, 3.0), (45.0, 4.0)]
    right = [(-45.0, -3.2), (-22.0, -1.9), (-12.0, -0.9), (-7.0, -0.35), (-5.4, -0.22), (-SHOULDER, 0.0)]
    street.strip("bank", left, materials["bank"], street.TERRAIN, s0, s1)
    street.strip("meadow", right, materials["meadow"], street.TERRAIN, s0, s1)
    for side, low, high in ((1, 4.0, 13.0), (-1, -3.2, 9.0)):
        hill = [(side * 45.0, low), (side * 70.0, low + 0.5 * (high - low)), (side * 95.0, high)]
        street.strip("hill", hill if side > 0 else hill[::-1], materials["bank"], street.TERRAIN, s0 - 20, s1 + 30, 6.0)


def bush(s: float, t: float, h: float, size: float, rng, material) -> None:  # type: ignore[no-untyped-def]
    """A bush: overlapping lumps that stand on the ground."""
    import bmesh

    base = street.place(s, t, h)
    mesh = bpy.data.meshes.new("bush")
    bm = bmesh.new()
    for _ in range(7):
        offset = rng.normal(0, 0.42, 3) * size * (1.2, 1.2, 0.5)
        radius = float(rng.uniform(0.4, 0.7)) * size
        created = bmesh.ops.create_icosphere(bm, subdivisions=3, radius=radius)
        for v in created["verts"]:
            v.co = v.co * (1 + float(rng.normal(0, 0.09)))
            v.co.x, v.co.y, v.co.z = v.co.x + offset[0], v.co.y + offset[1], v.co.z + abs(offset[2]) + 0.35 * size
    bm.to_mesh(mesh)
    bm.free()
    mesh.materials.append(material)
    obj = bpy.data.objects.new("bush", mesh)
    obj["class"], obj.location = street.VEGETATION, base
    bpy.context.collection.objects.link(obj)


def height(t: float) -> float:
    """Of the land at a lateral offset, as :func:`land` builds it."""
    offsets = (-45.0, -22.0, -12.0, -7.0, -5.4, -4.1, 4.1, 5.2, 6.4, 9.0, 14.0, 22.0, 45.0)
    heights = (-3.2, -1.9, -0.9, -0.35, -0.22, 0.0, 0.0, -0.12, 0.0, 0.9, 2.3, 3.0, 4.0)
    return float(np.interp(t, offsets, heights))


def build(seed: int):  # type: ignore[no-untyped-def]
    """The whole scene; returns it."""
    bend()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    rng = np.random.default_rng(seed)
    plain = street.plain
    materials = {
        "asphalt": smooth_asphalt(), "paint": street.paint(), "glass": street.glass(),
        "bank": grass("bank", (0.10, 0.15, 0.045), (0.17, 0.21, 0.075)),
        "meadow": grass("meadow", (0.13, 0.17, 0.05), (0.22, 0.23, 0.09)),
        "bark": plain("bark", (0.12, 0.085, 0.06)),
        "leaves": [street.leaves("leaves a", (0.07, 0.16, 0.035)), street.leaves("leaves b", (0.11, 0.18, 0.04)),
                   street.leaves("leaves c", (0.05, 0.12, 0.045))],
        "post": plain("post", (0.72, 0.72, 0.7)), "band": plain("band", (0.03, 0.03, 0.03)),
        **street.removable_materials(),
    }  # fmt: skip
    land(materials)
    s = LENGTH[0] + 3
    while s < LENGTH[1]:
        for side in (-1, 1):
            street.cylinder("post", s, side * 4.9, -0.15, 0.055, 1.1, materials["post"], street.POLE)
            street.cylinder("band", s, side * 4.9, 0.72, 0.058, 0.14, materials["band"], street.POLE)
        s += 14.0
    for s, t in ((4.0, 8.5), (17.0, -8.0), (27.0, 11.0), (38.0, -9.5), (49.0, 8.8), (63.0, -7.8), (74.0, 10.0), (90.0, -8.4)):
        street.tree(s, t, rng, materials)
        bpy.context.collection.objects[-1].location.z += height(t)
        bpy.context.collection.objects[-2].location.z += height(t)
    for _ in range(90):
        s, side = float(rng.uniform(-8, 115)), float(rng.choice([-1.0, 1.0]))
        t = side * float(rng.uniform(6.3, 26.0))
        bush(s, t, height(t) - 0.1, float(rng.uniform(0.5, 1.5)), rng, materials["leaves"][int(rng.integers(0, 3))])
    cars = [
        ("hatch", (0.50, 0.50, 0.52), 11.0, -3.75, 0.0), ("saloon", (0.05, 0.12, 0.30), 22.5, 3.7, math.pi),
        ("van", (0.60, 0.58, 0.52), 30.5, -3.8, 0.01), ("hatch", (0.40, 0.03, 0.03), 43.0, -3.7, 0.0),
        ("saloon", (0.34, 0.36, 0.38), 50.0, 3.75, math.pi),
    ]  # fmt: skip
    for number, (kind, color, s, t, turn) in enumerate(cars, start=1):
        street.put(street.car(kind, color, materials), kind, s, t, turn, street.CAR, number, h=0.01)
    walker = street.person((0.55, 0.30, 0.05), (0.06, 0.07, 0.12), materials)
    street.put(walker, "person", 17.0, -4.6, 0.3, street.PERSON, 11, h=-0.1)
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle, sun.color = 3.6, math.radians(0.8), (1.0, 0.96, 0.9)
    lamp = bpy.data.objects.new("sun", sun)
    lamp.rotation_euler = (math.radians(48), 0.0, math.radians(60))
    scene.collection.objects.link(lamp)
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    scene.world = world
    street.sky_nodes(world)
    return scene
