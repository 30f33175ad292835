"""Reduced photographs that are compared with each other, and how their pixels correspond."""

from __future__ import annotations

import cv2
import numpy as np

from unveil_core.base.types import Float32, Float64, Levels
from unveil_core.geometry.camera import Camera

__all__ = ["from_array", "reduced_gray", "to_other"]


def reduced_gray(camera: Camera, image: Levels, side: int) -> tuple[Camera, Float32]:
    """The camera, and the grey levels of 255 (H, W), of a photograph (H, W, 3) whose longer side becomes ``side`` pixels."""
    factor = min(1.0, side / max(camera.width, camera.height))
    size = (max(16, round(camera.width * factor)), max(16, round(camera.height * factor)))
    gray = cv2.resize(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_AREA)
    return camera.resized(*size), gray.astype(np.float32)


def from_array(camera: Camera) -> Float64:
    """(3, 3) from array positions, where the centre of the first pixel is 0, to rays at depth 1. Written out: the library's
    inverse takes longer than the sweep of a frame while its threads wait for one another."""
    x, y = camera.cx - 0.5, camera.cy - 0.5
    return np.array([[1 / camera.fx, 0, -x / camera.fx], [0, 1 / camera.fy, -y / camera.fy], [0, 0, 1]])


def to_other(first: Camera, second: Camera) -> tuple[Float64, Float64]:
    """(3, 3) and (3,): array position p of ``first`` at inverse depth i lies in ``second`` at ``turn p + i shift``."""
    relative = second.world_to_camera @ first.camera_to_world
    there = second.opencv_matrix
    return there @ relative[:3, :3] @ from_array(first), there @ relative[:3, 3]
