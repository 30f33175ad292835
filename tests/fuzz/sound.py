"""What must hold of whatever a reader takes as sound."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from tests.fuzz.reader import Wrong
from unveil_core.base.checks.names import is_file_name
from unveil_core.drives.drive import Drive, Frame, PointCloud, SweepPoints
from unveil_core.geometry.camera import Camera

__all__ = ["sound_camera", "sound_drive", "sound_frame", "sound_names", "sound_points"]


def sound_camera(camera: Camera) -> None:
    """A size, a focal length, and a pose of numbers."""
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy)
    if not all(math.isfinite(v) for v in numbers) or min(camera.fx, camera.fy) <= 0:
        raise Wrong("a camera without a focal length or centre is taken")
    if min(camera.width, camera.height) < 1:
        raise Wrong("a camera without pixels is taken")
    pose = camera.world_to_camera
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise Wrong("a pose that is not finite is taken")
    if np.abs(pose[:3, :3] @ pose[:3, :3].T - np.eye(3)).max() > 0.01:
        raise Wrong("a pose that is no rotation is taken")


def sound_points(points: PointCloud | SweepPoints) -> None:
    """Places of numbers, and as many colours and classes."""
    if points.positions.ndim != 2 or points.positions.shape[1] != 3 or not np.isfinite(points.positions).all():
        raise Wrong("points that are not finite are taken")
    for name in ("colors", "classes", "moving"):
        values = getattr(points, name, None)
        if values is not None and len(values) != len(points.positions):
            raise Wrong(f"other {name} than points are taken")


def sound_frame(frame: Frame) -> None:
    """A camera, a lens, a time and boxes of numbers."""
    sound_camera(frame.camera)
    if frame.distortion is not None and not np.isfinite(frame.distortion.coefficients).all():
        raise Wrong("a lens that is not finite is taken")
    if frame.timestamp is not None and not (
        isinstance(frame.timestamp, int | float) and math.isfinite(frame.timestamp)
    ):
        raise Wrong("a time that is no finite number is taken")
    for box in frame.boxes:
        if not np.isfinite([*box.centre, *box.size, box.yaw]).all() or min(box.size) <= 0:
            raise Wrong("a box that is not finite is taken")


def sound_drive(drive: Drive) -> Drive:
    """Frames, points, and the way back to the coordinates of the files."""
    for frame in drive.frames:
        sound_frame(frame)
    sound_points(drive.points)
    if drive.up is not None and not np.isfinite(drive.up).all():
        raise Wrong("an up that is not finite is taken")
    if drive.units_per_metre is not None and not 0 < drive.units_per_metre < math.inf:
        raise Wrong("a scale that is none is taken")
    if not np.isfinite(drive.to_world.matrix).all() or drive.to_world.scale <= 0:
        raise Wrong("a way to the world that is none is taken")
    return drive


def sound_names(drive: Drive, within: Path | None = None) -> None:
    """Names that are names of files, and files that lie ``within`` a folder."""
    for frame in drive.frames:
        if not is_file_name(frame.name) or not is_file_name(frame.camera_name):
            raise Wrong("a name that is no file's is taken")
        inner = (frame.image_path, frame.semantic_path, frame.instance_path, frame.mask_path, frame.ego_path)
        if within is not None and not all(
            p is None or (p.is_relative_to(within) and ".." not in p.parts) for p in inner
        ):
            raise Wrong("a file outside the workspace is taken")
