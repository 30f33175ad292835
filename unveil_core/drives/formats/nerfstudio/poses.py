"""Poses of transforms.json: 4x4 or 3x4 matrices by rows, camera-to-world."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.drives.formats.cameras import ROTATION_TOLERANCE
from unveil_core.geometry.transforms import nearest_rotation

__all__ = ["pose_from_matrix"]


def pose_from_matrix(matrix: object, path: Path, frame: str) -> NDArray[np.float64]:
    """A checked (4, 4) rigid camera-to-world transform; rotations off by rounding are made exact.

    Raises:
        DriveError: not 4x4 numbers, NaN, or not a rotation.
    """
    try:
        pose = np.asarray(matrix, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        pose = np.zeros(0)
    if pose.shape == (3, 4):
        pose = np.vstack([pose, [0, 0, 0, 1]])
    if pose.shape != (4, 4):
        raise DriveError(f"Not a 4x4 matrix: the pose of frame {frame}", path=path)
    if not np.isfinite(pose).all():
        raise DriveError(
            f"the pose of frame {frame} holds NaN or infinity", path=path, mend="drop the frame or redo its pose"
        )
    rotation, error = nearest_rotation(pose[:3, :3])
    if error > ROTATION_TOLERANCE:
        raise DriveError(
            f"Not a rotation: the pose of frame {frame} (off by {error:.3g})",
            path=path,
            mend="poses are rigid: no scale, no mirror, no shear",
        )
    pose = pose.copy()
    pose[:3, :3] = rotation
    return pose
