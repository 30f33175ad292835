"""KITTI odometry, and SemanticKITTI, which adds labels of points to it.

    sequences/00/image_0 … image_3/000000.png …   velodyne/000000.bin …   calib.txt   times.txt      labels/000000.label …
    poses/00.txt …                                 of sequences 00 to 10

Poses are those of camera 0, rectified, in its own axes at the first frame: y is down there, so the drive is turned to z up.
Sweeps have the vehicle's motion taken out already. Facts: KITTI's readme; utiasSTARS/pykitti (``odometry.py``);
PRBonn/semantic-kitti-api (``config/semantic-kitti.yaml``).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.numbers_in_names import natural_key
from unveil_core.base.disk.open_safely import LARGEST_FILE, open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.cityscapes import table
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep
from unveil_core.drives.formats.cameras import read_numbers, rigid
from unveil_core.drives.formats.kitti.sweeps import sweep_reader
from unveil_core.drives.formats.kitti.text import (
    absolute,
    at,
    left_out,
    numbered,
    pictures,
    read_calibration,
    rectified_lens,
    usable_pose,
)
from unveil_core.geometry.similarity import Similarity
from unveil_core.geometry.transforms import rigid_inverse

__all__ = ["is_one", "read_kitti_odometry", "recognizes", "scenes"]

CAMERAS = ("image_2", "image_3", "image_0", "image_1")
"""Colour first; the first that a sequence has is read unless others are asked for."""
Z_UP = np.array([[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From the axes of camera 0 at the first frame (x right, y down, z ahead) to the drive's: x ahead, y left, z up."""
MEND_CALIBRATION = "download data_odometry_calib.zip again"
POINT_CLASSES: dict[int, str | None] = {
    10: "car", 11: "bicycle", 13: "bus", 15: "motorcycle", 16: "train", 18: "truck", 20: "truck", 30: "person",
    31: "rider", 32: "rider", 40: "road", 44: "road", 48: "sidewalk", 49: "sidewalk", 50: "building", 51: "fence",
    60: "road", 70: "vegetation", 71: "vegetation", 72: "terrain", 80: "pole", 81: "traffic sign",
    252: "car", 253: "rider", 254: "person", 255: "rider", 256: "train", 257: "bus", 258: "truck", 259: "truck",
}  # fmt: skip
"""Of SemanticKITTI's ids; 20 and 259 are other vehicles, 49 is other ground, from 252 on are those that move. Other structures (52)
and other objects (99) are left unknown."""
OF_LABEL = table(POINT_CLASSES, 1 << 16)


def is_one(folder: Path) -> bool:
    """Whether a folder is a sequence itself."""
    return (folder / "calib.txt").is_file() and any((folder / c).is_dir() for c in (*CAMERAS, "velodyne"))


def _sequences(path: Path) -> Path:
    """The folder that holds sequences."""
    return next((p for p in (path / "sequences", path / "dataset/sequences") if p.is_dir()), path)


def recognizes(path: Path) -> bool:
    """Whether a folder is a sequence of KITTI odometry, or holds such."""
    return path.is_dir() and bool(scenes(path))


def scenes(path: Path) -> list[str]:
    """Names of the sequences that a folder holds; "." where it is one."""
    if is_one(path):
        return ["."]
    folder = _sequences(path)
    if not folder.is_dir():
        return []
    return sorted((p.name for p in folder.iterdir() if p.name.isdigit() and is_one(p)), key=natural_key)


