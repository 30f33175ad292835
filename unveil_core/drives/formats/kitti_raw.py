"""KITTI raw data, synchronized and rectified, as released: one folder a drive, calibration in the folder of its day.

    2011_09_26/calib_cam_to_cam.txt  calib_velo_to_cam.txt  calib_imu_to_velo.txt
    2011_09_26/2011_09_26_drive_0001_sync/
        image_00 … image_03/data/0000000000.png …   timestamps.txt      00 and 01 grey, 02 and 03 colour
        oxts/data/0000000000.txt …                  timestamps.txt
        velodyne_points/data/0000000000.bin …       timestamps.txt  timestamps_start.txt  timestamps_end.txt
        tracklet_labels.xml

The number of a file is that of the frame; photographs and sweeps may be missing. Poses are made of latitude, longitude, height
and angles as KITTI's devkit makes them: metres east, north and up of the first frame. Sweeps are measured while the vehicle
moves, see :func:`unveil_core.drives.formats.kitti.sweeps.untwisted`. Facts: KITTI's readme; utiasSTARS/pykitti (``raw.py``,
``utils.py``).
"""

from __future__ import annotations

import math
import re
from functools import partial
from pathlib import Path

import numpy as np

from unveil_core.base.disk.open_safely import LARGEST_STATE, read_bytes
from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep
from unveil_core.drives.formats.cameras import rigid
from unveil_core.drives.formats.kitti.boxes import moved, read_tracklets
from unveil_core.drives.formats.kitti.sweeps import motions, sweep_reader, turn_seconds, untwisted
from unveil_core.drives.formats.kitti.text import (
    absolute,
    at,
    left_out,
    numbered,
    pictures,
    read_calibration,
    read_size,
    read_stamps,
    rectified_lens,
)
from unveil_core.geometry.transforms import rigid_inverse

__all__ = ["is_one", "read_kitti_raw", "recognizes", "scenes"]

CAMERAS = ("image_02", "image_03", "image_00", "image_01")
"""Colour first; the first that a drive has is read unless others are asked for."""
EARTH_RADIUS_M = 6378137.0
"""Of the sphere that KITTI's devkit projects positions from, metres: the equator's of WGS 84."""
MOST_OF_POSE = (90.0, 361.0, 1e5, 10.0, 10.0, 10.0)
"""Of latitude and longitude, degrees, height, metres, and angles, radians; what is beyond, or NaN, is no pose."""
MEND_CALIBRATION = "download the calibration of this day and unpack it beside its drives"
MEND = "download the drive again (synced+rectified data)"


def is_one(folder: Path) -> bool:
    """Whether a folder is a drive itself."""
    return (folder / "oxts/data").is_dir() and any((folder / c / "data").is_dir() for c in CAMERAS)


def recognizes(path: Path) -> bool:
    """Whether a folder is a drive of KITTI raw, or holds such."""
    return path.is_dir() and bool(scenes(path))


def scenes(path: Path) -> list[str]:
    """Names of the drives in a folder, of one day or of several; "." where it is one."""
    if is_one(path):
        return ["."]
    if not path.is_dir():
        return []
    folders = sorted(p for p in path.iterdir() if re.match(r"\d{4}_\d\d_\d\d", p.name) and p.is_dir())
    found = [p.name for p in folders if is_one(p)]
    days = [p for p in folders if re.fullmatch(r"\d{4}_\d\d_\d\d", p.name)]
    return found + [f"{day.name}/{p.name}" for day in days for p in sorted(day.iterdir()) if is_one(p)]


