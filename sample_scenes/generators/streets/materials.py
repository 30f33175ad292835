"""What the street is made of. Textures are few octaves of noise: a shader is evaluated for every ray."""

from __future__ import annotations

import math

import bpy

from sample_scenes.generators.parked_street import build_street as kit

Color = tuple[float, float, float]


def asphalt(name: str, grain: float, cracks: float, tone: float, tracks: float = 0.5) -> bpy.types.Material:
    """Grain of two sizes, worn patches, wheel tracks and cracks, in street coordinates.

    Args:
        grain: contrast of the grain, 1 is usual; cracks: how strong they are, 0 for none; tone: brightness; tracks: of the wheels.
    """
    n = kit.Nodes(name)
    uv = n.add("ShaderNodeUVMap", uv_map="street").outputs[0]
    coarse = n.add("ShaderNodeTexNoise", Scale=9.0, Detail=4.0, Roughness=0.8)
    worn = n.add("ShaderNodeTexNoise", Scale=0.35, Detail=2.0)
    for node in (coarse, worn):
        n.link(uv, node.inputs["Vector"])
    middle, span = 0.155 * tone, 0.085 * grain * tone
    low, high = max(0.01, middle - span), middle + span
    color = n.ramp(coarse.outputs[0], [(0.33, (low, low, low * 1.04)), (0.67, (high, high * 0.985, high * 0.96))])
    patches = n.ramp(worn.outputs[0], [(0.4, (0.78, 0.78, 0.8)), (0.62, (1.12, 1.11, 1.08))])
    color = n.mix(1.0, color, patches, "MULTIPLY")
    if tracks:
        split = n.add("ShaderNodeSeparateXYZ")
        n.link(uv, split.inputs[0])
        scaled = n.add("ShaderNodeMath", operation="MULTIPLY")
        scaled.inputs[1].default_value = 2 * math.pi / 1.6
        wave = n.add("ShaderNodeMath", operation="SINE")
        n.link(split.outputs[1], scaled.inputs[0])
        n.link(scaled.outputs[0], wave.inputs[0])
        color = n.mix(tracks, color, n.ramp(wave.outputs[0], [(0.0, (1.06, 1.06, 1.06)), (1.0, (0.86, 0.86, 0.87))]), "MULTIPLY")
    if cracks:
        bent = n.add("ShaderNodeTexNoise", Scale=1.8, Detail=3.0)
        n.link(uv, bent.inputs["Vector"])
        shifted = n.add("ShaderNodeVectorMath", operation="ADD")
        n.link(uv, shifted.inputs[0])
        n.link(n.mix(0.16, (0.0, 0.0, 0.0), bent.outputs[1]), shifted.inputs[1])
        cells = n.add("ShaderNodeTexVoronoi", Scale=0.4, feature="DISTANCE_TO_EDGE")
        n.link(shifted.outputs[0], cells.inputs["Vector"])
        color = n.mix(cracks, color, n.ramp(cells.outputs["Distance"], [(0.0, (0.35, 0.35, 0.35)), (0.011, (1.0, 1.0, 1.0))]), "MULTIPLY")
    n.link(color, n.bsdf.inputs["Base Color"])
    return n.material


def cobbles() -> bpy.types.Material:
    """Setts of 16 by 12 cm with dark joints, of changing grey."""
    return kit.slabs("cobbles", (0.23, 0.22, 0.21), (0.14, 0.14, 0.145), 0.17, 0.13)


def grass(name: str, low: Color, high: Color) -> bpy.types.Material:
    """Grass: two greens in patches and a fine grain."""
    n = kit.Nodes(name)
    place = n.add("ShaderNodeNewGeometry").outputs["Position"]
    patches = n.add("ShaderNodeTexNoise", Scale=0.7, Detail=3.0)
    grain = n.add("ShaderNodeTexNoise", Scale=16.0, Detail=2.0, Roughness=0.8)
    for node in (patches, grain):
        n.link(place, node.inputs["Vector"])
    color = n.ramp(patches.outputs[0], [(0.35, low), (0.65, high)])
    n.link(n.mix(1.0, color, n.ramp(grain.outputs[0], [(0.3, (0.55, 0.55, 0.5)), (0.7, (1.2, 1.2, 1.1))]), "MULTIPLY"), n.bsdf.inputs["Base Color"])
    n.bsdf.inputs["Roughness"].default_value = 0.95
    return n.material


def plain(name: str, color: Color, roughness: float = 0.75, metallic: float = 0.0) -> bpy.types.Material:
    """One colour without texture."""
    n = kit.Nodes(name)
    n.bsdf.inputs["Base Color"].default_value = (*color, 1)
    n.bsdf.inputs["Roughness"].default_value, n.bsdf.inputs["Metallic"].default_value = roughness, metallic
    return n.material


