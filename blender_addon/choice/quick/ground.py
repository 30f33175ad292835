# SPDX-License-Identifier: GPL-3.0-or-later
"""The place on the street that a view looks at: where a new box stands."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Vector

from ...scene import blocks, drive_scene, view

__all__ = ["on_ground"]

AHEAD_M, FARTHEST_M = 10.0, 25.0
"""Where no ground is met: so far ahead; ground farther away is no place for a box."""
CAMERA_M = 1.6
"""Height over the street of a camera of which nothing else is known."""
NEAR = 0.15
"""Share of the points around the spot whose lowest are its ground."""


def on_ground(context: bpy.types.Context) -> tuple[float, float, float]:
    """On the ground, amid what the 3D view shows; ahead of the scene's camera where there is no view, else the 3D cursor."""
    scene = context.scene
    metre = drive_scene.metre_of(scene)
    eye, ahead = _look(context)
    if eye is None:
        return tuple(scene.cursor.location)
    height = _ground_at(scene, eye + ahead * AHEAD_M * metre, metre)
    if height is None:
        height = eye.z - CAMERA_M * metre
    if ahead.z < -1e-3 and (height - eye.z) / ahead.z < FARTHEST_M * metre:
        spot = eye + ahead * ((height - eye.z) / ahead.z)
    else:
        spot = eye + ahead * AHEAD_M * metre
    own = _ground_at(scene, spot, metre)
    return spot.x, spot.y, height if own is None else own


def _look(context: bpy.types.Context) -> tuple[Vector | None, Vector]:
    """The viewer's place, and the direction of its middle."""
    region_data, camera = context.region_data, context.scene.camera
    if region_data is not None and region_data.view_perspective == "PERSP":
        back = region_data.view_matrix.inverted()
        return back.translation.copy(), -back.to_3x3().col[2].normalized()
    if camera is not None:
        world = camera.matrix_world
        return world.translation.copy(), -world.to_3x3().col[2].normalized()
    return None, Vector((0.0, 1.0, 0.0))


def _ground_at(scene: bpy.types.Scene, spot: Vector, metre: float) -> float | None:
    """Height of the lowest of the drive's points around a place; None where there are none."""
    collection = view.shown_drive(scene)
    points = None if collection is None else blocks.find(bpy.data.meshes, blocks.drive_of(collection), "points")
    if points is None or not len(points.vertices):
        return None
    places = np.empty(3 * len(points.vertices), np.float32)
    points.attributes["position"].data.foreach_get("vector", places)
    places = places.reshape(-1, 3)
    away = np.hypot(places[:, 0] - spot.x, places[:, 1] - spot.y)
    around = np.sort(places[away < 2.0 * metre, 2])
    return float(around[int(NEAR * len(around))]) if len(around) else None
