"""nerfstudio's ``transforms.json`` with the clean frames and the points of the empty street: a drive that Unveil imports, too.

Poses are camera-to-world with OpenGL axes, in the drive's own coordinates as doubles; lenses as nerfstudio names them. ``up`` is
Instant-NGP's key; ``camera`` and ``timestamp`` are Unveil's additions, which other programs ignore.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from unveil_core.base.files import write_json_atomic
from unveil_core.drives.drive import Distortion, PointCloud
from unveil_core.drives.points import write_points
from unveil_core.exports.cameras.footage import DeliveredCamera, copy_frames, delivered_cameras
from unveil_core.exports.coordinates import drive_coordinates
from unveil_core.exports.job import Job
from unveil_core.exports.mapping.cloud import street_points
from unveil_core.exports.whole import tell
from unveil_core.geometry.lens import FISHEYE

__all__ = ["write_nerfstudio"]


def write_nerfstudio(job: Job, folder: Path) -> None:
    """``transforms.json``, ``images/<camera>/<frame>.png`` and ``points.ply``."""
    drive, frame = job.drive, drive_coordinates(job.drive)
    cameras = delivered_cameras(job, frame, shifted=False)
    copy_frames(job, folder / "images", [c.image for c in cameras])
    points = street_points(job).cloud
    world = drive.to_world.to_world(points.positions)
    write_points(PointCloud(world, points.colors, classes=points.classes), folder / "points.ply")
    scale: dict[str, Any] = {"metric": True}
    if drive.scale_source != "metric" or drive.to_world.scale != 1:
        scale = {"applied_scale": drive.to_world.scale}
    document = {
        **scale,
        "up": drive.to_world.up.tolist(),
        "ply_file_path": "points.ply",
        "frames": [_entry(camera) for camera in cameras],
    }
    write_json_atomic(folder / "transforms.json", document)
    tell(folder, "nerfstudio", {"coordinates": frame.to_json(shifted=False)})


def _entry(c: DeliveredCamera) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "file_path": f"images/{c.image}",
        "camera": c.frame.camera_name,
        **_lens(c.distortion),
        "w": c.camera.width,
        "h": c.camera.height,
        "fl_x": c.camera.fx,
        "fl_y": c.camera.fy,
        "cx": c.camera.cx,
        "cy": c.camera.cy,
        "transform_matrix": c.opengl_pose.tolist(),
    }
    if c.frame.timestamp is not None:
        entry["timestamp"] = c.frame.timestamp
    return entry


def _lens(lens: Distortion | None) -> dict[str, Any]:
    """Model and coefficients. nerfstudio reads PINHOLE, OPENCV and OPENCV_FISHEYE; the rational lens is COLMAP's FULL_OPENCV."""
    if lens is None:
        return {"camera_model": "PINHOLE"}
    if lens.model == FISHEYE:
        return {"camera_model": FISHEYE, **dict(zip(("k1", "k2", "k3", "k4"), lens.coefficients, strict=True))}
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    given = (*lens.coefficients, *[0.0] * (8 - len(lens.coefficients)))
    model = "FULL_OPENCV" if any(given[5:]) else "OPENCV"
    return {"camera_model": model, **dict(zip(names, given, strict=True))}
