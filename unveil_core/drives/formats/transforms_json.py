"""Drives as nerfstudio / Instant-NGP ``transforms.json``, with Unveil's additions (all optional).

Poses in the file are camera-to-world with OpenGL axes, unless the user says otherwise; they are turned to OpenCV here and nowhere
else. Principal points count from
the outer edge of the first pixel, as nerfstudio's rays do (pixel centres at + 0.5).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.named_paths import named_path
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import read_boxes
from unveil_core.drives.checks.conventions import OPENGL, pose_in
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep
from unveil_core.drives.formats.cameras import ROTATION_TOLERANCE
from unveil_core.drives.formats.nerfstudio.depth import assumed_unit, coarse_points, depth_sweeps
from unveil_core.drives.formats.nerfstudio.keys import Keys
from unveil_core.drives.formats.nerfstudio.lens import crop_notice, degrees_notice, read_lens
from unveil_core.drives.formats.nerfstudio.points import read_named_points
from unveil_core.drives.formats.nerfstudio.rig import camera_names, frame_names
from unveil_core.drives.formats.nerfstudio.transposed import turned_upright
from unveil_core.geometry.transforms import nearest_rotation

__all__ = ["pose_from_matrix", "read_transforms_json"]


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
        raise DriveError(f"the pose of frame {frame} is not a 4x4 matrix", path=path)
    if not np.isfinite(pose).all():
        raise DriveError(
            f"the pose of frame {frame} holds NaN or infinity", path=path, mend="drop the frame or redo its pose"
        )
    rotation, error = nearest_rotation(pose[:3, :3])
    if error > ROTATION_TOLERANCE:
        raise DriveError(
            f"the pose of frame {frame} is no rotation (off by {error:.3g})",
            path=path,
            mend="poses are rigid: no scale, no mirror, no shear",
        )
    pose = pose.copy()
    pose[:3, :3] = rotation
    return pose


def _image_path(source: Path, name: object) -> Path:
    """The file that ``file_path`` of a transforms.json means; Instant-NGP leaves the suffix out."""
    path = named_path(source.parent, name, source, "file_path")
    if not path.name:
        raise DriveError(f"file_path names no file: {str(name)[:40]!r}", path=source, mend="correct it")
    if not path.suffix or not path.exists():
        for suffix in (".png", ".jpg", ".jpeg", ".PNG", ".JPG"):
            if (candidate := path.with_name(path.name + suffix)).exists():
                return candidate
    return path


def _is_scale(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < math.inf


def _scale_told(keys: Keys, frames: Sequence[Frame], points: PointCloud) -> tuple[float | None, str]:
    """Units per metre and what tells them, see :func:`read_transforms_json`."""
    if keys.get("metric"):
        return 1.0, "metric"
    if keys.get("metric") is not None:
        return None, ""
    scale = keys.number("applied_scale")
    if scale is not None:
        return scale, "applied_scale"
    if keys.get("depth_unit_scale_factor") is not None and any(f.depth_path is not None for f in frames):
        return 1.0, "depth unit"
    return (1.0, "measured points") if points.measured else (None, "")


def _up_told(keys: Keys) -> Float64 | None:
    if keys.get("up") is None:
        return None
    try:
        up = np.asarray(keys.get("up"), dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        up = np.zeros(0)
    if up.shape != (3,) or not np.isfinite(up).all() or not up.any():
        raise DriveError("up is no direction", path=keys.path, mend="three numbers, as [0, 0, 1]")
    up = up / np.abs(up).max()  # squares of the largest and smallest numbers are none
    return np.asarray(up / np.linalg.norm(up))


def _frames(top: dict[str, Any], path: Path, convention: str) -> list[Frame]:
    """The frames in the order of the file, with poses in a convention."""
    entries = top["frames"]
    for i, entry in enumerate(entries):
        if not isinstance(entry, dict) or not entry.get("file_path"):
            raise DriveError(f"frame {i} has no file_path", path=path)
    images = [_image_path(path, entry["file_path"]) for entry in entries]
    cameras = camera_names(entries)
    names = frame_names(entries, cameras, [image.stem for image in images])
    frames = []
    for entry, image, camera_name, name in zip(entries, images, cameras, names, strict=True):
        keys = Keys(entry, top, path, name)
        pose = pose_from_matrix(entry.get("transform_matrix"), path, name)
        camera, distortion = read_lens(keys, image, pose_in(pose, convention))
        time = keys.number("timestamp") if entry.get("timestamp") is not None else keys.number("time")
        frames.append(
            Frame(
                name=name,
                camera_name=camera_name,
                camera=camera,
                image_path=image,
                distortion=distortion,
                semantic_path=keys.file("semantic_path"),
                instance_path=keys.file("instance_path"),
                mask_path=keys.file("mask_path"),
                depth_path=keys.file("depth_file_path"),
                timestamp=time,
                boxes=read_boxes(entry.get("boxes"), path, name),
            )
        )
    return frames


def _depth_unit(keys: Keys, frames: Sequence[Frame], notices: list[str]) -> float:
    """Units of the drive a step of the depth images."""
    first = next(f.depth_path for f in frames if f.depth_path is not None and f.depth_path.is_file())
    unit = keys.number("depth_unit_scale_factor")
    if unit is None:
        unit = assumed_unit(first)
        notices.append(f"depth images are taken to count {unit:g} m; depth_unit_scale_factor decides")
    if unit <= 0:
        raise DriveError(f"depth_unit_scale_factor {unit:g} is not positive", path=keys.path, mend="0.001 is usual")
    return unit * (keys.number("applied_scale") or 1.0)


def read_transforms_json(path: Path, pose_convention: str | None = None) -> Drive:
    """Read a drive.

    Scale: ``metric`` decides, where it is given: true, coordinates are metres; false, the scale is unknown. Without it the scale
    is known where the file has ``applied_scale``, which brings what was measured in metres to the poses; where it states the unit
    of its depth images by ``depth_unit_scale_factor``, which brings them to metres and to the poses alike; and where its PLY has
    properties that only laser scanners write, as intensity. ``place_drive`` believes these three only where the cameras are then
    at a height that cameras have. Nothing else tells: depth images alone may be of any unit, and structure from motion has none.

    Up: ``up`` as Instant-NGP writes it, a direction; else it is unknown here.

    Points: of the PLY that the file names; else of its depth images, as sweeps; else of a COLMAP model beside it.

    Args:
        path: the JSON file, or the folder that holds it.
        pose_convention: one of ``base.drive_options.POSE_CONVENTIONS``; None = "opengl".
    Raises:
        DriveError: with the file and the mend.
    """
    path = path / "transforms.json" if path.is_dir() else path
    top: Any = read_json(path)
    if not isinstance(top, dict) or not isinstance(top.get("frames"), list) or not top["frames"]:
        raise DriveError("has no frames", path=path, mend="a drive needs at least one frame")
    keys = Keys({}, top, path)
    if "applied_scale" in top and not _is_scale(top["applied_scale"]):
        raise DriveError(f"applied_scale is no scale: {str(top['applied_scale'])[:40]!r}", path=path, mend="correct it")
    pose_convention = pose_convention or OPENGL
    upright, turned = turned_upright(top["frames"])
    frames = _frames({**top, "frames": upright}, path, pose_convention)
    notices: list[str] = [] if turned is None else [turned]
    cropped = crop_notice(keys.number("fisheye_crop_radius"), [(f.camera, f.distortion) for f in frames])
    notices += [] if cropped is None else [cropped]
    angles = [e.get(k) for e in (top, *top["frames"]) for k in ("camera_angle_x", "camera_angle_y")]
    degrees = degrees_notice(angles)
    notices += [] if degrees is None or keys.get("fl_x") is not None else [degrees]
    points = PointCloud(np.zeros((0, 3)))
    sources: tuple[Path, ...] = (path,)
    sweeps: tuple[Sweep, ...] = ()
    with_depth = [f.depth_path for f in frames if f.depth_path is not None]
    missing = [p for p in with_depth if not p.is_file()]
    if keys.get("ply_file_path") or len(missing) == len(with_depth):
        named = read_named_points(keys, [f.camera for f in frames])
        if named is None:
            raise DriveError(
                "names no points",
                path=path,
                mend="set ply_file_path to a PLY of LiDAR or SfM points, or give depth images",
            )
        points, sources = named.cloud, (path, *named.sources)
        notices += [] if named.notice is None else [named.notice]
    else:
        sweeps = depth_sweeps(frames, _depth_unit(keys, frames, notices))
        if missing:
            notices.append(f"{len(missing)} of {len(with_depth)} depth images are not there, the first {missing[0]}")
    units_per_metre, scale_source = _scale_told(keys, frames, points)
    up = _up_told(keys)
    if sweeps and (up is None or scale_source != "metric"):
        points = coarse_points(sweeps)
    truth = path.parent / "truth"
    return Drive(
        root=path,
        frames=tuple(frames),
        points=points,
        units_per_metre=units_per_metre,
        scale_source=scale_source,
        up=up,
        semantic_classes=keys.get("semantic_classes"),
        truth_root=truth if truth.is_dir() else None,
        sources=sources,
        sweeps=sweeps,
        notices=tuple(notices),
        pose_convention=pose_convention,
    )
