"""People: the parked street's person, standing or in mid-step; each brings the colour of a shirt."""

from __future__ import annotations

import math

import bpy

from sample_scenes.generators.parked_street import build_street as kit
from sample_scenes.generators.streets.materials import of_object
from sample_scenes.generators.streets.mesh import joined

STRIDE = math.radians(13)
"""Angle of the legs of someone who walks; arms swing against them."""
HIP_M, SHOULDER_M = 0.9, 1.42


def person_meshes(materials: dict[str, bpy.types.Material]) -> dict[str, bpy.types.Mesh]:
    """Meshes of someone who stands and of someone who walks, looking along +x, feet on z = 0."""
    shirt, trousers = of_object("shirt", 0.85), of_object("trousers", 0.85, random_brown=True)
    found = {}
    for pose, swing in (("standing", 0.06), ("walking", STRIDE)):
        parts = kit.person((0.3, 0.3, 0.3), (0.1, 0.1, 0.1), materials)
        for part in parts:
            name = part.data.materials[0].name
            if name.startswith("shirt"):
                part.data.materials[0] = shirt
            elif name.startswith("trousers"):
                part.data.materials[0] = trousers
            limb = part.name.split(".")[0]
            if limb in ("leg", "shoe", "arm"):
                left = sum(v.co.y for v in part.data.vertices) > 0
                joint = SHOULDER_M if limb == "arm" else HIP_M
                angle = swing * (1 if left else -1) * (-0.8 if limb == "arm" else 1.0)
                for v in part.data.vertices:
                    down = joint - v.co.z
                    v.co.x += down * math.tan(angle)
                    # A leg that swings lifts its foot: the body sinks instead, below.
                    v.co.z += down * (1 - math.cos(angle)) if limb != "arm" else 0.0
        low = min(v.co.z for part in parts for v in part.data.vertices)
        for part in parts:
            for v in part.data.vertices:
                v.co.z -= low
        found[pose] = joined(pose, parts)
    return found