def read_kitti_raw(path: Path, scene: str = ".") -> Drive:
    """Read a drive.

    Args:
        path: folder of the drive, of its day, or of several days; scene: which drive of these, "." = the folder itself.
    Raises:
        DriveError: with the file and the mend.
    """
    root = path / scene
    if absolute(root).name.endswith("_extract"):
        problem = "Not read: the recording before synchronization and rectification"
        raise DriveError(problem, path=root, mend="use the drive's folder that ends in _sync")
    folder = _calibration_folder(root)
    names = [c for c in CAMERAS if pictures(root / c / "data")]
    if not names:
        raise DriveError("has no photographs", path=root, mend=MEND)
    cam_to_cam = folder / "calib_cam_to_cam.txt"
    counts = {"R_rect_00": 9} | {f"P_rect_{name[-2:]}": 12 for name in names}
    calibration = read_calibration(cam_to_cam, counts, MEND_CALIBRATION)
    cam0_from_velo = _rigid(folder / "calib_velo_to_cam.txt")
    velo_from_imu = _rigid(folder / "calib_imu_to_velo.txt")
    rectify = np.eye(4)
    # All pictures are rectified to the plane of camera 0, so its rotation holds for every camera.
    rectify[:3, :3] = rigid(_with_zeros(calibration["R_rect_00"]), cam_to_cam, "R_rect_00")[:3, :3]
    poses, unusable, oxts = _vehicle_poses(root / "oxts/data")
    scanner = {n: pose @ rigid_inverse(velo_from_imu) for n, pose in poses.items()}
    notices = left_out("oxts", unusable, len(oxts), "files hold no pose: their frames are left out")
    tracklets, boxes = root / "tracklet_labels.xml", dict[int, tuple[TrackedBox, ...]]()
    if tracklets.is_file():
        found = read_tracklets(tracklets)
        boxes = {n: tuple(moved(b, scanner[n]) for b in some) for n, some in found.items() if n in scanner}
    frames: list[Frame] = []
    for name in names:
        images, stamps = pictures(root / name / "data"), read_stamps(root / name / "timestamps.txt")
        first = next(iter(images.values()))
        calibrated = read_size(cam_to_cam, f"S_rect_{name[-2:]}")
        lens = rectified_lens(calibration[f"P_rect_{name[-2:]}"], first, cam_to_cam, calibrated)
        velo_from_camera = rigid_inverse(lens.from_first @ rectify @ cam0_from_velo)
        frames += [
            Frame(
                name=image.stem,
                camera_name=name,
                camera=lens.camera(scanner[n] @ velo_from_camera),
                image_path=image,
                timestamp=at(stamps, n),
                boxes=boxes.get(n, ()),
            )
            for n, image in images.items()
            if n in scanner
        ]
        without = sum(n not in scanner for n in images)
        notices += left_out(name, without, len(images), "photographs have no pose and are left out")
    if not frames:
        raise DriveError("has no photograph with a pose", path=root / "oxts/data", mend=MEND)
    sweeps = _sweeps(root / "velodyne_points", scanner, read_stamps(root / "oxts/timestamps.txt"), boxes)
    notices += left_out("velodyne_points", len(scanner) - len(sweeps), len(scanner), "sweeps are missing")
    there = len(numbered(root / "velodyne_points/data", (".bin",)))
    notices += left_out("velodyne_points", there - len(sweeps), there, "sweeps have no pose and are left out")
    stamp_files = (root.glob("*/timestamps*.txt"), (tracklets,))
    return Drive(
        root=root,
        frames=tuple(frames),
        points=PointCloud(np.zeros((0, 3))),
        sweeps=tuple(sweeps),
        sources=(
            *(folder / f"calib_{n}.txt" for n in ("cam_to_cam", "velo_to_cam", "imu_to_velo")),
            *oxts,
            *(p for some in stamp_files for p in sorted(some) if p.is_file()),
        ),
        front_cameras=(names[0],),
        notices=tuple(notices),
    )


def _calibration_folder(root: Path) -> Path:
    """The folder with the calibration: the day's above the drive, seen by name or through a link, or the drive's own."""
    places = (absolute(root).parent, root.resolve().parent, root)
    return next((p for p in places if (p / "calib_cam_to_cam.txt").is_file()), places[0])


def _rigid(path: Path) -> Float64:
    found = read_calibration(path, {"R": 9, "T": 3}, MEND_CALIBRATION)
    return rigid(np.column_stack([found["R"].reshape(3, 3), found["T"]]), path, "R and T")


def _with_zeros(rotation: Float64) -> Float64:
    return np.column_stack([rotation.reshape(3, 3), np.zeros(3)])


def _vehicle_poses(folder: Path) -> tuple[dict[int, Float64], int, list[Path]]:
    """Poses (4, 4) of the IMU by frame number, east, north and up of the first; how many files hold none; all files."""
    files = numbered(folder, (".txt",))
    packets: dict[int, list[float]] = {}
    for number, path in files.items():
        try:
            values = [float(word) for word in read_bytes(path, LARGEST_STATE).decode("utf-8").split()[:6]]
        except (OSError, ValueError):
            continue
        if len(values) == 6 and all(abs(v) < most for v, most in zip(values, MOST_OF_POSE, strict=True)):
            packets[number] = values
    if not packets:
        raise DriveError("holds no pose of the vehicle", path=folder, mend=MEND)
    scale = math.cos(math.radians(next(iter(packets.values()))[0]))
    poses = {number: _pose(values, scale) for number, values in packets.items()}
    origin = next(iter(poses.values()))[:3, 3].copy()
    for pose in poses.values():
        pose[:3, 3] -= origin
    return poses, len(files) - len(packets), list(files.values())


def _pose(packet: list[float], scale: float) -> Float64:
    """(4, 4) from the IMU (x ahead, y left, z up) to Mercator's plane at a scale.

    Args:
        packet: latitude and longitude in degrees, height in metres; roll, pitch and yaw in radians, yaw 0 = east.
    """
    latitude, longitude, height, roll, pitch, yaw = packet
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    pose = np.eye(4)
    pose[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    north = math.log(math.tan(math.pi / 4 + math.radians(latitude) / 2))
    pose[:3, 3] = scale * EARTH_RADIUS_M * math.radians(longitude), scale * EARTH_RADIUS_M * north, height
    return pose


def _sweeps(
    folder: Path,
    poses: dict[int, Float64],
    pose_stamps: list[float | None],
    boxes: dict[int, tuple[TrackedBox, ...]],
) -> list[Sweep]:
    ahead, start, end = (read_stamps(folder / f"timestamps{n}.txt") for n in ("", "_start", "_end"))
    numbers = sorted(poses)
    sweeps = []
    for n, path in numbered(folder / "data", (".bin",)).items():
        if n in poses:
            before, after = motions(n, poses, numbers, pose_stamps)
            turn = turn_seconds(at(start, n), at(end, n))
            correct = partial(untwisted, before=before, after=after, turn_s=turn)
            read = sweep_reader(path, poses[n], correct=correct)
            sweeps.append(Sweep(path, read, at(ahead, n), boxes.get(n, ())))
    return sweeps