def read_kitti_odometry(path: Path, scene: str = ".") -> Drive:
    """Read a sequence.

    Args:
        path: folder of the sequence, or of the data set; scene: which sequence, "." = the folder itself.
    Raises:
        DriveError: with the file and the mend.
    """
    root = path if scene == "." else _sequences(path) / scene
    names = [c for c in CAMERAS if pictures(root / c)]
    if not names:
        raise DriveError("has no photographs", path=root, mend="download data_odometry_color.zip, too")
    poses, unusable, pose_file = _poses(root)
    notices = left_out("poses", unusable, unusable + len(poses), "have NaN or no rotation: their frames are left out")
    sweep_files = numbered(root / "velodyne", (".bin",))
    calib = root / "calib.txt"
    counts = {f"P{name[-1]}": 12 for name in names} | ({"Tr": 12} if sweep_files else {})
    calibration = read_calibration(calib, counts, MEND_CALIBRATION)
    times = _times(root / "times.txt")
    frames: list[Frame] = []
    for name in names:
        images = pictures(root / name)
        lens = rectified_lens(calibration[f"P{name[-1]}"], next(iter(images.values())), calib)
        first_from_camera = rigid_inverse(lens.from_first)
        frames += [
            Frame(
                name=image.stem,
                camera_name=name,
                camera=lens.camera(Z_UP @ poses[n] @ first_from_camera),
                image_path=image,
                timestamp=at(times, n),
            )
            for n, image in images.items()
            if n in poses
        ]
        without = sum(n not in poses for n in images)
        notices += left_out(name, without, len(images), "photographs have no pose and are left out")
    if not frames:
        raise DriveError("has no photograph with a pose", path=pose_file, mend="download the poses again")
    sweeps, labels = [], numbered(root / "labels", (".label",))
    if sweep_files:
        velo = rigid(calibration["Tr"], calib, "Tr")
        for n, file in sweep_files.items():
            if n in poses:
                classes = partial(_classes, labels[n]) if n in labels else None
                sweeps.append(Sweep(file, sweep_reader(file, Z_UP @ poses[n] @ velo, classes=classes), at(times, n)))
    notices += left_out("velodyne", len(poses) - len(sweeps), len(poses), "sweeps are missing")
    there = len(sweep_files)
    notices += left_out("velodyne", there - len(sweeps), there, "sweeps have no pose and are left out")
    return Drive(
        root=root,
        frames=tuple(frames),
        points=PointCloud(np.zeros((0, 3))),
        sweeps=tuple(sweeps),
        to_world=Similarity(rotation=Z_UP[:3, :3].T),
        sources=tuple(p for p in (calib, root / "times.txt", pose_file, *labels.values()) if p.is_file()),
        front_cameras=(names[0],),
        notices=tuple(notices),
    )


def _poses(root: Path) -> tuple[dict[int, Float64], int, Path]:
    """Poses (4, 4) of camera 0 by frame number, how many lines hold none, and their file."""
    name = absolute(root).name
    places = (absolute(root).parent.parent / f"poses/{name}.txt", root / "poses.txt")
    path = next((p for p in places if p.is_file()), places[0])
    mend = "KITTI gives them for sequences 00 to 10, in data_odometry_poses.zip"
    if not path.is_file():
        raise DriveError(f"sequence {name} has no poses", path=path, mend=mend)
    lines = read_numbers(path, mend)
    found = {n: pose for n, line in enumerate(lines) if (pose := usable_pose(line, path)) is not None}
    if not found:
        raise DriveError("holds no pose of 12 numbers", path=path, mend=mend)
    return found, len(lines) - len(found), path


def _times(path: Path) -> list[float | None]:
    """Seconds of each frame; [] without a file."""
    lines = read_numbers(path, "download data_odometry_calib.zip again") if path.is_file() else []
    return [float(line[0]) if np.isfinite(line[0]) else None for line in lines]


def _classes(path: Path, count: int) -> NDArray[np.uint8]:
    """(count,) trainIds of a sweep. Each label is 32 bits, of which the upper half is an instance."""
    try:
        with open_file(path, LARGEST_FILE) as stream:
            labels = np.fromfile(stream, dtype="<u4")
    except OSError as error:
        raise DriveError("Not found, or not readable: labels", path=path, mend="restore it") from error
    if len(labels) != count:
        raise DriveError(f"labels {len(labels)} points, the sweep has {count}", path=path, mend="download both again")
    return OF_LABEL[labels & 0xFFFF]
