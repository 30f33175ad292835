"""Drives as DriveStudio (OmniRe), EmerNeRF and S3Gaussian prepare them: one folder a scene, the same for seven datasets.

    images/000_0.jpg (frame, camera)    intrinsics/0.txt (fx fy cx cy k1 k2 p1 p2 k3)    lidar/000.bin
    extrinsics/0.txt (ego from camera) or extrinsics/000_0.txt (world from camera)
    ego_pose/000.txt (world from ego)   lidar_pose/000.txt (world from LiDAR, nuScenes)   instances/instances_info.json

The layout does not say which dataset it holds, and the datasets differ: Waymo's cameras have axes x forward, y left, z up, and
count pixels from the edge of the first; LiDAR files have 4 to 14 columns. Both are found from the numbers, since names of folders
get lost: cameras stand upright, and only one width makes columns of what they must be. Facts: ziyc/drivestudio
(``datasets/*/*_preprocess.py``, ``*_sourceloader.py``), nnanhuang/S3Gaussian (``waymo_preprocess.py``).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from unveil_core.base.checks.numbers_in_names import natural_key
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.checks.sizes import calibration_size
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep
from unveil_core.drives.formats.cameras import TrackIds, calibrated_camera, picture_size, scenes_of
from unveil_core.drives.formats.on_disk.pictures import pictures_in
from unveil_core.drives.formats.processed.lidar_columns import OF_WAYMO, WITHOUT_ORIGIN, read_sweep
from unveil_core.drives.formats.processed.object_classes import class_of
from unveil_core.drives.formats.processed.shared import MEND, Boxes, Matrices, boxes_of_track, lens

__all__ = ["is_one", "read_drivestudio", "recognizes", "scenes"]

FRONT = "0"
IMAGE = re.compile(r"(\d+)_(\d+)\.(?:jpg|jpeg|png)", re.IGNORECASE)
OPENCV_FROM_WAYMO = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Turns a pose of a camera with axes x forward, y left, z up into one with OpenCV's, multiplied from the right."""
UPRIGHT = 0.7
"""Least share of the camera's down, or up, along the world's for it to count as such: 45 degrees, where the other begins."""
NO_SWEEPS = "the scene has no LiDAR sweeps: lidar/ is missing; prepare it with lidar among --process_keys, or copy that folder, too"
FRAMES_PER_SECOND = 10.0
"""Of the datasets; nuScenes has 2 unless its folder is named for more. The layout keeps no times."""
NUSCENES_FRAMES_PER_SECOND = 2.0


def is_one(folder: Path) -> bool:
    """Whether a folder is a scene itself."""
    return all((folder / n).is_dir() for n in ("images", "extrinsics", "intrinsics")) and any(
        (folder / n).is_dir() for n in ("ego_pose", "lidar_pose")
    )


def recognizes(path: Path) -> bool:
    """Whether a folder is such a scene, or holds such."""
    return bool(scenes(path))


def scenes(path: Path) -> list[str]:
    """Names of the scenes that a folder holds; "." where it is one."""
    return scenes_of(path, is_one)


def read_drivestudio(path: Path, scene: str = ".") -> Drive:
    """Read a scene. Cameras are named by their numbers, 0 is the front one.

    Args:
        path: folder of the scene, or of several; scene: which of them, "." = the folder itself.
    Raises:
        DriveError: with the file and the mend.
    """
    root = path / scene
    images = sorted(
        (int(m[2]), int(m[1]), p) for p in (root / "images").iterdir() if (m := IMAGE.fullmatch(p.name)) is not None
    )
    others = [n for n in pictures_in(root / "images") if IMAGE.fullmatch(n) is None]
    if not images:
        raise DriveError("has no photographs as 000_0.jpg", path=root / "images", mend=MEND)
    poses = _Poses(root)
    boxes = _boxes(root / "instances/instances_info.json", poses)
    rate = _rate(root)
    frames: list[Frame] = []
    notices = [f"images/: {len(others)} pictures are not named as 000_0.jpg, the first {others[0]}"] if others else []
    for number in sorted({camera for camera, *_ in images}):
        own = [(frame, p) for camera, frame, p in images if camera == number]
        there = _camera_frames(root, str(number), own, poses, boxes, rate)
        frames += there
        if len(there) < len(own):
            notices.append(f"camera {number}: {len(own) - len(there)} of {len(own)} photographs have no pose")
    if not frames:
        raise DriveError("has no poses for its photographs", path=root, mend=MEND)
    sweeps = []
    widths = OF_WAYMO if poses.of_waymo else WITHOUT_ORIGIN
    files = (
        sorted((root / "lidar").glob("*.bin"), key=lambda p: natural_key(p.name)) if (root / "lidar").is_dir() else []
    )
    for file in files:
        pose = poses.of_lidar(file.stem)
        if pose is not None and file.stem.isdigit():
            frame = int(file.stem)
            sweeps.append(Sweep(file, partial(read_sweep, file, pose, widths), frame / rate, boxes.get(frame, ())))
    if len(sweeps) < len(files):
        notices.append(f"{len(files) - len(sweeps)} of {len(files)} LiDAR sweeps have no pose")
    notices += [] if files else [NO_SWEEPS]
    notices += [] if boxes else ["the scene has no boxes of objects"]
    return Drive(
        root=root,
        frames=tuple(frames),
        points=PointCloud(np.zeros((0, 3))),
        sweeps=tuple(sweeps),
        sources=tuple(poses.files.files),
        front_cameras=(FRONT,),
        notices=tuple(notices),
    )


