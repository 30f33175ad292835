"""A COLMAP text model with its pictures, as COLMAP's documentation describes it (*Output Format*): pixel centres at + 0.5, poses
world-to-camera with OpenCV axes, in the drive's own coordinates.

Points have no tracks and no error: they were measured, not triangulated.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from unveil_core.drives.drive import Distortion
from unveil_core.exports.cameras.footage import DeliveredCamera, copy_frames, delivered_cameras
from unveil_core.exports.coordinates import drive_coordinates
from unveil_core.exports.job import Job
from unveil_core.exports.mapping.cloud import street_points
from unveil_core.exports.whole import tell
from unveil_core.geometry.lens import FISHEYE
from unveil_core.geometry.transforms import rotation_to_quat

__all__ = ["write_colmap"]

GREY = 128
"""Of points that have no colour."""


def write_colmap(job: Job, folder: Path) -> None:
    """``sparse/0/cameras.txt``, ``images.txt``, ``points3D.txt``, and ``images/<camera>/<frame>.png``."""
    frame = drive_coordinates(job.drive)
    cameras = delivered_cameras(job, frame, shifted=False)
    copy_frames(job, folder / "images", [c.image for c in cameras])
    model = folder / "sparse/0"
    model.mkdir(parents=True)
    known: dict[str, int] = {}
    images = []
    for number, c in enumerate(cameras, start=1):
        line = _camera_line(c)
        # A rig's cameras stay apart, even where their numbers are the same.
        camera_id = known.setdefault(f"{c.frame.camera_name} {line}", len(known) + 1)
        pose = c.camera.world_to_camera
        numbers = [*rotation_to_quat(pose[:3, :3]).tolist(), *pose[:3, 3].tolist()]
        images.append(f"{number} {' '.join(map(repr, numbers))} {camera_id} {c.image}\n\n")
    lines = [f"{number} {key.split(' ', 1)[1]}\n" for key, number in known.items()]
    _write(model / "cameras.txt", "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]", lines)
    _write(model / "images.txt", "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then POINTS2D[]", images)
    _write(model / "points3D.txt", "# POINT3D_ID X Y Z R G B ERROR TRACK[]", _point_lines(job))
    tell(folder, "colmap", {"coordinates": frame.to_json(shifted=False)})


def _camera_line(c: DeliveredCamera) -> str:
    model, rest = _model(c.distortion)
    numbers = (c.camera.fx, c.camera.fy, c.camera.cx, c.camera.cy, *rest)
    return f"{model} {c.camera.width} {c.camera.height} {' '.join(repr(float(v)) for v in numbers)}"


def _model(lens: Distortion | None) -> tuple[str, tuple[float, ...]]:
    """COLMAP's model, and its parameters after the pinhole's."""
    if lens is None:
        return "PINHOLE", ()
    if lens.model == FISHEYE:
        return FISHEYE, lens.coefficients
    given = (*lens.coefficients, *[0.0] * (8 - len(lens.coefficients)))
    return ("FULL_OPENCV", given) if any(given[4:]) else ("OPENCV", given[:4])


def _point_lines(job: Job) -> Iterator[str]:
    cloud = street_points(job).cloud
    world = job.drive.to_world.to_world(cloud.positions)
    colors = np.full((len(world), 3), GREY) if cloud.colors is None else cloud.colors
    for number, (place, color) in enumerate(zip(world.tolist(), colors.tolist(), strict=True), start=1):
        yield f"{number} {' '.join(map(repr, place))} {' '.join(map(str, color))} 0\n"


def _write(path: Path, head: str, lines: Iterator[str] | list[str]) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(head + "\n")
        stream.writelines(lines)
