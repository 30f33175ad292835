"""Builds one mesh of each kind of vehicle; things of a kind share it and bring their own paint.

Vehicles point along +x, their wheels stand on z = 0, their middle is the origin. Tools are the parked street's.
"""

from __future__ import annotations

import math

import bpy
import numpy as np

from sample_scenes.generators.parked_street import build_street as kit
from sample_scenes.generators.streets.materials import of_object
from sample_scenes.generators.streets.mesh import joined
from sample_scenes.generators.streets.plan import KINDS

Materials = dict[str, bpy.types.Material]
PASSENGER = {
    # bonnet and boot: where the glass ends, as shares of the length from the middle; roof: its ends; clear: of the ground, metres
    "saloon": {"front": 0.26, "rear": -0.40, "roof": (0.05, -0.24), "clear": 0.20, "wheel": 0.32},
    "hatch": {"front": 0.27, "rear": -0.485, "roof": (0.06, -0.37), "clear": 0.20, "wheel": 0.31},
    "estate": {"front": 0.26, "rear": -0.485, "roof": (0.06, -0.42), "clear": 0.20, "wheel": 0.32},
    "suv": {"front": 0.26, "rear": -0.48, "roof": (0.06, -0.40), "clear": 0.30, "wheel": 0.37},
}


def vehicle_materials() -> Materials:
    """What vehicles are made of, beside the kit's."""
    return {**kit.removable_materials(), "glass": kit.glass("car glass"), "skin": of_object("car paint", 0.35, 0.4), "trim": kit.plain("trim", (0.02, 0.02, 0.022))}


def box(name: str, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], material: bpy.types.Material):  # type: ignore[no-untyped-def]
    """A box with sharp edges."""
    return kit.flat_part(name, kit.cuboid(*x, *y, *z), material)


def wheels(axles: list[float], half: float, radius: float, m: Materials, wide: float = 1.0) -> list:  # type: ignore[type-arg]
    """Wheels on both sides, in dark wells."""
    parts = []
    for side in (-1, 1):
        for x in axles:
            found = kit.wheel(x, side * (half - 0.1), radius, m)
            parts += found
            a = np.linspace(0, math.pi, 17)
            arch = [(x + radius * 1.2 * math.cos(v), radius * 0.95 + radius * 1.2 * math.sin(v)) for v in a]
            y0, y1 = side * (half - 0.35), side * (half + 0.004)
            vertices = [(px, y, pz) for y in (y0, y1) for px, pz in arch]
            faces = [tuple(range(17)), tuple(range(33, 16, -1))] + [(k, k + 1, 18 + k, 17 + k) for k in range(16)]
            parts.append(kit.smooth_object("well", vertices, faces, m["trim"]))
            parts[-1].data.polygons.foreach_set("use_smooth", [False] * len(parts[-1].data.polygons))
    return parts


def lights(e: float, half: float, low: float, m: Materials, height: float = 0.16) -> list:  # type: ignore[type-arg]
    """Head and tail lamps, and number plates."""
    parts = []
    for side in (-1, 1):
        y = (side * half * 0.72 - 0.17, side * half * 0.72 + 0.17)
        inner = (side * half * 0.62 - 0.14, side * half * 0.62 + 0.14)
        parts.append(box("headlamp", (e - 0.3, e - 0.045), inner, (low, low + height * 0.85), m["headlamp"]))
        parts.append(box("tail lamp", (-e - 0.004, -e + 0.2), y, (low + 0.06, low + 0.06 + height), m["tail lamp"]))
    for x in ((-e - 0.02, -e + 0.04), (e - 0.04, e + 0.02)):
        parts.append(box("plate", x, (-0.26, 0.26), (low - 0.2, low - 0.09), m["plate"]))
    return parts


