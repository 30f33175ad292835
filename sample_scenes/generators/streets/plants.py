"""Trees: a trunk with branches and a crown of leaves, a few shapes shared by all, and rows of them far off."""

from __future__ import annotations

import math

import bmesh
import bpy
import numpy as np
from mathutils import Vector

from sample_scenes.generators.streets.mesh import link, mesh_of
from sample_scenes.generators.streets.plan import VEGETATION, Leg, Plan
from sample_scenes.generators.streets.surface import reach

SHAPES = 3
LEAVES = 2600
LEAF_M = 0.26
"""Side of a leaf, metres: it stands for a tuft."""
CLEAR_OF_STREETS_M = 26.0


def crown_mesh(rng: np.random.Generator, name: str, material: bpy.types.Material) -> bpy.types.Mesh:
    """A crown around the origin, about 2 m in radius: dark lumps inside, tufts of leaves on and around them."""
    made = bmesh.new()
    centres = rng.normal(0, 0.62, (11, 3)) * (1.0, 1.0, 0.8)
    radii = rng.uniform(0.45, 0.85, 11)
    for centre, radius in zip(centres, radii, strict=True):
        for v in bmesh.ops.create_icosphere(made, subdivisions=3, radius=float(radius))["verts"]:
            v.co = v.co * (1 + float(rng.normal(0, 0.08))) + Vector(centre)
    mesh = bpy.data.meshes.new(name)
    made.to_mesh(mesh)
    made.free()
    vertices = [tuple(v.co) for v in mesh.vertices]
    faces = [tuple(p.vertices) for p in mesh.polygons]
    which = rng.integers(0, 11, LEAVES)
    out = rng.normal(0, 1, (LEAVES, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    at = centres[which] + out * radii[which, None] * rng.uniform(0.9, 1.3, (LEAVES, 1))
    u = np.cross(out, rng.normal(0, 1, (LEAVES, 3)))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(out, u) + 0.6 * rng.normal(0, 1, (LEAVES, 3))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    size = LEAF_M / 2 * rng.uniform(0.6, 1.3, (LEAVES, 1))
    quads = np.stack([at - u * size - v * size, at + u * size - v * size * 0.4, at + u * size + v * size, at - u * size * 0.4 + v * size], axis=1)
    base = len(vertices)
    vertices += [tuple(p) for p in quads.reshape(-1, 3)]
    faces += [tuple(range(base + 4 * k, base + 4 * k + 4)) for k in range(LEAVES)]
    bpy.data.meshes.remove(mesh)
    return mesh_of(name, np.array(vertices), faces, material)


def trunk_mesh(rng: np.random.Generator, name: str, material: bpy.types.Material) -> bpy.types.Mesh:
    """A trunk 3 m high that forks into the crown; its foot lies below the ground."""
    points, faces = [], []

    def limb(a: np.ndarray, b: np.ndarray, thick: float, thin: float) -> None:
        axis = (b - a) / np.linalg.norm(b - a)
        u = np.cross(axis, (0.3, 1.0, 0.2))
        u /= np.linalg.norm(u)
        w = np.cross(axis, u)
        base = len(points)
        for p, r in ((a, thick), ((a + b) / 2, (thick + thin) / 2 * 0.95), (b, thin)):
            points.extend(p + r * (math.cos(k * math.pi / 4) * u + math.sin(k * math.pi / 4) * w) for k in range(8))
        faces.extend((base + 8 * i + k, base + 8 * i + (k + 1) % 8, base + 8 * i + 8 + (k + 1) % 8, base + 8 * i + 8 + k) for i in range(2) for k in range(8))

    top = np.array([rng.normal(0, 0.06), rng.normal(0, 0.06), 2.5])
    limb(np.array([0.0, 0.0, -0.3]), top, 0.17, 0.11)
    for k in range(4):
        a = 2 * math.pi * k / 4 + float(rng.uniform(-0.5, 0.5))
        limb(top - (0, 0, 0.2), top + np.array([0.75 * math.cos(a), 0.75 * math.sin(a), float(rng.uniform(0.9, 1.5))]), 0.08, 0.03)
    return mesh_of(name, np.array(points), faces, material)


class Trees:
    """Makes trees that share a few meshes."""

    def __init__(self, seed: int, materials: dict[str, bpy.types.Material]) -> None:
        rng = np.random.default_rng([seed, 2])
        self.crowns = [crown_mesh(rng, f"crown {k}", materials[f"leaves {k}"]) for k in range(SHAPES)]
        self.trunks = [trunk_mesh(rng, f"trunk {k}", materials["bark"]) for k in range(SHAPES)]

    def plant(self, foot: np.ndarray, size: float, key: int, wide: float = 1.0) -> None:
        """A tree with its foot at a place (3,)."""
        turn = key % 628 / 100
        for meshes, lift in ((self.trunks, 0.0), (self.crowns, 4.1 * size)):
            obj = link(meshes[key % SHAPES], VEGETATION)
            obj.location = tuple(foot + (0, 0, lift))
            obj.rotation_euler = (0, 0, turn)
            obj.scale = (size * wide, size * wide, size)


def build_backdrop(trees: Trees, plan: Plan) -> None:
    """Rows of large trees far to both sides and across both ends, so that no street ends in nothing."""
    rng = np.random.default_rng([plan.seed, 3])
    lines = [leg.path.place(np.arange(leg.s0, leg.s1, 2.0), 0.0)[:, :2] for leg in plan.legs]
    for leg in plan.legs:
        for side in (-1, 1):
            for s in np.arange(leg.s0, leg.s1, 8.0):
                t = float(rng.uniform(30, 46))
                if reach(leg.path, s, side, 60.0) > t:
                    _far_tree(trees, leg, float(s), side * t, lines, rng)
        for s, way in ((leg.s0, 1), (leg.s1, -1)):
            for t in np.arange(-44, 45, 5.5):
                _far_tree(trees, leg, float(s + way * rng.uniform(-3, 3)), float(t), [], rng)


def _far_tree(trees: Trees, leg: Leg, s: float, t: float, lines: list[np.ndarray], rng: np.random.Generator) -> None:
    foot = leg.path.place(s, t, -0.6)
    if all(np.linalg.norm(line - foot[:2], axis=1).min() > CLEAR_OF_STREETS_M for line in lines):
        trees.plant(foot, float(rng.uniform(1.5, 2.6)), int(rng.integers(0, 1 << 20)), 1.25)
