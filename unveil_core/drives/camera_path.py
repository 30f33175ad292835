"""Cameras without photographs: views that a user wants to see, from a file or beside a drive's own path.

Three kinds of files are read, distinguished by what is in them: a nerfstudio or Instant-NGP ``transforms.json``; a camera path as
nerfstudio's viewer exports it (``camera_path``, ``camera_to_world`` with OpenGL axes, vertical ``fov`` in degrees; see
``nerfstudio/cameras/camera_paths.py``); and a workspace's own ``drive/cameras.json``. All poses are in the coordinates of the
drive's file. Views are pinhole: a lens distortion that a file names is left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.checks.names import file_name
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Drive
from unveil_core.drives.formats.nerfstudio.keys import Keys
from unveil_core.drives.formats.nerfstudio.poses import pose_from_matrix
from unveil_core.drives.formats.nerfstudio.shift import shift_told
from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.similarity import Similarity
from unveil_core.geometry.transforms import opengl_to_opencv, rigid_inverse

__all__ = ["View", "drive_path", "read_camera_path", "shifted"]

LARGEST_SIDE = 16_384
FARTHEST = 1000.0, 20.0
"""A path with no view within so many metres, or so many lengths of the drive, is in other coordinates."""


@dataclass(frozen=True, eq=False)
class View:
    """One camera of a path; ``name`` is a file's stem, unique within its ``track``."""

    name: str
    track: str
    camera: Camera


def drive_path(drive: Drive) -> tuple[View, ...]:
    """The drive's own cameras."""
    return tuple(View(f.name, f.camera_name, f.camera) for f in drive.frames)


def read_camera_path(path: Path, drive: Drive) -> tuple[View, ...]:
    """Read the views of a file, in the local coordinates of an imported drive.

    Args:
        path: a JSON file, see the module.
        drive: whose own coordinates the file has; its first camera gives size and focal length where the file gives none.
    Raises:
        DriveError: the file, the view and what is wrong with it.
    """
    top: Any = read_json(path)
    kind = next((k for k in ("frames", "camera_path") if isinstance(top, dict) and isinstance(top.get(k), list)), None)
    entries = [] if kind is None else top[kind]
    if kind is None or not entries:
        raise DriveError(
            "has no cameras",
            path=path,
            mend='a path has a list "frames" (transforms.json) or "camera_path" (nerfstudio)',
        )
    views = []
    for i, entry in enumerate(entries):
        if not isinstance(entry, dict):
            raise DriveError(f"Not a JSON object: view {i}", path=path)
        name = file_name(Path(str(entry.get("file_path", entry.get("name", "")))).stem, f"{i:04d}")
        try:
            if "world_to_camera" in entry:
                camera = _workspace_camera(entry, top, path, name)
            elif kind == "frames":
                camera = _frame_camera(entry, top, path, name, drive.frames[0].camera)
            else:
                camera = _viewer_camera(entry, top, path, name, drive.frames[0].camera)
        except KeyError as error:
            raise DriveError(f"view {name} lacks {error}", path=path) from error
        except (TypeError, ValueError, ArithmeticError) as error:
            raise DriveError(f"view {name} is damaged: {error}", path=path) from error
        views.append(
            View(name, file_name(str(entry.get("camera", "camera")), "camera"), drive.to_world.camera_to_local(camera))
        )
    if len({(v.track, v.name) for v in views}) < len(views):
        views = [replace(v, name=f"{i:04d}") for i, v in enumerate(views)]
    _check_near(views, drive, path)
    return tuple(views)


def shifted(
    views: Sequence[View], *, beside: float = 0.0, above: float = 0.0, along: Float64 | None = None
) -> tuple[View, ...]:
    """The same views from beside and above their path, looking in the same directions.

    Args:
        views: in order of travel within each track.
        beside: metres to the right of the direction of travel, negative to the left.
        above: metres up.
        along: (V, 3) directions of travel, where more is known of them than the views themselves tell.
    """
    if not beside and not above:
        return tuple(views)
    centres = np.array([v.camera.centre for v in views])
    moved: dict[int, View] = {}
    for track in dict.fromkeys(v.track for v in views):
        own = [i for i, v in enumerate(views) if v.track == track]
        for k, i in enumerate(own):
            behind, ahead = own[max(k - 1, 0)], own[min(k + 1, len(own) - 1)]
            known = () if along is None else (along[i],)
            travel = (*known, centres[ahead] - centres[behind], centres[own[-1]] - centres[own[0]])
            right = np.cross(_heading(views[i].camera, travel), UP)
            moved[i] = replace(views[i], camera=_moved(views[i].camera, beside * right + above * UP))
    return tuple(moved[i] for i in range(len(views)))


def _heading(camera: Camera, travel: Sequence[Float64]) -> Float64:
    """(3,) unit, level: where the path leads; where it stands still, where the camera looks; where that is straight down, the
    top of the picture."""
    for direction in (*travel, camera.forward, -camera.world_to_camera[1, :3]):
        level = direction - (direction @ UP) * UP
        length = float(np.linalg.norm(level))
        if length > 1e-3 * max(1.0, float(np.linalg.norm(direction))):
            return np.asarray(level / length)
    raise AssertionError("forward and down of a camera cannot both be vertical")


