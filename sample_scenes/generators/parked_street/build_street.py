"""The street's geometry and materials: swept along a gently curving path, so that everything follows the curve."""

from __future__ import annotations

import math

import bpy
import numpy as np

RADIUS = 95.0
"""Radius of the street's curve, metres; it bends to the left."""
LENGTH = (-14.0, 92.0)
"""Arc length that is built."""
SLOPE = 0.012

ROAD, SIDEWALK, BUILDING, WALL, FENCE, POLE, LIGHT, SIGN, VEGETATION, TERRAIN, SKY, PERSON, RIDER, CAR = range(14)


def place(s: float, t: float, h: float = 0.0) -> tuple[float, float, float]:
    """World position of street coordinates: arc length, lateral offset (left positive), height."""
    a = s / RADIUS
    return (
        RADIUS * math.sin(a) - t * math.sin(a),
        RADIUS * (1 - math.cos(a)) + t * math.cos(a),
        h + SLOPE * s,
    )


def heading(s: float) -> float:
    """Direction of the street at s, radians."""
    return s / RADIUS


# ------------------------------------------------------------------------------------------------------------- materials


class Nodes:
    """A tiny helper that wires shader nodes."""

    def __init__(self, name: str) -> None:
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.tree = self.material.node_tree
        self.tree.nodes.clear()
        self.output = self.tree.nodes.new("ShaderNodeOutputMaterial")
        self.bsdf = self.tree.nodes.new("ShaderNodeBsdfPrincipled")
        self.tree.links.new(self.bsdf.outputs[0], self.output.inputs[0])
        self.bsdf.inputs["Roughness"].default_value = 0.85

    def add(self, kind: str, **settings: object):  # type: ignore[no-untyped-def]
        """A node with its sockets or properties set."""
        node = self.tree.nodes.new(kind)
        for key, value in settings.items():
            if key in node.inputs:
                node.inputs[key].default_value = value
            else:
                setattr(node, key, value)
        return node

    def link(self, a, b) -> None:  # type: ignore[no-untyped-def]
        """Connect an output socket to an input socket."""
        self.tree.links.new(a, b)

    def ramp(self, source, stops: list[tuple[float, tuple[float, float, float]]]):  # type: ignore[no-untyped-def]
        """A colour ramp fed by a value socket; returns its colour socket."""
        node = self.tree.nodes.new("ShaderNodeValToRGB")
        elements = node.color_ramp.elements
        while len(elements) < len(stops):
            elements.new(0.5)
        for element, (position, color) in zip(elements, stops, strict=True):
            element.position = position
            element.color = (*color, 1.0)
        self.link(source, node.inputs[0])
        return node.outputs[0]

    def mix(self, factor, a, b, blend: str = "MIX"):  # type: ignore[no-untyped-def]
        """Mix two colour sockets (or constants) by a socket or number; returns the colour socket."""
        node = self.tree.nodes.new("ShaderNodeMix")
        node.data_type, node.blend_type = "RGBA", blend
        for value, index in ((factor, 0), (a, 6), (b, 7)):
            socket = node.inputs[index]
            if isinstance(value, bpy.types.NodeSocket):
                self.link(value, socket)
            else:
                socket.default_value = value if index == 0 else (*value, 1.0)
        return node.outputs[2]


def plain(name: str, color: tuple[float, float, float], roughness: float = 0.7, metallic: float = 0.0):  # type: ignore[no-untyped-def]
    """A single colour with a trace of noise."""
    n = Nodes(name)
    noise = n.add("ShaderNodeTexNoise", Scale=6.0, Detail=4.0)
    dark = tuple(c * 0.82 for c in color)
    n.link(n.ramp(noise.outputs[0], [(0.3, dark), (0.7, color)]), n.bsdf.inputs["Base Color"])
    n.bsdf.inputs["Roughness"].default_value = roughness
    n.bsdf.inputs["Metallic"].default_value = metallic
    return n.material