def passenger(kind: str, m: Materials) -> list:  # type: ignore[type-arg]
    """Saloon, hatchback, estate or SUV."""
    shape = PASSENGER[kind]
    length, width, height = KINDS[kind].size
    e, w = length / 2, width / 2
    low, belt = float(shape["clear"]), height * 0.63 + float(shape["clear"]) * 0.1
    roof = shape["roof"]
    front, rear = float(shape["front"]) * length, float(shape["rear"]) * length
    head, tail = roof[0] * length, roof[1] * length  # type: ignore[index]
    ring = kit.ring
    boot = belt + (0.02 if kind != "saloon" else 0.03)
    parts = [
        kit.loft("body", [
            (-e, ring(w * 0.88, low + 0.2, belt - 0.12)), (-e + 0.1, ring(w * 0.97, low + 0.05, boot - 0.02)), (-e + 0.7, ring(w, low, boot)),
            (0.0, ring(w, low, belt)), (front - 0.1, ring(w, low, belt - 0.01)), (e - 0.75, ring(w, low, belt - 0.1)),
            (e - 0.14, ring(w * 0.95, low + 0.04, belt - 0.24)), (e, ring(w * 0.86, low + 0.14, belt - 0.34)),
        ], m["skin"]),
        kit.loft("cabin", [
            (rear, ring(w * 0.84, belt - 0.1, belt + 0.02)), (rear * 0.55 + tail * 0.45, ring(w * 0.83, belt - 0.1, belt * 0.45 + height * 0.52, 0.84)),
            (tail, ring(w * 0.83, belt - 0.1, height - 0.04, 0.8)), ((head + tail) / 2, ring(w * 0.84, belt - 0.1, height, 0.8)),
            (head, ring(w * 0.83, belt - 0.1, height - 0.05, 0.8)), (front * 0.6 + head * 0.4, ring(w * 0.84, belt - 0.1, belt * 0.6 + height * 0.36, 0.84)),
            (front, ring(w * 0.85, belt - 0.12, belt - 0.02)),
        ], m["glass"]),
        kit.loft("roof", [
            (tail - 0.1, ring(w * 0.64, height - 0.14, height - 0.05)), ((head + tail) / 2, ring(w * 0.68, height - 0.12, height + 0.012)),
            (head + 0.02, ring(w * 0.63, height - 0.14, height - 0.045)),
        ], m["skin"]),
        box("underside", (-e + 0.25, e - 0.25), (-w * 0.85, w * 0.85), (low - 0.07, low + 0.1), m["trim"]),
        box("bumper", (e - 0.25, e - 0.012), (-w * 0.8, w * 0.8), (low + 0.06, low + 0.2), m["trim"]),
    ]  # fmt: skip
    for side in (-1, 1):
        y = side * w
        for x, lean in (((head + tail) / 2 - 0.05, 0.0), (tail + 0.02, -0.12)):
            # The glass bulges: a pillar bends with it, half way up.
            middle = (belt + height) / 2 - 0.05
            bends = [(x + lean, y * 0.865, belt - 0.05), (x + lean * 0.5, y * 0.825, middle), (x, y * 0.70, height - 0.07)]
            for (xa, ya, za), (xb, yb, zb) in zip(bends, bends[1:], strict=False):
                corners = [(px + dx, py + dy, pz) for px, py, pz in ((xa, ya, za), (xb, yb, zb)) for dx, dy in ((-0.05, -0.03), (0.05, -0.03), (0.05, 0.03), (-0.05, 0.03))]
                parts.append(kit.flat_part("pillar", corners, m["skin"]))
        inner = sorted((y * 0.97, y * 1.09))
        parts.append(box("mirror", (front - 0.42, front - 0.28), (inner[0], inner[1]), (belt - 0.02, belt + 0.11), m["skin"]))
        sill = sorted((y * 0.93, y * 0.985))
        parts.append(box("sill", (-e * 0.55, e * 0.55), (sill[0], sill[1]), (low - 0.02, low + 0.09), m["trim"]))
        for x in (0.14 * length, -0.1 * length):
            door = sorted((y * 0.97, y * 1.008))
            parts.append(box("handle", (x - 0.32, x - 0.18), (door[0], door[1]), (belt - 0.16, belt - 0.13), m["trim"]))
    parts += wheels([-e * 0.6, e * 0.62], w, float(shape["wheel"]), m)
    return parts + lights(e, w, belt - 0.34, m)


