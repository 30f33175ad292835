"""Waymo drives as Street Gaussians prepares them: one folder a segment.

    images/000000_0.png (frame, camera)    intrinsics/0.txt (fx fy cx cy k1 k2 p1 p2 k3)
    extrinsics/0.txt (vehicle from camera, OpenCV's axes)    ego_pose/000000.txt and 000000_0.txt (world from vehicle)
    pointcloud.npz (points of all frames, in the vehicle's axes)    track/track_info.txt (boxes)    timestamps.json

Unlike in DriveStudio's layout each photograph has the vehicle's pose at its own time. The points are one pickled dict for the whole
segment, which goes through the restricted unpickler. Facts: zju3dv/street_gaussians (``waymo_converter.py``, ``waymo_utils.py``).
"""

from __future__ import annotations

import math
import re
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json, read_text
from unveil_core.base.types import Float64
from unveil_core.drives.checks.sizes import calibration_size
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep, SweepPoints
from unveil_core.drives.formats.cameras import TrackIds, calibrated_camera, picture_size, scenes_of
from unveil_core.drives.formats.on_disk.pictures import pictures_in
from unveil_core.drives.formats.processed.object_classes import class_of
from unveil_core.drives.formats.processed.shared import (
    MEND,
    Boxes,
    Matrices,
    boxes_near,
    boxes_of_track,
    by_numbers,
    lens,
)
from unveil_core.drives.formats.safe_pickle import read_archived_object

__all__ = ["is_one", "read_street_gaussians", "recognizes", "scenes"]

CAMERAS = ("FRONT", "FRONT_LEFT", "FRONT_RIGHT", "SIDE_LEFT", "SIDE_RIGHT")
"""Names of the cameras by number."""
FRONT = CAMERAS[0]
IMAGE = re.compile(r"(\d+)_([0-4])\.(?:png|jpg|jpeg)", re.IGNORECASE)
TRACK_COLUMNS = 12
"""Frame, track, class, alpha, height, width, length, centre x y z, heading and speed."""


def is_one(folder: Path) -> bool:
    """Whether a folder is a segment itself."""
    return (folder / "pointcloud.npz").is_file() and (folder / "ego_pose").is_dir()


def recognizes(path: Path) -> bool:
    """Whether a folder is such a segment, or holds such."""
    return bool(scenes(path))


def scenes(path: Path) -> list[str]:
    """Names of the segments that a folder holds; "." where it is one."""
    return scenes_of(path, is_one)


def read_street_gaussians(path: Path, scene: str = ".") -> Drive:
    """Read a segment.

    Args:
        path: folder of the segment, or of several; scene: which of them, "." = the folder itself.
    Raises:
        DriveError: with the file and the mend.
    """
    root = path / scene
    images = root / "images"
    found = [(p, m) for p in by_numbers(images) if (m := IMAGE.fullmatch(p.name))]
    if not found:
        raise DriveError("has no photographs as 000000_0.png", path=images, mend=MEND)
    matrices = Matrices(root)
    stamps = _stamps(root / "timestamps.json")
    boxes = _boxes(root / "track/track_info.txt", matrices)
    frames = []
    for camera, name in enumerate(CAMERAS):
        own = [(p, m[1]) for p, m in found if int(m[2]) == camera]
        frames += _camera_frames(matrices, camera, own, stamps.get(name, {}), stamps.get("FRAME", {}), boxes)
    if not frames:
        raise DriveError("has no poses for its photographs", path=root / "ego_pose", mend=MEND)
    notices = [f"{len(found) - len(frames)} of {len(found)} photographs have no pose"] * (len(frames) < len(found))
    others = [n for n in pictures_in(images) if IMAGE.fullmatch(n) is None]
    if others:
        notices.append(
            f"images/: {len(others)} pictures are not named as 000000_0.png, cameras 0 to 4, the first {others[0]}"
        )
    notices += [] if boxes else ["the scene has no boxes of objects"]
    cloud = root / "pointcloud.npz"
    sweeps = []
    for file in by_numbers(root / "ego_pose"):
        pose = matrices.matrix(f"ego_pose/{file.name}") if file.stem.isdigit() and file.suffix == ".txt" else None
        if pose is not None:
            number = int(file.stem)
            time = stamps.get("FRAME", {}).get(number)
            sweeps.append(Sweep(cloud, partial(_points, cloud, number, pose), time, boxes.get(number, ())))
    sources = [*matrices.files, *(p for n in ("timestamps.json", "track/track_info.txt") if (p := root / n).is_file())]
    return Drive(
        root=root,
        frames=tuple(frames),
        points=PointCloud(np.zeros((0, 3))),
        sweeps=tuple(sweeps),
        sources=tuple(sources),
        front_cameras=(FRONT,),
        notices=tuple(notices),
    )