def asphalt():  # type: ignore[no-untyped-def]
    """Grain, large worn patches, wheel tracks, repaired rectangles and cracks, in street coordinates (the UV map)."""
    n = Nodes("asphalt")
    uv = n.add("ShaderNodeUVMap", uv_map="street").outputs[0]
    grain = n.add("ShaderNodeTexNoise", Scale=14.0, Detail=6.0, Roughness=0.75)
    patches = n.add("ShaderNodeTexNoise", Scale=0.35, Detail=3.0)
    for node in (grain, patches):
        n.link(uv, node.inputs["Vector"])
    base = n.ramp(grain.outputs[0], [(0.32, (0.095, 0.096, 0.10)), (0.68, (0.25, 0.246, 0.24))])
    worn = n.ramp(patches.outputs[0], [(0.4, (0.72, 0.72, 0.74)), (0.62, (1.15, 1.13, 1.1))])
    color = n.mix(1.0, base, worn, "MULTIPLY")
    # wheel tracks: two darker bands per lane along the street
    split = n.add("ShaderNodeSeparateXYZ")
    n.link(uv, split.inputs[0])
    wave = n.add("ShaderNodeMath", operation="SINE")
    scaled = n.add("ShaderNodeMath", operation="MULTIPLY")
    scaled.inputs[1].default_value = 2 * math.pi / 1.55
    n.link(split.outputs[1], scaled.inputs[0])
    n.link(scaled.outputs[0], wave.inputs[0])
    tracks = n.ramp(wave.outputs[0], [(0.0, (1.06, 1.06, 1.06)), (1.0, (0.86, 0.86, 0.87))])
    color = n.mix(0.7, color, tracks, "MULTIPLY")
    voronoi = n.add("ShaderNodeTexVoronoi", Scale=0.45, feature="DISTANCE_TO_EDGE")
    distort = n.add("ShaderNodeTexNoise", Scale=1.8, Detail=5.0)
    n.link(uv, distort.inputs["Vector"])
    bent = n.mix(0.16, (0.0, 0.0, 0.0), distort.outputs[1])
    shifted = n.add("ShaderNodeVectorMath", operation="ADD")
    n.link(uv, shifted.inputs[0])
    n.link(bent, shifted.inputs[1])
    n.link(shifted.outputs[0], voronoi.inputs["Vector"])
    crack = n.ramp(voronoi.outputs["Distance"], [(0.0, (0.35, 0.35, 0.35)), (0.012, (1.0, 1.0, 1.0))])
    color = n.mix(0.8, color, crack, "MULTIPLY")
    n.link(color, n.bsdf.inputs["Base Color"])
    return n.material


def slabs(name: str, a: tuple[float, float, float], b: tuple[float, float, float], width: float, height: float):  # type: ignore[no-untyped-def]
    """Paving or brick in offset bond with joints, in UV metres."""
    n = Nodes(name)
    uv = n.add("ShaderNodeUVMap", uv_map="street").outputs[0]
    brick = n.add("ShaderNodeTexBrick", offset=0.5)
    brick.inputs["Color1"].default_value = (*a, 1)
    brick.inputs["Color2"].default_value = (*b, 1)
    brick.inputs["Mortar"].default_value = (*(c * 0.42 for c in a), 1)
    brick.inputs["Scale"].default_value = 1.0
    brick.inputs["Brick Width"].default_value = width
    brick.inputs["Row Height"].default_value = height
    brick.inputs["Mortar Size"].default_value = min(width, height) * 0.045
    n.link(uv, brick.inputs["Vector"])
    noise = n.add("ShaderNodeTexNoise", Scale=1.6, Detail=6.0)
    n.link(uv, noise.inputs["Vector"])
    stain = n.ramp(noise.outputs[0], [(0.35, (0.78, 0.78, 0.78)), (0.65, (1.08, 1.08, 1.08))])
    n.link(n.mix(1.0, brick.outputs[0], stain, "MULTIPLY"), n.bsdf.inputs["Base Color"])
    return n.material


def paint():  # type: ignore[no-untyped-def]
    """Worn road paint."""
    n = Nodes("paint")
    noise = n.add("ShaderNodeTexNoise", Scale=9.0, Detail=6.0, Roughness=0.8)
    n.link(n.ramp(noise.outputs[0], [(0.3, (0.32, 0.32, 0.31)), (0.46, (0.66, 0.65, 0.62))]), n.bsdf.inputs["Base Color"])
    return n.material


def leaves(name: str, color: tuple[float, float, float]):  # type: ignore[no-untyped-def]
    """Foliage."""
    n = Nodes(name)
    noise = n.add("ShaderNodeTexNoise", Scale=3.2, Detail=8.0, Roughness=0.8)
    dark = tuple(c * 0.3 for c in color)
    light = tuple(min(1.0, c * 1.7) for c in color)
    n.link(n.ramp(noise.outputs[0], [(0.34, dark), (0.52, color), (0.68, light)]), n.bsdf.inputs["Base Color"])
    return n.material


def glass(name: str = "glass"):  # type: ignore[no-untyped-def]
    """Dark window glass, opaque: what is behind does not matter."""
    n = Nodes(name)
    n.bsdf.inputs["Base Color"].default_value = (0.035, 0.045, 0.06, 1)
    n.bsdf.inputs["Roughness"].default_value = 0.25
    return n.material


# ---------------------------------------------------------------------------------------------------------------- meshes