def van(m: Materials) -> list:  # type: ignore[type-arg]
    """A delivery van in one volume, glazed in front and at the rear doors."""
    length, width, height = KINDS["van"].size
    e, w, h = length / 2, width / 2, height
    ring = kit.ring
    parts = [
        kit.loft("van body", [
            (-e, ring(w * 0.95, 0.42, h - 0.1, 0.93)), (-e + 0.08, ring(w, 0.3, h, 0.93)), (e - 1.75, ring(w, 0.3, h, 0.93)), (e - 1.35, ring(w * 0.99, 0.3, h * 0.93, 0.92)),
            (e - 0.72, ring(w * 0.98, 0.3, h * 0.58)), (e - 0.1, ring(w * 0.93, 0.33, h * 0.47)), (e, ring(w * 0.86, 0.42, h * 0.4)),
        ], m["skin"]),
        kit.loft("van windscreen", [
            (e - 1.5, ring(w * 0.88, h * 0.62, h * 0.93, 0.9)), (e - 1.1, ring(w * 0.9, h * 0.56, h * 0.80, 0.9)), (e - 0.66, ring(w * 0.87, h * 0.5, h * 0.6, 0.9)),
        ], m["glass"]),
        box("rear glass", (-e - 0.012, -e + 0.1), (-w * 0.72, w * 0.72), (h * 0.62, h * 0.86), m["glass"]),
        box("underside", (-e + 0.2, e - 0.25), (-w * 0.85, w * 0.85), (0.24, 0.4), m["trim"]),
        box("bumper", (e - 0.2, e - 0.0), (-w * 0.85, w * 0.85), (0.34, 0.5), m["trim"]),
    ]  # fmt: skip
    for side in (-1, 1):
        y = sorted((side * w * 0.9, side * w * 1.004))
        parts.append(box("side glass", (e - 2.2, e - 1.28), (y[0], y[1]), (h * 0.58, h * 0.83), m["glass"]))
        out = sorted((side * w * 0.98, side * w * 1.12))
        parts.append(box("mirror", (e - 1.2, e - 1.05), (out[0], out[1]), (h * 0.56, h * 0.7), m["trim"]))
        line = sorted((side * w * 0.95, side * w * 1.006))
        parts.append(box("rub strip", (-e + 0.3, e - 0.9), (line[0], line[1]), (0.62, 0.7), m["trim"]))
    parts += wheels([-e * 0.6, e * 0.64], w, 0.34, m)
    return parts + lights(e, w, 0.72, m, 0.24)


def cab(front: float, width: float, height: float, deep: float, m: Materials) -> list:  # type: ignore[type-arg]
    """The cab of a lorry, its face at x = ``front``."""
    w = width / 2
    parts = [
        box("cab", (front - deep, front), (-w * 0.97, w * 0.97), (0.45, height), m["skin"]),
        box("windscreen", (front - 0.1, front + 0.012), (-w * 0.87, w * 0.87), (height * 0.56, height * 0.88), m["glass"]),
        box("grille", (front - 0.1, front + 0.015), (-w * 0.6, w * 0.6), (height * 0.28, height * 0.48), m["trim"]),
        box("bumper", (front - 0.2, front + 0.03), (-w * 0.985, w * 0.985), (0.32, 0.62), m["trim"]),
    ]
    for side in (-1, 1):
        y = sorted((side * w * 0.9, side * w * 0.978))
        parts.append(box("cab glass", (front - deep * 0.68, front - 0.16), (y[0], y[1]), (height * 0.56, height * 0.84), m["glass"]))
        out = sorted((side * w * 0.98, side * w * 1.09))
        parts.append(box("mirror", (front - 0.2, front - 0.06), (out[0], out[1]), (height * 0.55, height * 0.78), m["trim"]))
        lamp = sorted((side * w * 0.6, side * w * 0.92))
        parts.append(box("headlamp", (front - 0.1, front + 0.035), (lamp[0], lamp[1]), (0.66, 0.84), m["headlamp"]))
    return parts


