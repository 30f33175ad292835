# SPDX-License-Identifier: GPL-3.0-or-later
"""An animated camera of the artist's, frame by frame: however it moves, by keys, parents, constraints or a cache."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np

__all__ = ["CameraAt", "ShotError", "check_camera", "sampled"]

SAME_SHAPE = 0.005
"""Share by which sides of the plates and of what the scene renders may be off: half a pixel of 100."""


class ShotError(Exception):
    """What keeps a shot from being used, in one line."""


@dataclass(frozen=True, eq=False)
class CameraAt:
    """Attributes:
    to_world: (4, 4) float64 of the camera, without its scale, units of the scene.
    focal, centre: pixels of the plates, x and y; the centre from the corner, y down.
    """

    to_world: np.ndarray
    focal: tuple[float, float]
    centre: tuple[float, float]


def check_camera(scene: bpy.types.Scene, size: tuple[int, int]) -> bpy.types.Object:
    """The active camera, where it can have taken plates of this size.

    Raises:
        ShotError: there is none, it is no perspective one, or the scene renders another shape of picture.
    """
    camera, render = scene.camera, scene.render
    if camera is None:
        raise ShotError("The scene has no active camera: select the shot's camera and press Ctrl Numpad 0")
    if camera.type != "CAMERA" or camera.data.type != "PERSP":
        raise ShotError(f"Not a perspective camera: {camera.name} (set its lens type to Perspective)")
    off = abs(size[0] * render.resolution_y / (size[1] * render.resolution_x) - 1)
    if off > SAME_SHAPE:
        raise ShotError(
            f"The plates are {size[0]}x{size[1]} and the scene renders {render.resolution_x}x{render.resolution_y}: "
            "set Output Properties > Resolution to the plates' size, or the camera would fit another picture"
        )
    return camera


def sampled(scene: bpy.types.Scene, camera: bpy.types.Object, frames: Sequence[int], size: tuple[int, int]):  # type: ignore[no-untyped-def]
    """The camera at each of some frames, one after the other; the scene then stands where it stood.

    Raises:
        ShotError: it is mirrored, or its scale is 0.
    """
    before = scene.frame_current, scene.frame_subframe
    try:
        for frame in frames:
            scene.frame_set(frame)
            graph = bpy.context.evaluated_depsgraph_get()
            yield _at(camera.evaluated_get(graph), graph, scene, size)
    finally:
        scene.frame_set(before[0], subframe=before[1])


def _at(
    camera: bpy.types.Object, graph: bpy.types.Depsgraph, scene: bpy.types.Scene, size: tuple[int, int]
) -> CameraAt:
    matrix = np.array(camera.matrix_world, dtype=np.float64)
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if scale.min() < 1e-9:
        raise ShotError(
            f"{camera.name} has a scale of 0: set it, or that of its parent, to 1 (Set Floor may leave it so)"
        )
    turn = matrix[:3, :3] / scale
    if np.linalg.det(turn) <= 0:
        raise ShotError(f"{camera.name} is mirrored: apply its scale, or that of its parent")
    first, _, last = np.linalg.svd(turn)  # single precision leaves it a little off, shear of parents more
    matrix[:3, :3] = first @ last
    width, height = size
    render = scene.render
    lens = np.array(
        camera.calc_matrix_camera(
            graph, x=width, y=height, scale_x=render.pixel_aspect_x, scale_y=render.pixel_aspect_y
        )
    )
    focal = float(lens[0, 0] * width / 2), float(lens[1, 1] * height / 2)
    centre = float((1 - lens[0, 2]) * width / 2), float((1 + lens[1, 2]) * height / 2)
    return CameraAt(matrix, focal, centre)
