# SPDX-License-Identifier: GPL-3.0-or-later
"""A track of the drive as an animated camera, with a key at the frame of each picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ..formats.drive_files import DriveFrame
from . import blocks, versions

__all__ = ["FARTHEST_M", "fit_scene_to", "track_camera", "track_of"]

FARTHEST_M = 2000.0
"""That a camera shows: a street has nothing beyond."""
DRAWN_M = 0.3
"""Width of the pyramid that stands for a camera: of a camera on a car's roof, not of the car."""


def track_camera(
    collection: bpy.types.Collection,
    drive: str,
    track: str,
    frames: Sequence[DriveFrame],
    times: Sequence[int],
    metre: float,
) -> bpy.types.Object:
    """The camera of a track, made or brought up to date.

    Args:
        collection: where it belongs; drive: the mark of its data blocks.
        track: its name; frames: at least one.
        times: frame of the timeline of each; metre: units of the scene.
    """
    camera = blocks.ensure(bpy.data.cameras, drive, f"camera:{track}", lambda: _new_camera(track))
    thing = blocks.ensure_object(camera, drive, f"camera:{track}", track, collection)
    thing["unveil_track"] = track
    thing["unveil_size"] = [frames[0].width, frames[0].height]
    thing["unveil_aspect"] = list(frames[0].lens.aspect)
    camera.type, camera.sensor_fit, camera.lens_unit = "PERSP", "HORIZONTAL", "MILLIMETERS"
    camera.sensor_width = frames[0].lens.sensor_mm
    camera.clip_start, camera.clip_end = 0.05 * metre, FARTHEST_M * metre
    camera.display_size = DRAWN_M * metre
    thing.rotation_mode, thing.scale = "QUATERNION", (1.0, 1.0, 1.0)

    poses = [Matrix(f.camera_to_scene.tolist()) for f in frames]
    turns = np.array([m.to_quaternion() for m in poses])
    for i in range(1, len(turns)):  # q and -q are one turn, but halfway between them there is none
        if turns[i] @ turns[i - 1] < 0:
            turns[i] *= -1
    places = np.array([f.camera_to_scene[:3, 3] for f in frames])
    thing.location, thing.rotation_quaternion = places[0], turns[0]
    _animate(thing, drive, f"poses:{track}", times, {"location": places, "rotation_quaternion": turns})

    lenses = [f.lens for f in frames]
    values = {
        name: np.array([[getattr(lens, attribute)] for lens in lenses])
        for name, attribute in (("lens", "focal_mm"), ("shift_x", "shift_x"), ("shift_y", "shift_y"))
    }
    for name, column in values.items():
        setattr(camera, name, column[0, 0])
    changing = {name: column for name, column in values.items() if np.ptp(column) > 1e-9}
    if changing or camera.animation_data is not None:
        _animate(camera, drive, f"lens:{track}", times, changing)
    return thing


def _new_camera(name: str) -> bpy.types.Camera:
    """What is outside the picture is dark: points that are everywhere would draw the eye away from it."""
    camera = bpy.data.cameras.new(name)
    camera.passepartout_alpha = 0.92
    return camera


def _animate(block: Any, drive: str, role: str, times: Sequence[int], channels: dict[str, np.ndarray]) -> None:
    """Keys at some frames of each channel (N, width), linear between them; whatever was there goes."""
    action = blocks.ensure(bpy.data.actions, drive, role, lambda: bpy.data.actions.new(role))
    animation = block.animation_data or block.animation_data_create()
    if animation.action != action:
        animation.action = action
    for path, values in channels.items():
        for i in range(values.shape[1]):
            curve = versions.fcurve_of(block, action, path, i)
            curve.keyframe_points.clear()
            curve.keyframe_points.add(len(values))
            keys = np.stack([np.asarray(times), values[:, i]], axis=1)
            curve.keyframe_points.foreach_set("co", keys.astype(np.float32).ravel())
            linear = bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items["LINEAR"].value
            curve.keyframe_points.foreach_set("interpolation", np.full(len(values), linear, np.int32))
            curve.update()


def fit_scene_to(scene: bpy.types.Scene, camera: bpy.types.Object) -> None:
    """Give the scene the size and pixel aspect of a track's pictures and make its camera the active one: both are the scene's."""
    scene.camera = camera
    width, height = (int(v) for v in camera["unveil_size"])
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = width, height, 100
    scene.render.pixel_aspect_x, scene.render.pixel_aspect_y = (float(v) for v in camera["unveil_aspect"])


def track_of(thing: bpy.types.Object | None) -> str | None:
    """The name of the track that a camera shows, None for other objects."""
    return None if thing is None or thing.type != "CAMERA" else thing.get("unveil_track")