def cargo(x0: float, x1: float, width: float, low: float, high: float, m: Materials) -> list:  # type: ignore[type-arg]
    """A box body with ribs, door bars, side guards and tail lamps, on a frame."""
    w = width / 2
    parts = [
        box("box body", (x0, x1), (-w, w), (low, high), m["white"]), box("frame", (x0 + 0.1, x1 + 0.6), (-0.45, 0.45), (low - 0.35, low), m["trim"]),
        box("band", (x0 + 0.3, x1 - 0.3), (-w - 0.006, w + 0.006), ((low + high) / 2 - 0.25, (low + high) / 2 + 0.35), m["skin"]),
        box("rear bar", (x0 - 0.02, x0 + 0.08), (-w * 0.96, w * 0.96), (0.5, 0.66), m["trim"]),
    ]  # fmt: skip
    for y in (-0.35, -0.05, 0.05, 0.35):
        parts.append(box("door bar", (x0 - 0.03, x0), (y * w * 2 - 0.015, y * w * 2 + 0.015), (low + 0.05, high - 0.05), m["trim"]))
    for side in (-1, 1):
        guard = sorted((side * w * 0.94, side * w * 0.98))
        parts.append(box("guard", (x0 + 2.4, x1 - 0.9), (guard[0], guard[1]), (0.5, low - 0.12), m["rim"]))
        lamp = sorted((side * w * 0.6, side * w * 0.92))
        parts.append(box("tail lamp", (x0 - 0.035, x0 + 0.05), (lamp[0], lamp[1]), (0.68, 0.82), m["tail lamp"]))
        for x in np.arange(x0 + 0.02, x1, 1.25):
            rib = sorted((side * w, side * (w + 0.012)))
            parts.append(box("rib", (float(x), float(x) + 0.04), (rib[0], rib[1]), (low, high), m["rim"]))
    return parts


def lorry(kind: str, m: Materials) -> list:  # type: ignore[type-arg]
    """A box van, a lorry or an articulated one."""
    length, width, height = KINDS[kind].size
    e, w = length / 2, width / 2
    if kind == "box van":
        parts = cab(e, width * 0.92, 2.25, 1.75, m) + cargo(-e, e - 1.85, width, 0.85, height, m)
        return parts + wheels([-e * 0.5, e - 0.95], w * 0.96, 0.38, m)
    deep = 2.1 if kind == "lorry" else 2.3
    parts = cab(e, width, height * 0.86, deep, m) + cargo(-e, e - deep - (0.25 if kind == "lorry" else 0.6), width, 1.15, height, m)
    axles = [e - 1.3, -e + 2.2] if kind == "lorry" else [e - 1.4, e - 4.9, -e + 4.4, -e + 3.1, -e + 1.8]
    parts.append(box("chassis", (-e + 0.4, e - 0.4), (-0.45, 0.45), (0.7, 1.0), m["trim"]))
    return parts + wheels(axles, w * 0.98, 0.5, m)


def bus(m: Materials) -> list:  # type: ignore[type-arg]
    """A city bus: glass all around, doors on the right, route board in front."""
    length, width, height = KINDS["bus"].size
    e, w = length / 2, width / 2
    parts = [
        box("bus body", (-e, e), (-w, w), (0.32, height - 0.08), m["skin"]), box("bus roof", (-e + 0.1, e - 0.1), (-w * 0.94, w * 0.94), (height - 0.1, height), m["white"]),
        box("air box", (-e + 2, -e + 4.5), (-0.8, 0.8), (height, height + 0.22), m["white"]), box("windscreen", (e - 0.1, e + 0.012), (-w * 0.92, w * 0.92), (0.95, 2.45), m["glass"]),
        box("board", (e - 0.1, e + 0.014), (-w * 0.75, w * 0.75), (2.55, 2.85), m["trim"]), box("rear glass", (-e - 0.012, -e + 0.1), (-w * 0.8, w * 0.8), (1.6, 2.5), m["glass"]),
        box("skirt", (-e - 0.004, e + 0.004), (-w * 1.003, w * 1.003), (0.24, 0.4), m["trim"]), box("bumper", (e - 0.1, e + 0.03), (-w * 0.98, w * 0.98), (0.3, 0.55), m["trim"]),
    ]  # fmt: skip
    for side in (-1, 1):
        y = sorted((side * w * 0.95, side * (w + 0.008)))
        for k in range(7):
            x = e - 0.35 - 1.62 * k
            parts.append(box("bus window", (x - 1.5, x), (y[0], y[1]), (1.25, 2.5), m["glass"]))
        lamp = sorted((side * w * 0.62, side * w * 0.93))
        parts.append(box("headlamp", (e - 0.1, e + 0.034), (lamp[0], lamp[1]), (0.6, 0.78), m["headlamp"]))
        parts.append(box("tail lamp", (-e - 0.014, -e + 0.1), (lamp[0], lamp[1]), (0.75, 1.2), m["tail lamp"]))
        out = sorted((side * w * 1.0, side * w * 1.12))
        parts.append(box("mirror", (e - 0.1, e + 0.06), (out[0], out[1]), (1.9, 2.4), m["trim"]))
    for x in (e - 1.5, 0.6, -e + 3.4):
        parts.append(box("bus door", (x - 0.62, x + 0.62), (-w - 0.014, -w * 0.95), (0.36, 2.55), m["glass"]))
        for edge in (-0.62, 0.0, 0.58):
            parts.append(box("door frame", (x + edge, x + edge + 0.04), (-w - 0.02, -w * 0.95), (0.36, 2.55), m["trim"]))
    return parts + wheels([e - 2.75, -e + 2.6], w + 0.004, 0.48, m)


