"""Gathers geometry by material and class, so that a street of ten thousand boxes becomes a few dozen objects."""

from __future__ import annotations

import math
from collections import defaultdict

import bpy
import numpy as np

from sample_scenes.generators.streets.plan import Leg

BOX_FACES = np.array([(3, 2, 1, 0), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)])
"""Faces of a box whose eight corners come bottom ring first."""
STATION_M = 0.5
"""Everything swept has its stations at multiples of this, so that what lies on the road has the road's own facets."""


class Builder:
    """Collects vertices, faces and street coordinates (u, v in metres) for each material and class."""

    def __init__(self) -> None:
        self.parts: dict[tuple[str, int], list[tuple[np.ndarray, list, np.ndarray]]] = defaultdict(list)  # type: ignore[type-arg]

    def add(self, material: str, label: int, vertices: np.ndarray, faces: list, uvs: np.ndarray | None = None) -> None:  # type: ignore[type-arg]
        """Add a piece: vertices (N, 3), faces of their indices, uvs (N, 2)."""
        vertices = np.asarray(vertices, float)
        self.parts[material, label].append((vertices, faces, np.zeros((len(vertices), 2)) if uvs is None else np.asarray(uvs, float)))

    def grid(self, material: str, label: int, points: np.ndarray, uvs: np.ndarray | None = None) -> None:
        """A surface through points (R, C, 3), with uvs (R, C, 2)."""
        rows, columns = points.shape[:2]
        index = np.arange(rows * columns).reshape(rows, columns)
        faces = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
        self.add(material, label, points.reshape(-1, 3), faces.tolist(), None if uvs is None else uvs.reshape(-1, 2))

    def box(self, material: str, label: int, corners: np.ndarray) -> None:
        """A box from its eight corners (8, 3); its uvs are metres along its first edge, and up."""
        sides = np.linalg.norm(corners[1] - corners[0]), np.linalg.norm(corners[3] - corners[0]), np.linalg.norm(corners[4] - corners[0])
        uvs = np.array([(x * sides[0] + y * sides[1], z * sides[2]) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
        self.add(material, label, corners, BOX_FACES.tolist(), uvs)

    def street_box(
        self, material: str, label: int, leg: Leg, s: float, t: float, h: float, size: tuple[float, float, float], turn: float = 0.0
    ) -> None:
        """A box on the street: centre of its base at (s, t, h), size along, across, up; turned about the vertical."""
        base = leg.path.place(s, t, h)
        angle = float(leg.path.heading(s)) + turn
        x = np.array([-1, 1, 1, -1]) * size[0] / 2
        y = np.array([-1, -1, 1, 1]) * size[1] / 2
        ring = np.stack([x * math.cos(angle) - y * math.sin(angle), x * math.sin(angle) + y * math.cos(angle), np.zeros(4)], axis=1)
        self.box(material, label, np.concatenate([base + ring, base + ring + (0, 0, size[2])]))

    def sweep(self, material: str, label: int, leg: Leg, s0: float, s1: float, section: list[tuple[float, float]]) -> None:
        """A cross section [(t, h), ...] along the street; uvs are (s, distance along the section), metres."""
        s = stations(s0, s1)
        t, h = np.array(section).T
        run = section[0][0] + np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(t), np.diff(h)))])
        points = leg.path.place(s[:, None], t[None], h[None])
        self.grid(material, label, points, np.stack(np.broadcast_arrays(s[:, None], run[None]), axis=-1))

    def cylinder(self, material: str, label: int, base: np.ndarray, radius: float, height: float, top: float | None = None, sides: int = 12) -> None:
        """An upright cylinder or, with another radius at its ``top``, a cone."""
        a = np.linspace(0, 2 * math.pi, sides + 1)[:-1]
        circle = np.stack([np.cos(a), np.sin(a)], axis=1)
        low = np.concatenate([circle * radius, np.zeros((sides, 1))], axis=1)
        high = np.concatenate([circle * (radius if top is None else top), np.full((sides, 1), height)], axis=1)
        faces = [(i, (i + 1) % sides, sides + (i + 1) % sides, sides + i) for i in range(sides)]
        self.add(material, label, np.concatenate([low, high]) + base, [*faces, tuple(range(sides, 2 * sides))])

    def build(self, materials: dict[str, bpy.types.Material]) -> None:
        """Make the objects, one for each material and class."""
        for (material, label), pieces in self.parts.items():
            first = np.cumsum([0, *(len(v) for v, _, _ in pieces)])
            vertices = np.concatenate([v for v, _, _ in pieces])
            uvs = np.concatenate([uv for _, _, uv in pieces])
            faces = [tuple(int(i) + int(k) for i in f) for k, (_, fs, _) in zip(first, pieces, strict=False) for f in fs]
            mesh = mesh_of(f"{material} {label}", vertices, faces, materials[material], uvs)
            link(mesh, label)


def stations(s0: float, s1: float) -> np.ndarray:
    """Multiples of ``STATION_M`` between two places, and these themselves."""
    inner = np.arange(math.floor(s0 / STATION_M) + 1, math.ceil(s1 / STATION_M)) * STATION_M
    inner = inner[(inner > s0 + 1e-6) & (inner < s1 - 1e-6)]
    return np.concatenate([[s0], inner, [s1]])


def mesh_of(name: str, vertices: np.ndarray, faces: list, material: bpy.types.Material, uvs: np.ndarray | None = None) -> bpy.types.Mesh:  # type: ignore[type-arg]
    """A mesh with one material and, per vertex, the UV map "street"."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces)
    if uvs is not None:
        corner = np.empty(len(mesh.loops), np.int32)
        mesh.loops.foreach_get("vertex_index", corner)
        mesh.uv_layers.new(name="street").data.foreach_set("uv", uvs[corner].astype(np.float32).ravel())
    mesh.materials.append(material)
    return mesh


def link(mesh: bpy.types.Mesh, label: int) -> bpy.types.Object:
    """An object of a mesh, with its class."""
    obj = bpy.data.objects.new(mesh.name, mesh)
    obj["class"] = label
    bpy.context.scene.collection.objects.link(obj)
    return obj


def joined(name: str, parts: list) -> bpy.types.Mesh:  # type: ignore[type-arg]
    """One smoothly shaded mesh of several objects, modifiers applied; the objects go."""
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    vertices, faces, slots, smooth, materials = [], [], [], [], []
    for part in parts:
        mesh = part.evaluated_get(depsgraph).to_mesh()
        base, matrix = len(vertices), part.matrix_world
        vertices += [tuple(matrix @ v.co) for v in mesh.vertices]
        if part.data.materials[0] not in materials:
            materials.append(part.data.materials[0])
        slot = materials.index(part.data.materials[0])
        for polygon in mesh.polygons:
            faces.append(tuple(base + i for i in polygon.vertices))
            slots.append(slot)
            smooth.append(polygon.use_smooth)
    made = bpy.data.meshes.new(name)
    made.from_pydata(vertices, [], faces)
    for material in materials:
        made.materials.append(material)
    made.polygons.foreach_set("material_index", slots)
    made.polygons.foreach_set("use_smooth", smooth)
    for part in parts:
        bpy.data.objects.remove(part)
    return made
