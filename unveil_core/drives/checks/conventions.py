"""Which way the matrices of poses are meant: from the camera or to it, and with which axes.

Every program has a habit, and files do not tell which. A matrix is read back as the file has it, and taken in another way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from unveil_core.base.drive_options import POSE_CONVENTIONS
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.transforms import rigid_inverse

__all__ = ["OPENCV", "OPENGL", "WORLD_TO_CAMERA", "in_convention", "pose_in", "with_pose_convention"]

OPENGL, OPENCV, WORLD_TO_CAMERA, WORLD_TO_CAMERA_OPENGL = POSE_CONVENTIONS
TURNED = np.diag([1.0, -1.0, -1.0, 1.0])
"""From OpenGL's axes (x right, y up, z back) to OpenCV's (x right, y down, z forward), and back."""
READ: dict[str, Callable[[Float64], Float64]] = {
    OPENGL: lambda m: rigid_inverse(m @ TURNED),
    OPENCV: rigid_inverse,
    WORLD_TO_CAMERA: lambda m: m,
    WORLD_TO_CAMERA_OPENGL: lambda m: TURNED @ m,
}
"""World to camera with OpenCV's axes, of a matrix in each convention."""
WRITTEN: dict[str, Callable[[Float64], Float64]] = {
    OPENGL: lambda w: rigid_inverse(w) @ TURNED,
    OPENCV: rigid_inverse,
    WORLD_TO_CAMERA: lambda w: w,
    WORLD_TO_CAMERA_OPENGL: lambda w: TURNED @ w,
}
"""The inverse."""


def pose_in(matrix: Float64, convention: str) -> Float64:
    """(4, 4) world to camera with OpenCV's axes of a rigid matrix (4, 4) of a file."""
    return READ[convention](matrix)


def in_convention(cameras: Sequence[Camera], native: str, other: str) -> list[Camera]:
    """Cameras that were read in one convention, as they are if their matrices are meant in another one."""
    return [replace(c, world_to_camera=pose_in(WRITTEN[native](c.world_to_camera), other)) for c in cameras]


def with_pose_convention(drive: Drive, convention: str) -> Drive:
    """A drive whose poses were read in the habit of its format, as they are in another convention. What LiDARs measured stays."""
    cameras = in_convention([f.camera for f in drive.frames], drive.pose_convention, convention)
    frames = tuple(replace(f, camera=c) for f, c in zip(drive.frames, cameras, strict=True))
    return replace(drive, frames=frames, pose_convention=convention)
