"""Rotations and axis conventions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unveil_core.base.types import Float64

__all__ = ["nearest_rotation", "opengl_to_opencv", "quat_to_rotation", "rigid_inverse", "rotation_to_quat"]


def quat_to_rotation(quat: Sequence[float] | Float64) -> Float64:
    """(3, 3) rotation of a quaternion wxyz of any length but zero."""
    w, x, y, z = np.asarray(quat, dtype=np.float64) / np.linalg.norm(quat)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip


def rotation_to_quat(rotation: Float64) -> Float64:
    """(..., 4) quaternions wxyz with w >= 0 of rotations (..., 3, 3)."""
    r = np.moveaxis(rotation, (-2, -1), (0, 1))
    # The symmetric matrix whose largest eigenvector is the quaternion (Bar-Itzhack 2000): no branches, no bad cases.
    k = np.array([
        [r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
        [r[2, 1] - r[1, 2], r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[2, 0] + r[0, 2]],
        [r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], r[1, 1] - r[0, 0] - r[2, 2], r[2, 1] + r[1, 2]],
        [r[1, 0] - r[0, 1], r[2, 0] + r[0, 2], r[2, 1] + r[1, 2], r[2, 2] - r[0, 0] - r[1, 1]],
    ])  # fmt: skip
    quats: Float64 = np.linalg.eigh(np.moveaxis(k, (0, 1), (-2, -1)))[1][..., -1]
    return np.where(quats[..., :1] >= 0, quats, -quats)


def nearest_rotation(matrix: Float64) -> tuple[Float64, float]:
    """The rotation nearest to a (3, 3) matrix, and the largest entry of their difference."""
    u, _, vt = np.linalg.svd(matrix)
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return rotation, float(np.abs(rotation - matrix).max())


def rigid_inverse(pose: Float64) -> Float64:
    """(4, 4) inverse of a rigid transform, exact as its rotation is."""
    rotation, translation = pose[:3, :3], pose[:3, 3]
    inverse = np.eye(4)
    inverse[:3, :3] = rotation.T
    inverse[:3, 3] = -rotation.T @ translation
    return inverse


def opengl_to_opencv(camera_to_world: Float64) -> Float64:
    """Camera-to-world (4, 4) with OpenGL axes (x right, y up, z back) to the same with OpenCV axes (y down, z forward)."""
    return camera_to_world @ np.diag([1.0, -1.0, -1.0, 1.0])