def mesh_object(name: str, vertices, faces, material, label: int, uvs=None, smooth: bool = False):  # type: ignore[no-untyped-def]
    """An object with one material, its class as a custom property, and optional per-vertex street UVs."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([tuple(v) for v in vertices], [], [tuple(f) for f in faces])
    if uvs is not None:
        layer = mesh.uv_layers.new(name="street")
        for loop in mesh.loops:
            layer.data[loop.index].uv = uvs[loop.vertex_index]
    mesh.materials.append(material)
    if smooth:
        mesh.shade_smooth()
    obj = bpy.data.objects.new(name, mesh)
    obj["class"] = label
    bpy.context.collection.objects.link(obj)
    return obj


def strip(name: str, section, material, label: int, s0: float, s1: float, step: float = 1.0):  # type: ignore[no-untyped-def]
    """Sweep a cross section [(t, h), …] along the street from s0 to s1; UVs are (s, t + h) in metres."""
    stations = np.linspace(s0, s1, max(2, int(round((s1 - s0) / step)) + 1))
    vertices, uvs, faces = [], [], []
    run = [0.0]
    for (l0, h0), (l1, h1) in zip(section, section[1:], strict=False):
        run.append(run[-1] + math.hypot(l1 - l0, h1 - h0))
    for s in stations:
        for (t, h), r in zip(section, run, strict=True):
            vertices.append(place(float(s), t, h))
            uvs.append((float(s), section[0][0] + r))
    w = len(section)
    for i in range(len(stations) - 1):
        for j in range(w - 1):
            faces.append((i * w + j, (i + 1) * w + j, (i + 1) * w + j + 1, i * w + j + 1))
    return mesh_object(name, vertices, faces, material, label, uvs)


def box_faces():  # type: ignore[no-untyped-def]
    """Faces of a box whose eight corners come bottom ring first."""
    return [(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]


def street_box(name: str, s: float, t: float, h: float, size, material, label: int):  # type: ignore[no-untyped-def]
    """A box aligned with the street: centre of its base at (s, t, h), size (along, across, up)."""
    a, b, c = size[0] / 2, size[1] / 2, size[2]
    corners = [(-a, -b, 0), (a, -b, 0), (a, b, 0), (-a, b, 0), (-a, -b, c), (a, -b, c), (a, b, c), (-a, b, c)]
    turn = heading(s)
    base = place(s, t, h)
    points = [
        (base[0] + x * math.cos(turn) - y * math.sin(turn), base[1] + x * math.sin(turn) + y * math.cos(turn),
         base[2] + z)
        for x, y, z in corners
    ]  # fmt: skip
    return mesh_object(name, points, box_faces(), material, label)


def ground(materials) -> None:  # type: ignore[no-untyped-def]
    """Road, paint, kerbs, walks."""
    s0, s1 = LENGTH
    strip("road", [(-4.6, 0.0), (-2.3, 0.03), (0.0, 0.05), (2.3, 0.03), (4.6, 0.0)], materials["asphalt"], ROAD, s0, s1)
    for side in (-1, 1):
        strip(
            "kerb", [(side * 4.6, 0.0), (side * 4.6, 0.12), (side * 4.75, 0.13)], materials["kerb"], SIDEWALK, s0, s1
        )
        strip("gutter", [(side * 4.3, 0.008), (side * 4.6, 0.004)], materials["gutter"], ROAD, s0, s1)
        strip("walk", [(side * 4.75, 0.13), (side * 7.4, 0.17)], materials["walk"], SIDEWALK, s0, s1)
        strip("edge line", [(side * 2.42, 0.034), (side * 2.54, 0.033)], materials["paint"], ROAD, s0, s1)
    s = s0
    while s < s1:
        strip("dash", [(-0.07, 0.055), (0.07, 0.055)], materials["paint"], ROAD, s, min(s + 2.0, s1), 0.5)
        s += 5.0
    # marked bays: short cross lines between the edge line and the kerb
    for side, first in ((-1, 3.0), (1, 5.5)):
        s = first
        while s < 60:
            strip(
                "bay", [(side * 2.48, 0.035), (side * 4.25, 0.018)], materials["paint"], ROAD, s, s + 0.1, 0.1
            )
            s += 5.6
    for s, t in ((9.0, 0.9), (31.0, -1.2), (47.0, 1.4)):
        disc = [(place(s + 0.33 * math.cos(a), t + 0.33 * math.sin(a), 0.058)) for a in np.linspace(0, 2 * math.pi, 25)[:-1]]
        mesh_object("manhole", disc, [tuple(range(24))], materials["iron"], ROAD)


def facade(name: str, s: float, width: float, side: int, floors: int, wall, trim, window, door, rng) -> None:  # type: ignore[no-untyped-def]
    """A house front with plinth, windows in reveals, sills, a door, a cornice and a roof edge, on one side of the street."""
    l0, depth = side * 7.4, side * 8.0
    height = 0.9 + floors * 3.0
    n = max(2, int(width / 2))
    stations = np.linspace(s, s + width, n + 1)
    vertices, uvs, faces = [], [], []
    levels = [0.16, height]
    for st in stations:
        for h in levels:
            vertices.append(place(float(st), l0, h))
            uvs.append((float(st), h))
    for i in range(n):
        faces.append((2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1))
    for st in (s, s + width):  # gable ends and back
        k = len(vertices)
        for t, h in ((l0, 0.0), (l0, height), (l0 + depth, height), (l0 + depth, 0.0)):
            vertices.append(place(float(st), t, h))
            uvs.append((abs(t), h))
        faces.append((k, k + 1, k + 2, k + 3))
    mesh_object(name, vertices, faces, wall, BUILDING, uvs)
    strip(name + " plinth", [(l0 - side * 0.07, 0.16), (l0 - side * 0.07, 0.75), (l0, 0.8)], trim["plinth"], BUILDING, s, s + width)
    strip(name + " cornice", [(l0, height - 0.35), (l0 - side * 0.3, height - 0.1), (l0 - side * 0.3, height), (l0, height + 0.05)],
          trim["light"], BUILDING, s, s + width)  # fmt: skip
    strip(name + " roof", [(l0 - side * 0.35, height), (l0 + side * 3.5, height + 2.6), (l0 + side * 7.5, height)], trim["roof"], BUILDING, s, s + width)
    bays = max(2, int(width / 2.4))
    spacing = width / bays
    door_bay = int(rng.integers(0, bays))
    for floor in range(floors):
        sill = 1.15 + 3.0 * floor
        for bay in range(bays):
            centre = s + (bay + 0.5) * spacing
            if floor == 0 and bay == door_bay:
                street_box(name + " door", centre, l0 - side * 0.02, 0.16, (1.05, 0.12, 2.2), door, BUILDING)
                street_box(name + " lintel", centre, l0 - side * 0.05, 2.36, (1.35, 0.16, 0.18), trim["light"], BUILDING)
                street_box(name + " step", centre, l0 - side * 0.22, 0.14, (1.3, 0.44, 0.14), trim["plinth"], BUILDING)
                continue
            tall = 1.45 if floor < floors - 1 else 1.2
            street_box(name + " frame", centre, l0 - side * 0.0, sill - 0.06, (1.16, 0.1, tall + 0.12), trim["light"], BUILDING)
            street_box(name + " window", centre, l0 - side * 0.03, sill, (1.0, 0.09, tall), window, BUILDING)
            street_box(name + " bar", centre, l0 - side * 0.05, sill, (0.06, 0.08, tall), trim["light"], BUILDING)
            street_box(name + " bar", centre, l0 - side * 0.05, sill + tall * 0.62, (1.0, 0.08, 0.06), trim["light"], BUILDING)
            street_box(name + " sill", centre, l0 - side * 0.1, sill - 0.13, (1.3, 0.24, 0.08), trim["light"], BUILDING)


def tree(s: float, t: float, rng, materials) -> None:  # type: ignore[no-untyped-def]
    """A trunk and a crown of overlapping lumps."""
    import bmesh

    base = place(s, t, 0.1)
    mesh = bpy.data.meshes.new("trunk")
    bm = bmesh.new()
    bmesh.ops.create_cone(bm, segments=10, radius1=0.17, radius2=0.1, depth=2.9, cap_ends=True)
    bm.to_mesh(mesh)
    bm.free()
    mesh.materials.append(materials["bark"])
    obj = bpy.data.objects.new("trunk", mesh)
    obj["class"] = VEGETATION
    obj.location = (base[0], base[1], base[2] + 1.4)
    bpy.context.collection.objects.link(obj)
    crown = bpy.data.meshes.new("crown")
    bm = bmesh.new()
    for _ in range(13):
        offset = rng.normal(0, 0.62, 3) * (1.0, 1.0, 0.75)
        radius = float(rng.uniform(0.5, 0.95))
        created = bmesh.ops.create_icosphere(bm, subdivisions=4, radius=radius)
        for v in created["verts"]:
            wobble = 1 + 0.12 * math.sin(9 * v.co.x + offset[0] * 7) * math.sin(8 * v.co.y) + float(rng.normal(0, 0.07))
            v.co = v.co * wobble
            v.co.x += offset[0]
            v.co.y += offset[1]
            v.co.z += offset[2]
    bm.to_mesh(crown)
    bm.free()
    crown.materials.append(materials["leaves"][int(rng.integers(0, len(materials["leaves"])))])
    obj = bpy.data.objects.new("crown", crown)
    obj["class"] = VEGETATION
    obj.location = (base[0], base[1], base[2] + 3.7)
    bpy.context.collection.objects.link(obj)


def cylinder(name: str, s: float, t: float, h: float, radius: float, height: float, material, label: int):  # type: ignore[no-untyped-def]
    """An upright cylinder."""
    base = place(s, t, h)
    ring = [(math.cos(a) * radius, math.sin(a) * radius) for a in np.linspace(0, 2 * math.pi, 13)[:-1]]
    vertices = [(base[0] + x, base[1] + y, base[2] + z) for z in (0.0, height) for x, y in ring]
    faces = [(i, (i + 1) % 12, 12 + (i + 1) % 12, 12 + i) for i in range(12)] + [tuple(range(12, 24))]
    return mesh_object(name, vertices, faces, material, label)


def lamp(s: float, side: int, materials) -> None:  # type: ignore[no-untyped-def]
    """A street lamp with an arm."""
    cylinder("lamp", s, side * 5.05, 0.12, 0.07, 5.6, materials["steel"], POLE)
    street_box("arm", s, side * 4.5, 5.65, (0.09, 1.2, 0.08), materials["steel"], POLE)
    street_box("head", s, side * 3.9, 5.58, (0.24, 0.6, 0.12), materials["steel"], POLE)


def sign(s: float, side: int, materials) -> None:  # type: ignore[no-untyped-def]
    """A round no-stopping sign on its post."""
    cylinder("post", s, side * 5.0, 0.12, 0.035, 2.7, materials["steel"], POLE)
    base = place(s, side * 5.0, 2.55)
    turn = heading(s)
    for radius, lift, material in ((0.32, 0.05, "sign red"), (0.25, 0.07, "sign blue")):
        points = []
        for a in np.linspace(0, 2 * math.pi, 29)[:-1]:
            across, up = radius * math.cos(a), radius * math.sin(a)
            points.append((
                base[0] - lift * math.cos(turn) - across * math.sin(turn),
                base[1] - lift * math.sin(turn) + across * math.cos(turn), base[2] + up,
            ))  # fmt: skip
        mesh_object("sign", points, [tuple(range(28))], materials[material], SIGN)


# --------------------------------------------------------------------------------------------------------- what is removed


def smooth_object(name: str, vertices, faces, material):  # type: ignore[no-untyped-def]
    """An object of smoothly shaded faces, linked into the scene."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    mesh.materials.append(material)
    mesh.shade_smooth()
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(obj)
    return obj


