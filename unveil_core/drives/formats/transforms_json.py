"""Drives as nerfstudio / Instant-NGP ``transforms.json``, with Unveil's additions (all optional).

Poses in the file are camera-to-world with OpenGL axes; they are turned to OpenCV here and nowhere else. Principal points count from
the outer edge of the first pixel, as nerfstudio's rays do (pixel centres at + 0.5).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import read_boxes
from unveil_core.drives.drive import Distortion, Drive, Frame, PointCloud
from unveil_core.drives.points import read_points
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.transforms import nearest_rotation, opengl_to_opencv

__all__ = ["pose_from_matrix", "read_transforms_json"]

_MODELS = {
    "PINHOLE": None,
    "SIMPLE_PINHOLE": None,
    "OPENCV": "OPENCV",
    "SIMPLE_RADIAL": "OPENCV",
    "RADIAL": "OPENCV",
    "OPENCV_FISHEYE": "OPENCV_FISHEYE",
}
ROTATION_TOLERANCE = 1e-3


def pose_from_matrix(matrix: object, path: Path, frame: str) -> NDArray[np.float64]:
    """A checked (4, 4) rigid camera-to-world transform; rotations off by rounding are made exact.

    Raises:
        DriveError: not 4x4 numbers, NaN, or not a rotation.
    """
    try:
        pose = np.asarray(matrix, dtype=np.float64)
    except (TypeError, ValueError):
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


def _number(entry: dict[str, Any], top: dict[str, Any], *names: str) -> float | None:
    for name in names:
        value = entry.get(name, top.get(name))
        if value is not None:
            return float(value)
    return None


def _image_path(root: Path, name: str) -> Path:
    """The file that ``file_path`` means; Instant-NGP leaves the suffix out."""
    path = root / name
    if not path.suffix or not path.exists():
        for suffix in (".png", ".jpg", ".jpeg", ".PNG", ".JPG"):
            if (candidate := path.with_name(path.name + suffix)).exists():
                return candidate
    return path


def _camera(
    entry: dict[str, Any], top: dict[str, Any], image: Path, pose: NDArray[np.float64]
) -> tuple[Camera, Distortion | None]:
    size = [_number(entry, top, n) for n in ("w", "h")]
    if size[0] is None or size[1] is None:
        picture = cv2.imread(str(image), cv2.IMREAD_REDUCED_GRAYSCALE_8) if image.exists() else None
        full = cv2.imread(str(image), cv2.IMREAD_GRAYSCALE) if picture is not None else None
        if full is None:
            raise DriveError("there is no such readable image", path=image, mend="restore it or drop the frame")
        size = [float(full.shape[1]), float(full.shape[0])]
    width, height = int(size[0] or 0), int(size[1] or 0)
    fx = _number(entry, top, "fl_x")
    if fx is None:
        angle = _number(entry, top, "camera_angle_x")
        if angle is None:
            raise DriveError(
                "has neither fl_x nor camera_angle_x", path=image, mend="add the focal length to transforms.json"
            )
        fx = width / (2 * math.tan(angle / 2))
    fy = _number(entry, top, "fl_y") or fx
    cx, cy = _number(entry, top, "cx"), _number(entry, top, "cy")
    cx, cy = width / 2 if cx is None else cx, height / 2 if cy is None else cy
    if not all(math.isfinite(v) for v in (fx, fy, cx, cy)) or fx <= 0 or fy <= 0 or width < 1 or height < 1:
        raise DriveError("has camera numbers that make no camera", path=image, mend="check w, h, fl_x, fl_y, cx, cy")
    k = {n: _number(entry, top, n) or 0.0 for n in ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2")}
    model = str(entry.get("camera_model", top.get("camera_model", "OPENCV")))
    if model not in _MODELS:
        raise DriveError(f"camera_model {model} is not known", path=image, mend=f"use one of {', '.join(_MODELS)}")
    distortion = None
    if _MODELS[model] == "OPENCV_FISHEYE":
        distortion = Distortion("OPENCV_FISHEYE", (k["k1"], k["k2"], k["k3"], k["k4"]))
    elif _MODELS[model] == "OPENCV":
        order = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
        distortion = Distortion("OPENCV", tuple(k[n] for n in order))
        distortion = None if distortion.is_zero else distortion
    world_to_camera = np.eye(4)
    c2w = opengl_to_opencv(pose)
    world_to_camera[:3, :3] = c2w[:3, :3].T
    world_to_camera[:3, 3] = -c2w[:3, :3].T @ c2w[:3, 3]
    return Camera(width, height, fx, fy, cx, cy, world_to_camera), distortion


def _scale_told(top: dict[str, Any], frames: Sequence[Frame], points: PointCloud) -> tuple[float | None, str]:
    """Units per metre and what tells them, see :func:`read_transforms_json`."""
    if top.get("metric"):
        return 1.0, "metric"
    if "metric" in top:
        return None, ""
    if "applied_scale" in top:
        scale = float(top["applied_scale"])
        if not 0 < scale < math.inf:
            raise ValueError(f"{scale:g} is not positive and finite")
        return scale, "applied_scale"
    if top.get("depth_unit_scale_factor") is not None and any(f.depth_path is not None for f in frames):
        return 1.0, "depth unit"
    return (1.0, "measured points") if points.measured else (None, "")


def _up_told(top: dict[str, Any], path: Path) -> Float64 | None:
    if top.get("up") is None:
        return None
    try:
        up = np.asarray(top["up"], dtype=np.float64)
    except (TypeError, ValueError):
        up = np.zeros(0)
    if up.shape != (3,) or not np.isfinite(up).all() or not up.any():
        raise DriveError("up is no direction", path=path, mend="three numbers, as [0, 0, 1]")
    return np.asarray(up / np.linalg.norm(up))


def read_transforms_json(path: Path) -> Drive:
    """Read a drive.

    Scale: ``metric`` decides, where it is given: true, coordinates are metres; false, the scale is unknown. Without it the scale
    is known where the file has ``applied_scale``, which brings what was measured in metres to the poses; where it states the unit
    of its depth images by ``depth_unit_scale_factor``, which brings them to metres and to the poses alike; and where its PLY has
    properties that only laser scanners write, as intensity. ``place_drive`` believes these three only where the cameras are then
    at a height that cameras have. Nothing else tells: depth images alone may be of any unit, and structure from motion has none.

    Up: ``up`` as Instant-NGP writes it, a direction; else it is unknown here.

    Args:
        path: the JSON file, or the folder that holds it.
    Raises:
        DriveError: with the file and the mend.
    """
    path = path / "transforms.json" if path.is_dir() else path
    root = path.parent
    top: Any = read_json(path)
    entries = top.get("frames") if isinstance(top, dict) else None
    if not entries:
        raise DriveError("has no frames", path=path, mend="a drive needs at least one frame")
    frames = []
    for i, entry in enumerate(entries):
        if not isinstance(entry, dict) or "file_path" not in entry:
            raise DriveError(f"frame {i} has no file_path", path=path)
        image = _image_path(root, str(entry["file_path"]))
        pose = pose_from_matrix(entry.get("transform_matrix"), path, image.stem)
        camera, distortion = _camera(entry, top, image, pose)

        def file(name: str, entry: dict[str, Any] = entry) -> Path | None:
            return root / str(entry[name]) if entry.get(name) else None

        frames.append(
            Frame(
                name=image.stem,
                camera_name=str(entry.get("camera", "camera")),
                camera=camera,
                image_path=image,
                distortion=distortion,
                semantic_path=file("semantic_path"),
                instance_path=file("instance_path"),
                mask_path=file("mask_path"),
                depth_path=file("depth_file_path"),
                timestamp=float(entry["timestamp"]) if entry.get("timestamp") is not None else None,
                boxes=read_boxes(entry.get("boxes"), path, image.stem),
            )
        )
    if not top.get("ply_file_path"):
        raise DriveError("names no points", path=path, mend="set ply_file_path to a PLY of LiDAR or SfM points")
    points = read_points(root / str(top["ply_file_path"]))
    if "applied_transform" in top:
        # nerfstudio turns the poses by this and leaves the points as they were.
        applied = np.asarray(top["applied_transform"], dtype=np.float64)[:3, :4]
        scale = float(top.get("applied_scale", 1.0))
        moved = scale * (points.positions @ applied[:, :3].T + applied[:, 3])
        points = replace(points, positions=moved)
    truth = root / "truth"
    try:
        units_per_metre, scale_source = _scale_told(top, frames, points)
    except (TypeError, ValueError) as error:
        raise DriveError(f"applied_scale is no scale: {error}", path=path) from error
    return Drive(
        root=path,
        frames=tuple(frames),
        points=points,
        units_per_metre=units_per_metre,
        scale_source=scale_source,
        up=_up_told(top, path),
        semantic_classes=top.get("semantic_classes"),
        truth_root=truth if truth.is_dir() else None,
        sources=(path, root / str(top["ply_file_path"])),
    )