def tube(a: tuple[float, float, float], b: tuple[float, float, float], radius: float, material: bpy.types.Material):  # type: ignore[no-untyped-def]
    """A round bar between two points."""
    start, end = np.array(a), np.array(b)
    axis = (end - start) / np.linalg.norm(end - start)
    u = np.cross(axis, (0.31, 0.95, 0.12))
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    vertices = [tuple(p + radius * (math.cos(k * math.pi / 4) * u + math.sin(k * math.pi / 4) * v)) for p in (start, end) for k in range(8)]
    faces = [(k, (k + 1) % 8, 8 + (k + 1) % 8, 8 + k) for k in range(8)] + [tuple(range(7, -1, -1)), tuple(range(8, 16))]
    return kit.smooth_object("tube", vertices, faces, material)


def bicycle(m: Materials) -> list:  # type: ignore[type-arg]
    """Two wheels with spokes, a frame, saddle, handlebar, mudguard and a stand."""
    r, skin, dark = 0.34, m["skin"], m["trim"]
    parts = []
    for x in (-0.52, 0.52):
        ring = [(x + r * math.cos(a), 0.0, r + r * math.sin(a)) for a in np.linspace(0, 2 * math.pi, 25)]
        parts += [tube(p, q, 0.022, m["tyre"]) for p, q in zip(ring, ring[1:], strict=False)]
        parts += [tube((x, 0.0, r), ring[k], 0.005, m["rim"]) for k in range(0, 24, 3)]
        parts.append(tube((x, -0.05, r), (x, 0.05, r), 0.025, m["rim"]))
    crank, seat, head = (-0.08, 0.0, 0.3), (-0.24, 0.0, 0.82), (0.36, 0.0, 0.86)
    for a, b in ((crank, seat), (crank, (0.4, 0, 0.68)), (seat, head), ((-0.52, 0, r), crank), ((-0.52, 0, r), (-0.22, 0, 0.74)), ((0.52, 0, r), head)):
        parts.append(tube(a, b, 0.02, skin))
    parts += [tube(seat, (-0.27, 0, 0.93), 0.014, m["rim"]), tube(head, (0.33, 0, 1.0), 0.015, m["rim"]), tube((0.3, -0.27, 1.03), (0.3, 0.27, 1.03), 0.014, dark)]
    parts += [box("saddle", (-0.4, -0.15), (-0.07, 0.07), (0.92, 0.97), dark), tube((-0.08, -0.13, 0.16), (-0.08, 0.13, 0.44), 0.012, dark)]
    parts += [tube((-0.3, 0.03, 0.3), (-0.34, 0.2, 0.0), 0.011, dark), box("rack", (-0.75, -0.35), (-0.06, 0.06), (0.72, 0.735), dark)]
    return parts


def vehicle_mesh(kind: str, m: Materials) -> bpy.types.Mesh:
    """The mesh of a kind."""
    if kind in PASSENGER:
        parts = passenger(kind, m)
    elif kind == "van":
        parts = van(m)
    elif kind == "bus":
        parts = bus(m)
    elif kind == "bicycle":
        parts = bicycle(m)
    else:
        parts = lorry(kind, m)
    return joined(kind, parts)
