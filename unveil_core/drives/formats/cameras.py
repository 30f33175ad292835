"""What readers of datasets share: cameras from calibrations, the size of a picture, ids of tracks, tables of numbers, scenes in a
folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from unveil_core.base.checks.numbers_in_names import natural_key
from unveil_core.base.disk.open_safely import LARGEST_FILE, open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_text
from unveil_core.base.pictures.decoding import size_of_image
from unveil_core.base.pictures.headers import format_of
from unveil_core.base.plates.files import plate_facts
from unveil_core.base.plates.library import PLATES, kind_of
from unveil_core.base.types import Float64
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.transforms import nearest_rotation, quat_to_rotation, rigid_inverse

__all__ = [
    "ROTATION_TOLERANCE",
    "TrackIds",
    "calibrated_camera",
    "picture_size",
    "pose_of",
    "read_numbers",
    "rigid",
    "scenes_of",
]

ROTATION_TOLERANCE = 1e-3
"""Entries of a rotation may be so far off; poses in files are rounded."""
HEADER_BYTES = 1 << 16
"""So much of a PNG is read to find its size; other formats may tell it at their end."""


def scenes_of(path: Path, is_one: Callable[[Path], bool]) -> list[str]:
    """Names of the scenes in a folder, by number where they are numbers; "." where it is one itself."""
    if not path.is_dir():
        return []
    if is_one(path):
        return ["."]
    return sorted((p.name for p in path.iterdir() if p.is_dir() and is_one(p)), key=natural_key)


def rigid(matrix: object, path: Path, what: str) -> Float64:
    """A checked (4, 4) rigid transform from 12 or 16 numbers or a matrix; rotations off by rounding are made exact.

    Args:
        path, what: of the transform, for messages.
    Raises:
        DriveError: not so many numbers, NaN, or no rotation.
    """
    try:
        values = np.asarray(matrix, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        values = np.zeros(0)
    if values.size not in (12, 16):
        raise DriveError(f"Not a 4x4 or 3x4 matrix: {what}", path=path)
    found = np.eye(4)
    found[: values.size // 4] = values.reshape(-1, 4)
    if not np.isfinite(found).all():
        raise DriveError(f"{what} holds NaN or infinity", path=path, mend="download it again or drop the frame")
    rotation, error = nearest_rotation(found[:3, :3])
    if error > ROTATION_TOLERANCE:
        raise DriveError(f"Not a rotation: {what} (off by {error:.3g})", path=path)
    found[:3, :3] = rotation
    found[3] = (0, 0, 0, 1)
    return found


def pose_of(quat: Sequence[float] | Float64, position: Sequence[float] | Float64, path: Path, what: str) -> Float64:
    """(4, 4) transform of a quaternion wxyz and a position (3,).

    Raises:
        DriveError: numbers that make none.
    """
    q, t = np.asarray(quat, dtype=np.float64), np.asarray(position, dtype=np.float64)
    if q.shape != (4,) or t.shape != (3,) or not np.isfinite([*q, *t]).all() or not 1e-9 < np.linalg.norm(q) < 1e9:
        raise DriveError(
            f"Not a quaternion and position: {what}", path=path, mend="download it again or drop the frame"
        )
    pose = np.eye(4)
    pose[:3, :3] = quat_to_rotation(q)
    pose[:3, 3] = t
    return pose


def calibrated_camera(
    size: tuple[int, int], focal: tuple[float, float], centre: tuple[float, float], pose: Float64, path: Path
) -> Camera:
    """A camera of a dataset's calibration.

    Args:
        size: width and height, pixels; focal: fx and fy, pixels.
        centre: principal point as OpenCV counts it, from the centre of the first pixel.
        pose: (4, 4) from the camera (x right, y down, z forward) to the drive's coordinates.
        path: of the calibration, for messages.
    Raises:
        DriveError: numbers that make no camera.
    """
    numbers = (*focal, *centre)
    if not np.isfinite(numbers).all() or min(focal) <= 0 or min(size) < 1:
        raise DriveError("has camera numbers that make no camera", path=path, mend="restore the calibration")
    width, height = size
    (fx, fy), (cx, cy) = focal, centre
    return Camera(width, height, fx, fy, cx + 0.5, cy + 0.5, rigid_inverse(pose))


def picture_size(path: Path, content: Callable[[], bytes] | None = None) -> tuple[int, int]:
    """Width and height of a picture, from its header.

    Args:
        path: of the picture; content: reads it where the path names a file that holds many.
    Raises:
        DriveError: missing, empty or of a format that is not read.
    """
    if content is not None:
        return size_of_image(content(), path)
    try:
        if path.suffix.lower() in PLATES and kind_of(path) is not None:
            return plate_facts(path).size
        with open_file(path, LARGEST_FILE) as stream:
            data = stream.read(HEADER_BYTES)
            if format_of(data) != "PNG":
                data += stream.read()
    except OSError as error:
        raise DriveError("Not found, or not readable", path=path, mend="restore it or drop the frame") from error
    return size_of_image(data, path)


def read_numbers(path: Path, mend: str) -> list[list[float]]:
    """The numbers of a text file, line by line; empty lines are left out.

    Raises:
        DriveError: missing, or a line that is not numbers.
    """
    lines = read_text(path, mend).splitlines()
    try:
        return [[float(word) for word in line.split()] for line in lines if line.strip()]
    except ValueError as error:
        raise DriveError(f"Not numbers in a line: {error}", path=path, mend=mend) from error


class TrackIds:
    """Numbers 1, 2, … for the tracks of a dataset, which names them by strings; in the order in which they are asked for."""

    def __init__(self) -> None:
        self._numbers: dict[str, int] = {}

    def of(self, name: str) -> int:
        """The number of a track."""
        return self._numbers.setdefault(name, len(self._numbers) + 1)