def _moved(camera: Camera, by: Float64) -> Camera:
    """The camera with its centre shifted; through the centre, so that large coordinates cancel before they are turned."""
    pose = camera.world_to_camera.copy()
    pose[:3, 3] = -pose[:3, :3] @ (camera.centre + by)
    return replace(camera, world_to_camera=pose)


def _number(entry: dict[str, Any], top: dict[str, Any], name: str) -> float | None:
    value = entry.get(name, top.get(name))
    return None if value is None else float(value)


def _pose(matrix: object, path: Path, name: str) -> Float64:
    """(4, 4) world-to-camera with OpenCV axes of an OpenGL camera-to-world matrix, nested or as 16 numbers by rows."""
    array = np.asarray(matrix, dtype=np.float64)
    if array.shape == (16,):
        array = array.reshape(4, 4)
    if array.shape == (4, 4) and not np.allclose(array[3], [0, 0, 0, 1], atol=1e-6):
        raise DriveError(
            f"Not a pose: the last row of view {name} differs from 0 0 0 1", path=path, mend="write matrices by rows"
        )
    return rigid_inverse(opengl_to_opencv(pose_from_matrix(array, path, name)))


def _checked(camera: Camera, path: Path, name: str) -> Camera:
    numbers = (camera.fx, camera.fy, camera.cx, camera.cy)
    if not all(math.isfinite(v) for v in numbers) or min(camera.fx, camera.fy) <= 0:
        raise DriveError(f"view {name} has no focal length or centre to speak of", path=path, mend="check its numbers")
    if not (1 <= camera.width <= LARGEST_SIDE and 1 <= camera.height <= LARGEST_SIDE):
        raise DriveError(
            f"view {name} has {camera.width}x{camera.height} pixels", path=path, mend=f"1 to {LARGEST_SIDE} a side"
        )
    return camera


def _frame_camera(entry: dict[str, Any], top: dict[str, Any], path: Path, name: str, own: Camera) -> Camera:
    pose = _pose(entry.get("transform_matrix"), path, name)
    pose = shift_told(Keys({}, top, path)).camera_to_world(replace(own, world_to_camera=pose)).world_to_camera
    width, height, fx, angle = (_number(entry, top, n) for n in ("w", "h", "fl_x", "camera_angle_x"))
    if fx is None and angle is None and width is None and height is None:
        return replace(own, world_to_camera=pose)
    if width is None or height is None or (fx is None and angle is None):
        raise DriveError(
            f"view {name} has half a camera", path=path, mend="give w, h and fl_x (or camera_angle_x), or none of them"
        )
    fx = width / (2 * math.tan(angle / 2)) if fx is None and angle is not None else float(fx or 0)
    fy, cx, cy = (_number(entry, top, n) for n in ("fl_y", "cx", "cy"))
    camera = Camera(
        int(width),
        int(height),
        fx,
        fx if fy is None else fy,
        width / 2 if cx is None else cx,
        height / 2 if cy is None else cy,
        pose,
    )
    return _checked(camera, path, name)


def _viewer_camera(entry: dict[str, Any], top: dict[str, Any], path: Path, name: str, own: Camera) -> Camera:
    kind = str(top.get("camera_type", "perspective")).lower()
    if kind != "perspective":
        raise DriveError(f"Not a known camera_type: {kind}", path=path, mend="render it as perspective")
    pose = _pose(entry.get("camera_to_world"), path, name)
    width, height = (_number(top, {}, n) for n in ("render_width", "render_height"))
    width, height = own.width if width is None else width, own.height if height is None else height
    fov = _number(entry, {"fov": top.get("default_fov")}, "fov")
    if fov is None:
        return _checked(replace(own.resized(int(width), int(height)), world_to_camera=pose), path, name)
    if not 0 < fov < 180:
        raise DriveError(
            f"view {name} has a field of view of {fov:g} degrees", path=path, mend="more than 0, below 180"
        )
    focal = height / (2 * math.tan(math.radians(fov) / 2))
    return _checked(Camera(int(width), int(height), focal, focal, width / 2, height / 2, pose), path, name)


def _workspace_camera(entry: dict[str, Any], top: dict[str, Any], path: Path, name: str) -> Camera:
    pose = np.asarray(entry["world_to_camera"], dtype=np.float64)
    turned = np.eye(4)
    if pose.shape == (4, 4):
        # Only for the check: a camera-to-world of the same rotation.
        turned[:3, :3] = pose[:3, :3].T
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise DriveError(f"Not a pose: view {name} needs a 4x4 matrix of numbers", path=path)
    pose_from_matrix(turned, path, name)
    fx, fy, cx, cy = (float(entry[n]) for n in ("fx", "fy", "cx", "cy"))
    camera = Camera(int(entry["width"]), int(entry["height"]), fx, fy, cx, cy, pose)
    to_world = Similarity.from_json(top["to_world"]) if "to_world" in top else Similarity()
    return to_world.camera_to_world(_checked(camera, path, name))


def _check_near(views: Sequence[View], drive: Drive, path: Path) -> None:
    centres = np.array([f.camera.centre for f in drive.frames])
    reach = max(FARTHEST[0], FARTHEST[1] * float(np.linalg.norm(np.ptp(centres, axis=0))))
    away = min(float(np.linalg.norm(centres - v.camera.centre, axis=1).min()) for v in views)
    if away > reach:
        raise DriveError(
            f"its nearest view is {away:.0f} m away from the drive",
            path=path,
            mend="poses are camera-to-world in the coordinates of the drive's own file",
        )
