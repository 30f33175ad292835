"""A COLMAP text model with its pictures, as COLMAP's documentation describes it (*Output Format*): pixel centres at + 0.5, poses
world-to-camera with OpenCV axes, in the drive's own coordinates less a shift.

Points have no tracks and no error: they were measured, not triangulated. What trains on such models computes in single precision,
drops the folders of pictures, and takes the points from a PLY beside the model where there is one.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.ply.writing import write_vertices
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Distortion
from unveil_core.exports.cameras.footage import DeliveredCamera, delivered_cameras, put_frames, without_lens
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
    """``sparse/0/cameras.txt``, ``images.txt``, ``points3D.txt`` and ``points3D.ply``, and all pictures in ``images/``."""
    frame = drive_coordinates(job.drive)
    cameras = delivered_cameras(job, frame)
    if job.undistorted:
        cameras = without_lens(cameras)
    put_frames(job, folder / "images", cameras)
    model = folder / "sparse/0"
    model.mkdir(parents=True)
    # A rig's cameras stay apart, even where their numbers are the same.
    known: dict[tuple[str, str], int] = {}
    images, told = [], {}
    for number, c in enumerate(cameras, start=1):
        camera_id = known.setdefault((c.frame.camera_name, _camera_line(c)), len(known) + 1)
        pose = c.camera.world_to_camera
        numbers = [*rotation_to_quat(pose[:3, :3]).tolist(), *pose[:3, 3].tolist()]
        images.append(f"{number} {' '.join(map(repr, numbers))} {camera_id} {c.image}\n\n")
        told[c.image] = {"camera": c.frame.camera_name, "source": c.frame.name, "timestamp": c.frame.timestamp}
    shift = f"# Coordinates of the drive: these + {' '.join(map(repr, frame.shift.tolist()))}"
    _write(
        model / "cameras.txt",
        "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]",
        [f"{number} {line}\n" for (_, line), number in known.items()],
    )
    _write(model / "images.txt", f"# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then POINTS2D[]\n{shift}", images)
    cloud = street_points(job).cloud
    places = frame.shifted.to_world(cloud.positions)
    colors = np.full((len(places), 3), GREY, np.uint8) if cloud.colors is None else cloud.colors
    _write(model / "points3D.txt", f"# POINT3D_ID X Y Z R G B ERROR TRACK[]\n{shift}", _point_lines(places, colors))
    _write_ply(model / "points3D.ply", places, colors)
    told_all: dict[str, Any] = {"coordinates": frame.to_json(), "undistorted": job.undistorted}
    told_all |= {"colorspace": job.colorspace, "images": told}
    tell(folder, "colmap", told_all)


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


def _point_lines(places: Float64, colors: NDArray[np.uint8]) -> Iterable[str]:
    for number, (place, color) in enumerate(zip(places.tolist(), colors.tolist(), strict=True), start=1):
        yield f"{number} {' '.join(map(repr, place))} {' '.join(map(str, color))} 0\n"


def _write_ply(path: Path, places: Float64, colors: NDArray[np.uint8]) -> None:
    """The points as 3D Gaussian Splatting starts from them: it would make this file of the text, in the square of its length."""
    names = [(n, "<f4") for n in ("x", "y", "z", "nx", "ny", "nz")]
    table = np.zeros(len(places), [*names, *((n, "u1") for n in ("red", "green", "blue"))])
    for k, (axis, channel) in enumerate(zip("xyz", ("red", "green", "blue"), strict=True)):
        table[axis], table[channel] = places[:, k], colors[:, k]
    write_vertices(path, table)


def _write(path: Path, head: str, lines: Iterable[str]) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(head + "\n")
        stream.writelines(lines)
