"""A wall at z = 0 with a window nobody saw through, and cameras before it: holes whose place and size are known exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.frames.holes import FrameTask, Hole
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels

Rectangle = tuple[float, float, float, float]
"""Left, right, top, bottom of a part of the wall, metres."""


def before_wall(x: float, distance: float) -> Camera:
    """A camera of 96x72 pixels that looks straight at the wall."""
    pose = np.eye(4)
    pose[:3, 3] = (-x, 0.0, distance)
    return Camera(96, 72, 60.0, 60.0, 48.0, 36.0, pose)


def shows(camera: Camera, *parts: Rectangle) -> NDArray[np.bool_]:
    """(H, W) pixels that show one of the parts of the wall."""
    points = camera.unproject(np.full((camera.height, camera.width), camera.world_to_camera[2, 3]))
    mask = np.zeros(points.shape[:2], dtype=bool)
    for left, right, top, bottom in parts:
        mask |= (points[..., 0] > left) & (points[..., 0] < right) & (points[..., 1] > top) & (points[..., 1] < bottom)
    return mask


def hole_of(camera: Camera, *parts: Rectangle) -> Hole:
    """A hole on the wall."""
    mask = shows(camera, *parts)
    return Hole(camera, mask, np.full(int(mask.sum()), camera.world_to_camera[2, 3]))


def wall_without(part: Rectangle) -> Surfels:
    """A striped wall, 8 by 5 metres, without one part."""
    x, y = np.meshgrid(np.arange(-4, 4, 0.05), np.arange(-2.5, 2.5, 0.05))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    left, right, top, bottom = part
    gone = (points[:, 0] > left) & (points[:, 0] < right) & (points[:, 1] > top) & (points[:, 1] < bottom)
    points = points[~gone]
    bright = (np.floor(points[:, 0] / 0.5) % 2).astype(np.uint8)
    colors = 90 + 60 * np.repeat(bright[:, None], 3, axis=1)
    normals = np.repeat([[0.0, 0.0, -1.0]], len(points), axis=0)
    count = len(points)
    return surfels_from_points(
        points, colors.astype(np.uint8), np.zeros(count, dtype=np.int64), normals, np.full(count, 0.05), opacity=0.95
    )


def task_of(camera: Camera, part: Rectangle) -> FrameTask:
    """A frame in which something red hides a part of the wall."""
    hidden = shows(camera, part)
    image = np.full((*hidden.shape, 3), 120, dtype=np.uint8)
    image[hidden] = (200, 0, 0)
    return FrameTask(camera, image, hidden, hidden)