def plaster(name: str, color: Color) -> bpy.types.Material:
    """Painted wall: stains of metres and a fine texture."""
    n = kit.Nodes(name)
    uv = n.add("ShaderNodeUVMap", uv_map="street").outputs[0]
    stain = n.add("ShaderNodeTexNoise", Scale=0.6, Detail=4.0)
    n.link(uv, stain.inputs["Vector"])
    dark = tuple(c * 0.8 for c in color)
    n.link(n.ramp(stain.outputs[0], [(0.32, dark), (0.6, color)]), n.bsdf.inputs["Base Color"])
    return n.material


def of_object(name: str, roughness: float, coat: float = 0.0, random_brown: bool = False) -> bpy.types.Material:
    """The object's own colour (or, for trousers, a dark one of its own), so that things can share a mesh."""
    n = kit.Nodes(name)
    info = n.add("ShaderNodeObjectInfo")
    if random_brown:
        n.link(n.ramp(info.outputs["Random"], [(0.1, (0.03, 0.035, 0.07)), (0.5, (0.08, 0.07, 0.06)), (0.9, (0.25, 0.22, 0.17))]), n.bsdf.inputs["Base Color"])
    else:
        n.link(info.outputs["Color"], n.bsdf.inputs["Base Color"])
    n.bsdf.inputs["Roughness"].default_value, n.bsdf.inputs["Coat Weight"].default_value = roughness, coat
    return n.material


def glowing(name: str, color: Color, strength: float) -> bpy.types.Material:
    """Bright to the eye; the light that it gives comes from lamps beside it."""
    n = kit.Nodes(name)
    n.bsdf.inputs["Base Color"].default_value = (*color, 1)
    n.bsdf.inputs["Emission Color"].default_value = (*color, 1)
    n.bsdf.inputs["Emission Strength"].default_value = strength
    n.material.cycles.emission_sampling = "NONE"
    return n.material


def street_materials(wear: dict[str, float], dusk: bool) -> dict[str, bpy.types.Material]:
    """By name; those of single lots are added as lots are built."""
    grain, cracks, tone = wear["grain"], wear["cracks"], wear["tone"]
    return {
        "asphalt": asphalt("asphalt", grain, cracks, tone), "patch new": asphalt("patch new", grain * 0.6, 0.0, tone * 0.62, 0.0),
        "patch old": asphalt("patch old", grain * 1.1, cracks, tone * 1.25, 0.0), "cobbles": cobbles(), "paint": kit.paint(),
        "walk": kit.slabs("walk", (0.40, 0.385, 0.36), (0.33, 0.32, 0.30), 0.6, 0.4),
        "kerb": kit.slabs("kerb", (0.46, 0.45, 0.43), (0.40, 0.39, 0.38), 1.0, 0.6),
        "gutter": kit.slabs("gutter", (0.22, 0.215, 0.21), (0.17, 0.17, 0.165), 0.3, 0.15),
        "grass": grass("grass", (0.09, 0.14, 0.04), (0.17, 0.20, 0.075)), "meadow": grass("meadow", (0.11, 0.16, 0.05), (0.2, 0.21, 0.09)),
        "yard": grass("yard", (0.13, 0.125, 0.10), (0.22, 0.21, 0.18)),
        "iron": kit.plain("iron", (0.06, 0.06, 0.065), 0.6), "steel": plain("steel", (0.22, 0.24, 0.25), 0.5), "rail": plain("rail", (0.3, 0.3, 0.31), 0.3, 0.8),
        "wood": kit.plain("wood", (0.22, 0.13, 0.07)), "white": plain("white", (0.7, 0.69, 0.66)), "stone": kit.plain("stone", (0.3, 0.29, 0.27)),
        "window": kit.glass("window"), "glass front": kit.glass("glass front"), "tiles": kit.plain("tiles", (0.28, 0.10, 0.06)),
        "slate": kit.plain("slate", (0.09, 0.10, 0.12)), "door": kit.plain("door", (0.10, 0.09, 0.08)), "concrete": plaster("concrete", (0.38, 0.37, 0.35)),
        "lit window": glowing("lit window", (1.0, 0.66, 0.3), 0.22) if dusk else kit.glass("lit window"),
        "lamp head": glowing("lamp head", (1.0, 0.8, 0.5), 2.0) if dusk else plain("lamp head", (0.6, 0.6, 0.58)),
        "sign red": plain("sign red", (0.6, 0.03, 0.03)), "sign blue": plain("sign blue", (0.03, 0.09, 0.5)), "sign yellow": plain("sign yellow", (0.7, 0.5, 0.03)),
        "light red": glowing("light red", (1.0, 0.05, 0.03), 2.0), "black": plain("black", (0.02, 0.02, 0.022)),
        "bark": kit.plain("bark", (0.12, 0.085, 0.06)), "hedge": kit.leaves("hedge", (0.05, 0.12, 0.03)),
        "leaves 0": kit.leaves("leaves 0", (0.07, 0.17, 0.035)), "leaves 1": kit.leaves("leaves 1", (0.10, 0.19, 0.03)),
        "leaves 2": kit.leaves("leaves 2", (0.055, 0.14, 0.045)),
    }  # fmt: skip
