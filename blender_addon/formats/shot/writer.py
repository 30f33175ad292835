# SPDX-License-Identifier: GPL-3.0-or-later
"""A shot as a drive on disk: ``transforms.json`` that names the plates where they lie, and ``points.ply``. No bpy here."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..files import write_whole
from ..writing.new_files import GENERATOR, NewFiles
from .lens import PLAIN
from .place import CAMERAS, POINTS

__all__ = ["Shot", "ShotFrame", "write_shot"]

DISTORTION = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


@dataclass(frozen=True, eq=False)
class ShotFrame:
    """Attributes:
    number: frame of the timeline.
    picture: file of the plate.
    camera_to_world: (4, 4) float64 of Blender's camera, metres.
    focal, centre: pixels, x and y; the centre from the corner of the picture, y down.
    """

    number: int
    picture: Path
    camera_to_world: np.ndarray
    focal: tuple[float, float]
    centre: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Shot:
    """Attributes:
    camera: its name.
    size: of the plates, pixels.
    rate: frames a second.
    frames: at least one.
    distortion: of OpenCV, k1 k2 p1 p2 k3 k4 k5 k6.
    points: (P, 3) float64 metres; may be empty.
    """

    camera: str
    size: tuple[int, int]
    rate: float
    frames: tuple[ShotFrame, ...]
    distortion: tuple[float, ...] = PLAIN
    points: np.ndarray | None = None


def write_shot(files: NewFiles, shot: Shot) -> Path:
    """Write the drive.

    Args:
        files: of its folder, see :func:`shot_folder`.
    Returns:
        its transforms.json, which is there once all files have their names.
    Raises:
        OSError: a file cannot be written.
    """
    top: dict[str, object] = {
        "generator": GENERATOR,
        "metric": True,
        "up": [0, 0, 1],
        "keep_origin": True,
        "camera_model": "OPENCV",
        "w": shot.size[0],
        "h": shot.size[1],
        **{name: value for name, value in zip(DISTORTION, shot.distortion, strict=True) if value},
    }
    if shot.points is not None and len(shot.points):
        write_whole(files.path(POINTS), _ply(shot.points))
        top["ply_file_path"] = POINTS
    first = shot.frames[0].number
    top["frames"] = [
        {
            "file_path": _named(frame.picture, files.folder),
            "transform_matrix": frame.camera_to_world.tolist(),
            "camera": shot.camera,
            "timestamp": (frame.number - first) / shot.rate,
            "fl_x": frame.focal[0],
            "fl_y": frame.focal[1],
            "cx": frame.centre[0],
            "cy": frame.centre[1],
        }
        for frame in shot.frames
    ]
    write_whole(files.path(CAMERAS), (json.dumps(top, indent=1, allow_nan=False) + "\n").encode())
    return files.folder / CAMERAS


def _named(file: Path, folder: Path) -> str:
    """The path of a file as seen from a folder; as it is where they lie on two disks of Windows."""
    try:
        return Path(os.path.relpath(file, folder)).as_posix()
    except ValueError:
        return file.as_posix()


def _ply(points: np.ndarray) -> bytes:
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    lines += [f"property double {axis}" for axis in "xyz"] + ["end_header", ""]
    return "\n".join(lines).encode() + np.ascontiguousarray(points, "<f8").tobytes()
