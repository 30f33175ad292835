"""Nuke's ``.chan``: a line a frame, ``frame tx ty tz rx ry rz fov``, as Nuke's *Import chan file* reads it with its usual settings.

Axes are Nuke's: y up, the camera looks along -z. Rotations are degrees of the order ZXY (z is applied first), continuous
from frame to frame. The field of view is vertical, degrees, of the undistorted footage. Coordinates are those of the frame "y up",
in the drive's units, less a shift that ``export.json`` tells, with each camera's size, principal point and lens, and the time stamp
and source of each frame: the text has no place for these.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.types import Float64
from unveil_core.drives.drive import tracks
from unveil_core.exports.cameras.footage import DeliveredCamera, delivered_cameras
from unveil_core.exports.coordinates import y_up
from unveil_core.exports.job import Job
from unveil_core.exports.whole import tell

__all__ = ["nuke_angles", "write_chan"]


def write_chan(job: Job, folder: Path) -> None:
    """``<camera>.chan`` for each camera, and ``export.json``."""
    frame = y_up(job.drive)
    cameras = delivered_cameras(job, frame)
    told: dict[str, Any] = {}
    for track in tracks(job.drive):
        own = [cameras[i] for i in track]
        name = own[0].frame.camera_name
        poses = np.stack([c.opengl_pose for c in own])
        angles = np.degrees(np.unwrap(nuke_angles(poses[:, :3, :3]), axis=0))
        lines = []
        for i, c in enumerate(own):
            fov = 2 * math.degrees(math.atan(c.camera.height / (2 * c.camera.fy)))
            numbers = (*poses[i, :3, 3], *angles[i], fov)
            lines.append(f"{job.start_frame + i} {' '.join(f'{v:.9f}' for v in numbers)}\n")
        (folder / f"{name}.chan").write_text("".join(lines), encoding="ascii")
        told[name] = _described(own, job.start_frame)
    tell(
        folder,
        "chan",
        {"coordinates": frame.to_json(), "rotation_order": "ZXY", "field_of_view": "vertical", "cameras": told},
    )


def nuke_angles(rotations: Float64) -> Float64:
    """(N, 3) radians rx ry rz of rotations (N, 3, 3) = Ry Rx Rz."""
    tilt = np.arcsin(np.clip(-rotations[:, 1, 2], -1, 1))
    pan = np.arctan2(rotations[:, 0, 2], rotations[:, 2, 2])
    roll = np.arctan2(rotations[:, 1, 0], rotations[:, 1, 1])
    return np.stack([tilt, pan, roll], axis=1)


def _described(own: list[DeliveredCamera], start: int) -> dict[str, Any]:
    first, lens = own[0].camera, own[0].distortion
    return {
        "width": first.width,
        "height": first.height,
        "focal_px": [first.fx, first.fy],
        "principal_point_px": [first.cx, first.cy],
        "lens": None if lens is None else {"model": lens.model, "coefficients": list(lens.coefficients)},
        "frames": {str(start + i): {"source": c.frame.name, "timestamp": c.frame.timestamp} for i, c in enumerate(own)},
    }