def loft(name: str, sections, material, close: bool = True):  # type: ignore[no-untyped-def]
    """A body lofted through cross sections [(x, [(y, z), …]), …] in the object's own frame."""
    vertices = [(x, y, z) for x, ring in sections for y, z in ring]
    w = len(sections[0][1])
    faces = []
    for i in range(len(sections) - 1):
        for j in range(w):
            k = (j + 1) % w
            faces.append((i * w + j, i * w + k, (i + 1) * w + k, (i + 1) * w + j))
    if close:
        faces += [tuple(range(w - 1, -1, -1)), tuple(range((len(sections) - 1) * w, len(sections) * w))]
    obj = smooth_object(name, vertices, faces, material)
    bevel = obj.modifiers.new("soft", "SUBSURF")
    bevel.levels = bevel.render_levels = 2
    return obj


def ring(half_width: float, low: float, high: float, tuck: float = 0.86):  # type: ignore[no-untyped-def]
    """A rounded cross section, wider at its belt."""
    w = half_width
    return [
        (-w * 0.9, low), (-w, low + 0.12), (-w, (low + high) / 2), (-w * tuck, high - 0.03), (-w * tuck * 0.8, high),
        (w * tuck * 0.8, high), (w * tuck, high - 0.03), (w, (low + high) / 2), (w, low + 0.12), (w * 0.9, low),
    ]  # fmt: skip