def _stamps(path: Path) -> dict[str, dict[int, float]]:
    """Seconds by frame number, of each camera and of the sweeps ("FRAME")."""
    if not path.is_file():
        return {}
    content: Any = read_json(path)
    try:
        stamps = {str(name): {int(k): float(v) for k, v in times.items()} for name, times in content.items()}
        if not all(math.isfinite(v) for times in stamps.values() for v in times.values()):
            raise ValueError("one of them is not finite")
        return stamps
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise DriveError(f"holds no time stamps: {error}", path=path, mend=MEND) from error


def _camera_frames(
    matrices: Matrices,
    camera: int,
    images: list[tuple[Path, str]],
    stamps: dict[int, float],
    stamps_of_boxes: dict[int, float],
    boxes: Boxes,
) -> list[Frame]:
    mounting = matrices.matrix(f"extrinsics/{camera}.txt")
    if not images or mounting is None:
        return []
    path = matrices.root / "intrinsics" / f"{camera}.txt"
    k = matrices.numbers(path)
    if len(k) < 4 or not np.isfinite(k).all():
        raise DriveError(f"Not fx fy cx cy k1 k2 p1 p2 k3: {k}", path=path, mend=MEND)
    size = calibration_size(picture_size(images[0][0]), (k[2], k[3]))
    frames = []
    for image, name in images:
        own = matrices.matrix(f"ego_pose/{name}_{camera}.txt")
        vehicle = own if own is not None else matrices.matrix(f"ego_pose/{name}.txt")
        if vehicle is None:
            continue
        # Waymo counts the principal point from the edge of the first pixel.
        centre = (k[2] - 0.5, k[3] - 0.5)
        time = stamps.get(int(name))
        frames.append(
            Frame(
                name=name,
                camera_name=CAMERAS[camera],
                camera=calibrated_camera(size, (k[0], k[1]), centre, vehicle @ mounting, path),
                image_path=image,
                distortion=lens(k[4:9]),
                timestamp=time,
                boxes=boxes_near(time, int(name), stamps_of_boxes, boxes),
            )
        )
    return frames


def _boxes(path: Path, matrices: Matrices) -> Boxes:
    """Boxes by frame number, of a table with a line of names above it."""
    if not path.is_file():
        return {}
    ids = TrackIds()
    found: Boxes = {}
    try:
        for line in read_text(path).splitlines()[1:]:
            words = line.split()
            class_name = class_of(words[2]) if len(words) >= TRACK_COLUMNS else None
            if class_name is None:
                if words and len(words) < TRACK_COLUMNS:
                    raise ValueError(f"a line has {len(words)} columns")
                continue
            number = int(words[0])
            vehicle = matrices.matrix(f"ego_pose/{number:06d}.txt")
            if vehicle is None:
                continue
            height, width, length, x, y, z, heading = (float(w) for w in words[4:11])
            pose = np.eye(4)
            pose[:2, :2] = [[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]]
            pose[:3, 3] = (x, y, z)
            sizes = np.array([[length, width, height]])
            (box,) = boxes_of_track(ids.of(words[1]), class_name, (vehicle @ pose)[None], sizes)
            found[number] = (*found.get(number, ()), *(() if box is None else (box,)))
    except (OSError, ValueError, OverflowError) as error:
        raise DriveError(f"Not a table of tracks: {error}", path=path, mend=MEND) from error
    return found


@lru_cache(maxsize=1)
def _cloud(path: Path, stamp: tuple[int, int]) -> dict[int, Any]:
    """Points by frame number. The file holds all of a segment's in one piece: it is read once for all sweeps."""
    held = read_archived_object(path, "pointcloud")
    try:
        return {int(number): points for number, points in held.items()}
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise DriveError(f"holds no points by frame: {error}", path=path, mend=MEND) from error


def _points(path: Path, number: int, world_from_vehicle: Float64) -> SweepPoints:
    try:
        stat = path.stat()
    except OSError as error:
        raise DriveError(f"cannot be read: {error.strerror}", path=path, mend=MEND) from error
    found = _cloud(path, (stat.st_size, stat.st_mtime_ns)).get(number, np.zeros((0, 3)))
    if not isinstance(found, np.ndarray) or found.ndim != 2 or found.shape[1] < 3 or found.dtype.kind != "f":
        raise DriveError(f"holds no points (N, 3) for frame {number}", path=path, mend=MEND)
    points = found[:, :3].astype(np.float64)
    points = points[np.isfinite(points).all(axis=1)]
    return SweepPoints(points @ world_from_vehicle[:3, :3].T + world_from_vehicle[:3, 3])
