"""Builds the scene of a plan: all that stays, and the things that are removed, each an object of its own."""

from __future__ import annotations

import math

import bpy
from mathutils import Matrix

from sample_scenes.generators.streets.facades import build_lot
from sample_scenes.generators.streets.furniture import build_post
from sample_scenes.generators.streets.light import build_light
from sample_scenes.generators.streets.materials import plain, street_materials
from sample_scenes.generators.streets.mesh import Builder, link
from sample_scenes.generators.streets.people import person_meshes
from sample_scenes.generators.streets.plan import KINDS, Leg, Plan, Thing
from sample_scenes.generators.streets.plants import Trees, build_backdrop
from sample_scenes.generators.streets.surface import build_surface
from sample_scenes.generators.streets.vehicles import vehicle_materials, vehicle_mesh

STANDS_M = 0.006
"""Wheels and feet stand so much over the ground: on its paint, and never within it."""


def build(plan: Plan) -> tuple[bpy.types.Scene, dict[int, bpy.types.Object]]:
    """The scene and, by number, the objects of its things."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    materials = street_materials(plan.wear, plan.light.kind == "dusk")
    builder = Builder()
    build_surface(builder, plan)
    trees = Trees(plan.seed, materials)
    for leg in plan.legs:
        for lot in leg.lots:
            build_lot(builder, materials, leg, lot)
        for post in leg.posts:
            if post.kind == "tree":
                trees.plant(leg.path.place(post.s, post.t, leg.section.kerb), post.size, post.key)
            else:
                build_post(builder, leg, post)
    builder.build(materials)
    build_backdrop(trees, plan)
    build_light(scene, plan)
    return scene, _things(plan)


def _things(plan: Plan) -> dict[int, bpy.types.Object]:
    own = vehicle_materials()
    own["white"] = plain("body white", (0.62, 0.62, 0.6), 0.5)
    people = person_meshes(own)
    meshes: dict[str, bpy.types.Mesh] = {}
    found = {}
    for thing in plan.things:
        if thing.kind == "person":
            mesh = people["walking" if thing.speed or thing.number % 3 == 0 else "standing"]
        else:
            if thing.kind not in meshes:
                meshes[thing.kind] = vehicle_mesh(thing.kind, own)
            mesh = meshes[thing.kind]
        obj = link(mesh, KINDS[thing.kind].label)
        obj.name = f"{thing.kind} {thing.number}"
        obj["instance"], obj.color = thing.number, (*thing.color, 1)
        if thing.kind == "person":
            size = 0.9 + 0.15 * (thing.number * 37 % 100) / 100
            obj.scale = (size, size, size)
        found[thing.number] = obj
        stand(obj, thing, plan, 0.0)
    return found


def camber(leg: Leg, t: float) -> float:
    """Rise of the carriageway towards the left at t, metres a metre; 0 beside it."""
    a, b = t - 0.7, t + 0.7
    if -leg.section.kerb_at(-1) <= a and b <= leg.section.kerb_at(1):
        return (leg.section.height(b) - leg.section.height(a)) / 1.4
    return 0.0


def stand(obj: bpy.types.Object, thing: Thing, plan: Plan, time: float) -> None:
    """Put a thing where it is at a time: vehicles lie along the slope, people stand upright."""
    leg = plan.legs[thing.leg]
    s, t = thing.at(time)
    x, y, z = leg.path.place(s, t, leg.section.height(t) + STANDS_M)
    angle = float(leg.path.heading(s)) + thing.turn
    matrix = Matrix.Translation((x, y, z)) @ Matrix.Rotation(angle, 4, "Z")
    if thing.kind != "person":
        along = leg.path.grade(s) * math.cos(thing.turn) + leg.path.tilt * math.sin(thing.turn)
        across = -leg.path.grade(s) * math.sin(thing.turn) + (leg.path.tilt + camber(leg, t)) * math.cos(thing.turn)
        matrix = matrix @ Matrix.Rotation(-math.atan(along), 4, "Y") @ Matrix.Rotation(math.atan(across), 4, "X")
    obj.matrix_world = matrix @ Matrix.Diagonal((*obj.scale, 1.0))