class _Poses:
    """Poses of cameras and sweeps.

    Attributes:
        files: what they are read from.
        of_waymo: whether its cameras have Waymo's axes; known once a camera was asked for.
    """

    def __init__(self, root: Path) -> None:
        self.files = Matrices(root)
        self.of_waymo = False

    def of_camera(self, frame: str, camera: str) -> Float64 | None:
        """World from camera (4, 4) with OpenCV's axes; None where a pose is missing."""
        of_frame = self.files.matrix(f"extrinsics/{frame}_{camera}.txt")
        mounting = self.files.matrix(f"extrinsics/{camera}.txt")
        ego = self.files.matrix(f"ego_pose/{frame}.txt")
        if of_frame is not None:
            path, upright, pose = f"extrinsics/{frame}_{camera}.txt", of_frame, of_frame
        elif mounting is not None and ego is not None:
            path, upright, pose = f"extrinsics/{camera}.txt", mounting, ego @ mounting
        else:
            return None
        down_is_y, up_is_z = -upright[2, 1] > UPRIGHT, upright[2, 2] > UPRIGHT
        if down_is_y == up_is_z:
            problem = "has axes that are neither OpenCV's (y down) nor Waymo's (z up)"
            raise DriveError(
                problem, path=self.files.root / path, mend="poses are ego from camera, or world from camera"
            )
        self.of_waymo = bool(up_is_z)
        return pose @ OPENCV_FROM_WAYMO if up_is_z else pose

    def of_lidar(self, frame: str) -> Float64 | None:
        """World from the axes of a frame's points (4, 4); None where there is none."""
        own = self.files.matrix(f"lidar_pose/{frame}.txt")
        return own if own is not None else self.files.matrix(f"ego_pose/{frame}.txt")


def _rate(root: Path) -> float:
    """Frames a second, nominally."""
    for part in reversed(root.resolve().parts):
        if (named := re.fullmatch(r".*_(\d+)Hz", part)) and int(named[1]) > 0:
            return float(named[1])
    return NUSCENES_FRAMES_PER_SECOND if (root / "lidar_pose").is_dir() else FRAMES_PER_SECOND


def _camera_frames(
    root: Path,
    camera: str,
    images: list[tuple[int, Path]],
    poses: _Poses,
    boxes: Boxes,
    rate: float,
) -> list[Frame]:
    path = root / "intrinsics" / f"{camera}.txt"
    k = poses.files.numbers(path)
    if len(k) < 4 or not np.isfinite(k).all():
        raise DriveError(f"Not fx fy cx cy k1 k2 p1 p2 k3: {k}", path=path, mend=MEND)
    size = calibration_size(picture_size(images[0][1]), (k[2], k[3]))
    frames = []
    for number, image in images:
        pose = poses.of_camera(image.stem.split("_")[0], camera)
        if pose is None:
            continue
        edge = 0.5 if poses.of_waymo else 0.0  # Waymo counts the principal point from the edge of the first pixel
        frames.append(
            Frame(
                name=image.stem.split("_")[0],
                camera_name=camera,
                camera=calibrated_camera(size, (k[0], k[1]), (k[2] - edge, k[3] - edge), pose, path),
                image_path=image,
                distortion=lens(k[4:9]),
                timestamp=number / rate,
                boxes=boxes.get(number, ()),
            )
        )
    return frames


def _boxes(path: Path, poses: _Poses) -> Boxes:
    """Boxes by frame number."""
    if not path.is_file():
        return {}
    poses.files.files.append(path)
    content = read_json(path)
    found: dict[int, list[TrackedBox]] = {}
    ids = TrackIds()
    try:
        for key, entry in content.items():  # type: ignore[attr-defined]
            class_name = class_of(str(entry["class_name"]))
            if class_name is None:
                continue
            numbers, placed, sizes = _annotations(entry["frame_annotations"])
            for number, box in zip(numbers, boxes_of_track(ids.of(str(key)), class_name, placed, sizes), strict=True):
                if box is not None:
                    found.setdefault(number, []).append(box)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        problem = f"lacks {error}" if isinstance(error, KeyError) else f"holds no instances: {error}"
        raise DriveError(problem, path=path, mend=MEND) from error
    return {number: tuple(b) for number, b in found.items()}


def _annotations(entry: Mapping[str, Any]) -> tuple[list[int], Float64, Float64]:
    """Frame numbers, poses (n, 4, 4) and sizes (n, 3) of one instance."""
    numbers = [int(n) for n in entry["frame_idx"]]
    count = len(numbers)
    placed = np.asarray(entry["obj_to_world"], dtype=np.float64).reshape(count, 4, 4)
    return numbers, placed, np.asarray(entry["box_size"], dtype=np.float64).reshape(count, 3)