def wheel(x: float, y: float, radius: float, materials):  # type: ignore[no-untyped-def]
    """A tyre with a rim."""
    parts = []
    for r, half, material in ((radius, 0.11, materials["tyre"]), (radius * 0.62, 0.118, materials["rim"])):
        angles = np.linspace(0, 2 * math.pi, 25)[:-1]
        vertices = [(x + r * math.cos(a), y + d, radius + r * math.sin(a)) for d in (-half, half) for a in angles]
        faces = [(i, (i + 1) % 24, 24 + (i + 1) % 24, 24 + i) for i in range(24)]
        faces += [tuple(range(23, -1, -1)), tuple(range(24, 48))]
        mesh = bpy.data.meshes.new("wheel")
        mesh.from_pydata(vertices, [], faces)
        mesh.materials.append(material)
        obj = bpy.data.objects.new("wheel", mesh)
        bpy.context.collection.objects.link(obj)
        parts.append(obj)
    return parts


def flat_part(name: str, corners, material):  # type: ignore[no-untyped-def]
    """A box given by its eight corners, in the object's own frame."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], box_faces())
    mesh.materials.append(material)
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.collection.objects.link(obj)
    return obj


def cuboid(x0: float, x1: float, y0: float, y1: float, z0: float, z1: float):  # type: ignore[no-untyped-def]
    """Corners of an axis-aligned box."""
    return [(x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0), (x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)]


def car(kind: str, color, materials):  # type: ignore[no-untyped-def]
    """Parts of a car that points along +x, its wheels on z = 0."""
    body_paint = Nodes("car paint")
    body_paint.bsdf.inputs["Base Color"].default_value = (*color, 1)
    body_paint.bsdf.inputs["Roughness"].default_value = 0.35
    body_paint.bsdf.inputs["Coat Weight"].default_value = 0.4
    skin = body_paint.material
    if kind == "van":
        length, w = 4.9, 0.96
        parts = [
            loft("van body", [(-2.42, ring(w * 0.96, 0.42, 1.9)), (-2.36, ring(w, 0.3, 2.0)), (1.2, ring(w, 0.3, 2.02)),
                              (1.75, ring(w * 0.98, 0.3, 1.55)), (2.1, ring(w * 0.96, 0.3, 1.1)),
                              (2.44, ring(w * 0.9, 0.36, 0.92))], skin),
            flat_part("van glass", cuboid(0.35, 1.2, -0.965, 0.965, 1.18, 1.68), materials["glass"]),
            loft("van windscreen", [(1.34, ring(w * 0.9, 1.3, 1.84, 0.9)), (1.74, ring(w * 0.9, 1.12, 1.5, 0.9)),
                                    (1.83, ring(w * 0.88, 1.06, 1.34, 0.9))], materials["glass"]),
            flat_part("van rear glass", cuboid(-2.46, -2.3, -0.7, 0.7, 1.25, 1.75), materials["glass"]),
        ]  # fmt: skip
        axles, radius = (-1.55, 1.55), 0.34
    else:
        length, w = (4.35, 0.9) if kind == "saloon" else (3.85, 0.87)
        e = length / 2
        tail = 0.0 if kind == "saloon" else 0.42
        parts = [
            loft("car body", [(-e, ring(w * 0.86, 0.42, 0.82)), (-e + 0.12, ring(w * 0.97, 0.26, 0.93)),
                              (-e + 0.8, ring(w, 0.22, 0.96)), (0.5, ring(w, 0.22, 0.94)), (e - 0.9, ring(w, 0.22, 0.86)),
                              (e - 0.15, ring(w * 0.95, 0.26, 0.72)), (e, ring(w * 0.84, 0.36, 0.62))], skin),
            loft("car cabin", [(-e + 0.5 - tail, ring(w * 0.84, 0.84, 0.94)), (-e + 1.05 - tail, ring(w * 0.82, 0.84, 1.38, 0.8)),
                               (-0.35, ring(w * 0.83, 0.84, 1.46, 0.8)), (0.25, ring(w * 0.83, 0.84, 1.4, 0.8)),
                               (1.05, ring(w * 0.84, 0.82, 0.92))], materials["glass"]),
            loft("car roof", [(-e + 1.2 - tail, ring(w * 0.62, 1.3, 1.385)), (-0.3, ring(w * 0.64, 1.36, 1.47)),
                              (0.2, ring(w * 0.61, 1.32, 1.41))], skin),
        ]  # fmt: skip
        for side in (-1, 1):
            parts.append(flat_part("pillar", cuboid(-0.32, -0.22, side * w * 0.8 - 0.03, side * w * 0.8 + 0.03, 0.9, 1.3), skin))
        axles, radius = (-e * 0.6, e * 0.62), 0.31
    e = length / 2
    for side in (-1, 1):
        for x in axles:
            parts += wheel(x, side * (w - 0.1), radius, materials)
        top = 0.8 if kind != "van" else 0.95
        parts.append(flat_part("lamp", cuboid(e - 0.14, e - 0.02, side * w * 0.66 - 0.14, side * w * 0.66 + 0.14, 0.52, 0.66), materials["headlamp"]))
        parts.append(flat_part("lamp", cuboid(-e - 0.01, -e + 0.1, side * w * 0.66 - 0.12, side * w * 0.66 + 0.12, top - 0.18, top), materials["tail lamp"]))
    parts.append(flat_part("plate", cuboid(-e - 0.02, -e + 0.05, -0.26, 0.26, 0.46, 0.58), materials["plate"]))
    return parts


def person(shirt, trousers, materials):  # type: ignore[no-untyped-def]
    """Parts of a standing person who looks along +x, feet on z = 0."""
    skin, hair = materials["skin"], materials["hair"]
    cloth, pants = plain("shirt", shirt), plain("trousers", trousers)

    def oval(rx: float, ry: float):  # type: ignore[no-untyped-def]
        return [(rx * math.cos(a), ry * math.sin(a)) for a in np.linspace(0, 2 * math.pi, 11)[:-1]]

    def limb(name: str, path, material):  # type: ignore[no-untyped-def]
        vertices, faces = [], []
        for x, y, z, rx, ry in path:
            vertices += [(x + px, y + py, z) for px, py in oval(rx, ry)]
        for i in range(len(path) - 1):
            faces += [(i * 10 + j, i * 10 + (j + 1) % 10, (i + 1) * 10 + (j + 1) % 10, (i + 1) * 10 + j) for j in range(10)]
        faces += [tuple(range(9, -1, -1)), tuple(range((len(path) - 1) * 10, len(path) * 10))]
        return smooth_object(name, vertices, faces, material)

    parts = [
        limb("torso", [(0, 0, 0.86, 0.11, 0.16), (0, 0, 1.05, 0.11, 0.15), (0, 0, 1.3, 0.13, 0.2), (0, 0, 1.44, 0.1, 0.19),
                       (0, 0, 1.5, 0.05, 0.07)], cloth),
        limb("neck", [(0, 0, 1.47, 0.05, 0.05), (0.01, 0, 1.58, 0.05, 0.05)], skin),
        limb("head", [(0.02, 0, 1.55, 0.05, 0.05), (0.03, 0, 1.6, 0.09, 0.075), (0.02, 0, 1.69, 0.105, 0.085),
                      (0.0, 0, 1.75, 0.09, 0.08)], skin),
        limb("hair", [(-0.02, 0, 1.66, 0.1, 0.088), (-0.01, 0, 1.73, 0.11, 0.095), (0, 0, 1.79, 0.07, 0.06)], hair),
    ]  # fmt: skip
    for side in (-1, 1):
        y = side * 0.1
        parts.append(limb("leg", [(0.01, y, 0.06, 0.06, 0.055), (0, y, 0.45, 0.075, 0.07), (0, y, 0.9, 0.1, 0.09)], pants))
        parts.append(limb("shoe", [(0.06, y, 0.0, 0.13, 0.055), (0.04, y, 0.08, 0.1, 0.055)], materials["tyre"]))
        parts.append(limb("arm", [(0.05, side * 0.25, 0.82, 0.035, 0.035), (0.0, side * 0.25, 1.1, 0.045, 0.045),
                                  (0, side * 0.21, 1.42, 0.06, 0.055)], cloth))  # fmt: skip
    return parts


def put(parts, name: str, s: float, t: float, turn: float, label: int, instance: int, h: float | None = None) -> None:  # type: ignore[no-untyped-def]
    """Join parts into one object on the street (on the kerb's level beyond it) and number it."""
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    joined, materials = bpy.data.meshes.new(name), []
    vertices, faces, indices = [], [], []
    for part in parts:
        mesh = part.evaluated_get(depsgraph).to_mesh()
        base = len(vertices)
        vertices += [tuple(v.co) for v in mesh.vertices]
        slot = len(materials)
        materials.append(part.data.materials[0])
        for polygon in mesh.polygons:
            faces.append(tuple(base + i for i in polygon.vertices))
            indices.append(slot)
    joined.from_pydata(vertices, [], faces)
    for material in materials:
        joined.materials.append(material)
    joined.polygons.foreach_set("material_index", indices)
    joined.polygons.foreach_set("use_smooth", [True] * len(faces))
    for part in parts:
        bpy.data.objects.remove(part)
    obj = bpy.data.objects.new(name, joined)
    height = h if h is not None else (0.155 if abs(t) > 4.7 else 0.012)
    obj.location = place(s, t, height)
    obj.rotation_euler = (0, -math.atan(SLOPE) if abs(turn) < 0.5 else math.atan(SLOPE), heading(s) + turn)
    obj["class"], obj["instance"] = label, instance
    bpy.context.collection.objects.link(obj)


def removable_materials() -> dict:  # type: ignore[type-arg]
    """What cars and people are made of, beside their paint, glass and clothes."""
    return {
        "tyre": plain("tyre", (0.018, 0.018, 0.02)), "rim": plain("rim", (0.42, 0.43, 0.45), 0.35, 0.6),
        "headlamp": plain("headlamp", (0.75, 0.77, 0.8), 0.2), "tail lamp": plain("tail lamp", (0.42, 0.015, 0.015), 0.3),
        "plate": plain("plate", (0.75, 0.74, 0.6)), "skin": plain("skin", (0.55, 0.34, 0.25)),
        "hair": plain("hair", (0.06, 0.035, 0.02)),
    }  # fmt: skip


def removable(scene) -> list:  # type: ignore[no-untyped-def, type-arg]
    """The parked cars and standing people."""
    return [o for o in scene.objects if o.get("instance", 0) > 0]


def build(seed: int):  # type: ignore[no-untyped-def]
    """The whole scene; returns it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    rng = np.random.default_rng(seed)
    materials = {
        "asphalt": asphalt(), "paint": paint(), "glass": glass(), "window": glass("window"),
        "walk": slabs("walk", (0.40, 0.385, 0.36), (0.33, 0.32, 0.30), 0.6, 0.4),
        "kerb": slabs("kerb", (0.46, 0.45, 0.43), (0.40, 0.39, 0.38), 1.0, 0.6),
        "gutter": slabs("gutter", (0.24, 0.235, 0.23), (0.19, 0.19, 0.185), 0.3, 0.15),
        "iron": plain("iron", (0.06, 0.06, 0.065), 0.6), "steel": plain("steel", (0.22, 0.24, 0.25), 0.5),
        "bark": plain("bark", (0.12, 0.085, 0.06)),
        "leaves": [leaves("leaves a", (0.07, 0.17, 0.035)), leaves("leaves b", (0.1, 0.19, 0.03)),
                   leaves("leaves c", (0.055, 0.14, 0.045))],
        "sign red": plain("sign red", (0.6, 0.03, 0.03)), "sign blue": plain("sign blue", (0.03, 0.09, 0.5)),
        **removable_materials(),
    }  # fmt: skip
    ground(materials)
    strip("yard", [(-30.0, 0.0), (-7.4, 0.1)], plain("yard", (0.16, 0.19, 0.09)), TERRAIN, *LENGTH)
    strip("yard", [(7.4, 0.1), (30.0, 0.0)], plain("yard b", (0.16, 0.19, 0.09)), TERRAIN, *LENGTH)
    walls = [
        slabs("brick", (0.36, 0.13, 0.075), (0.29, 0.095, 0.06), 0.24, 0.08), plain("ochre", (0.62, 0.41, 0.16)),
        plain("cream", (0.68, 0.61, 0.47)), slabs("pale brick", (0.55, 0.47, 0.36), (0.48, 0.40, 0.30), 0.24, 0.08),
        plain("rose", (0.58, 0.32, 0.26)), plain("grey", (0.42, 0.44, 0.45)), plain("blue", (0.30, 0.40, 0.50)),
    ]  # fmt: skip
    roofs = [plain("tiles", (0.30, 0.10, 0.06)), plain("slate", (0.09, 0.10, 0.12))]
    doors = [plain("door green", (0.04, 0.13, 0.08)), plain("door red", (0.25, 0.03, 0.03)), plain("door blue", (0.04, 0.08, 0.2))]
    for side in (-1, 1):
        s, index = LENGTH[0], 0
        while s < LENGTH[1] - 4:
            width = float(rng.uniform(7.5, 12.0))
            trim = {
                "plinth": plain("plinth", (0.22, 0.21, 0.20)), "light": plain("trim", (0.72, 0.70, 0.66)),
                "roof": roofs[index % 2],
            }  # fmt: skip
            facade(f"house {side} {index}", s, width, side, 2 if rng.uniform() < 0.6 else 3,
                   walls[(index * 2 + (side > 0) * 3) % len(walls)], trim, materials["window"],
                   doors[int(rng.integers(0, 3))], rng)  # fmt: skip
            s += width + (2.2 if rng.uniform() < 0.22 else 0.0)
            index += 1
    for s, side in ((1.5, 1), (15.0, -1), (24.5, 1), (36.0, -1), (46.5, 1), (58.0, -1), (69.0, 1), (76.0, -1)):
        tree(s, side * 5.7, rng, materials)
    for s, side in ((7.0, -1), (29.0, 1), (51.0, -1), (72.0, 1)):
        lamp(s, side, materials)
    sign(20.5, -1, materials)
    sign(39.5, 1, materials)

    cars = [
        ("saloon", (0.36, 0.02, 0.025), 6.4, -3.45, 0.0), ("hatch", (0.06, 0.14, 0.34), 12.0, -3.5, 0.02),
        ("van", (0.62, 0.62, 0.60), 18.6, -3.4, 0.0), ("saloon", (0.045, 0.05, 0.055), 30.3, -3.35, 0.0),
        ("hatch", (0.55, 0.36, 0.03), 8.6, 3.5, math.pi), ("saloon", (0.34, 0.36, 0.38), 14.6, 3.4, math.pi + 0.015),
        ("hatch", (0.05, 0.20, 0.13), 26.5, 4.35, math.pi), ("saloon", (0.30, 0.045, 0.06), 34.0, 3.45, math.pi),
        ("hatch", (0.50, 0.50, 0.52), 41.5, -3.5, 0.0),
    ]  # fmt: skip
    for number, (kind, color, s, t, turn) in enumerate(cars, start=1):
        put(car(kind, color, materials), kind, s, t, turn, CAR, number, h=0.075 if abs(t) > 4 else None)
    put(person((0.32, 0.06, 0.05), (0.05, 0.06, 0.12), materials), "person", 22.8, 5.15, 2.6, PERSON, 11)
    put(person((0.08, 0.22, 0.26), (0.10, 0.09, 0.08), materials), "person", 25.2, -5.3, -2.2, PERSON, 12)

    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle, sun.color = 4.2, math.radians(0.6), (1.0, 0.95, 0.86)
    lamp_object = bpy.data.objects.new("sun", sun)
    lamp_object.rotation_euler = (math.radians(33), 0.0, math.radians(-46))
    scene.collection.objects.link(lamp_object)
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    scene.world = world
    sky_nodes(world)
    return scene


def sky_nodes(world) -> None:  # type: ignore[no-untyped-def]
    """A blue gradient with soft clouds, dimmer for light than for the eye."""
    tree = world.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputWorld")
    background = tree.nodes.new("ShaderNodeBackground")
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[0].color = 0.0, (0.62, 0.74, 0.88, 1)
    ramp.color_ramp.elements[1].position, ramp.color_ramp.elements[1].color = 0.55, (0.13, 0.31, 0.68, 1)
    noise = tree.nodes.new("ShaderNodeTexNoise")
    noise.inputs["Scale"].default_value, noise.inputs["Detail"].default_value = 3.0, 7.0
    clouds = tree.nodes.new("ShaderNodeValToRGB")
    clouds.color_ramp.elements[0].position, clouds.color_ramp.elements[1].position = 0.52, 0.72
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    mix.inputs[7].default_value = (0.93, 0.94, 0.96, 1)
    links = tree.links
    links.new(coordinates.outputs["Generated"], split.inputs[0])
    links.new(split.outputs[2], ramp.inputs[0])
    links.new(coordinates.outputs["Generated"], noise.inputs["Vector"])
    links.new(noise.outputs[0], clouds.inputs[0])
    links.new(clouds.outputs[0], mix.inputs[0])
    links.new(ramp.outputs[0], mix.inputs[6])
    links.new(mix.outputs[2], background.inputs[0])
    background.inputs[1].default_value = 0.9
    links.new(background.outputs[0], output.inputs[0])
