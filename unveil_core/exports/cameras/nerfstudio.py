"""nerfstudio's ``transforms.json`` with the clean frames and the points of the empty street: a drive that Unveil imports, too.

Poses are camera-to-world with OpenGL axes, in the drive's own coordinates less a shift, for it computes in single precision;
lenses as nerfstudio names them. It knows one model for all frames, at the top of the file: where cameras would need several, or one
that it does not know, the pictures of these are undistorted. ``up`` is Instant-NGP's key; ``shift``, ``camera`` and ``timestamp``
are Unveil's additions, which other programs ignore.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from unveil_core.base.files import write_json_atomic
from unveil_core.drives.drive import Distortion, PointCloud
from unveil_core.drives.points import write_points
from unveil_core.exports.cameras.footage import DeliveredCamera, delivered_cameras, put_frames, without_lens
from unveil_core.exports.coordinates import drive_coordinates
from unveil_core.exports.job import Job
from unveil_core.exports.mapping.cloud import street_points
from unveil_core.exports.whole import tell
from unveil_core.geometry.lens import FISHEYE

__all__ = ["write_nerfstudio"]


def write_nerfstudio(job: Job, folder: Path) -> None:
    """``transforms.json``, all pictures in ``images/``, and ``points.ply``."""
    drive, frame = job.drive, drive_coordinates(job.drive)
    cameras, flattened = _readable(delivered_cameras(job, frame), all_flat=job.undistorted)
    if flattened and not job.undistorted:
        job.notice(f"nerfstudio: pictures of {', '.join(flattened)} are undistorted, for it does not know their lens")
    put_frames(job, folder / "images", cameras)
    points = street_points(job).cloud
    places = frame.shifted.to_world(points.positions)
    write_points(PointCloud(places, points.colors, classes=points.classes), folder / "points.ply")
    scale: dict[str, Any] = {"metric": True}
    if drive.scale_source != "metric" or drive.to_world.scale != 1:
        scale = {"applied_scale": drive.to_world.scale}
    lenses = [_lens(c) for c in cameras]
    shared = lenses[0] if all(lens == lenses[0] for lens in lenses) else {}
    document = {
        "camera_model": _model(cameras),
        **shared,
        **scale,
        "up": drive.to_world.up.tolist(),
        "shift": frame.shift.tolist(),
        "ply_file_path": "points.ply",
        "frames": [_entry(c, {} if shared else lens) for c, lens in zip(cameras, lenses, strict=True)],
    }
    write_json_atomic(folder / "transforms.json", document)
    tell(folder, "nerfstudio", {"coordinates": frame.to_json(), "undistorted": flattened, "colorspace": job.colorspace})


def _readable(cameras: Sequence[DeliveredCamera], *, all_flat: bool) -> tuple[list[DeliveredCamera], list[str]]:
    """The cameras with lenses that one model at the top of the file can say, and the names of those that lost theirs.

    Args:
        all_flat: whether all are to lose it.
    """
    only_fisheyes = all(c.distortion is not None and c.distortion.model == FISHEYE for c in cameras)
    found, names = [], []
    for c in cameras:
        lens = c.distortion
        unknown = lens is not None and (any(lens.coefficients[5:]) or (lens.model == FISHEYE and not only_fisheyes))
        if all_flat or unknown:
            (c,) = without_lens([c])
            names.append(c.frame.camera_name)
        found.append(c)
    return found, list(dict.fromkeys(names))


def _model(cameras: Sequence[DeliveredCamera]) -> str:
    """Of all cameras: a pinhole among others has coefficients of zero."""
    lenses = [c.distortion for c in cameras if c.distortion is not None]
    return lenses[0].model if lenses else "PINHOLE"


def _lens(c: DeliveredCamera) -> dict[str, Any]:
    """Size, focal lengths, principal point and coefficients."""
    camera = c.camera
    numbers = {
        "w": camera.width,
        "h": camera.height,
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
    }
    return {**numbers, **_coefficients(c.distortion)}


def _coefficients(lens: Distortion | None) -> dict[str, float]:
    if lens is None:
        return {}
    names = ("k1", "k2", "k3", "k4") if lens.model == FISHEYE else ("k1", "k2", "p1", "p2", "k3")
    return dict(zip(names, lens.coefficients, strict=False))


def _entry(c: DeliveredCamera, lens: dict[str, Any]) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "file_path": f"images/{c.image}",
        "camera": c.frame.camera_name,
        **lens,
        "transform_matrix": c.opengl_pose.tolist(),
    }
    if c.frame.timestamp is not None:
        entry["timestamp"] = c.frame.timestamp
    return entry
