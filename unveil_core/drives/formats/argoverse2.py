"""Argoverse 2, sensor dataset: one folder a log, in a folder or in one of the splits of it.

    city_SE3_egovehicle.feather     annotations.feather (not in the test split)
    calibration/egovehicle_SE3_sensor.feather    calibration/intrinsics.feather
    sensors/cameras/<camera>/<nanoseconds>.jpg   sensors/lidar/<nanoseconds>.feather

``A_SE3_B`` maps from B to A; quaternions are wxyz; the vehicle's x points forward, y left, z up from its rear axle; cameras have
OpenCV axes. Photographs are undistorted as released, whatever k1 to k3 say. A sweep is in the vehicle at the time of its name,
its motion taken out; boxes are in the vehicle at such a time. Facts: argoverse/av2-api; checked against one of its logs.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox, boxes_at
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep, SweepPoints
from unveil_core.drives.formats.cameras import TrackIds, calibrated_camera, pose_of
from unveil_core.drives.formats.tables import Columns, read_columns
from unveil_core.geometry.transforms import quat_to_rotation

__all__ = ["is_one", "read_argoverse2", "recognizes", "scenes"]

FRONT = "ring_front_center"
EGO_ROWS = {"ring_front_center": 250 / 2048, "ring_rear_left": 250 / 1550, "ring_rear_right": 250 / 1550}
"""Share of the rows, the lowest ones, that show the ego vehicle, by camera: NeuRAD crops 250 of photographs as released."""
BOX_CLASSES: dict[str, str] = {
    "REGULAR_VEHICLE": "car",
    "LARGE_VEHICLE": "truck",
    "TRUCK": "truck",
    "BOX_TRUCK": "truck",
    "TRUCK_CAB": "truck",
    "VEHICULAR_TRAILER": "truck",
    "BUS": "bus",
    "SCHOOL_BUS": "bus",
    "ARTICULATED_BUS": "bus",
    "RAILED_VEHICLE": "train",
    "MOTORCYCLE": "motorcycle",
    "BICYCLE": "bicycle",
    "WHEELED_DEVICE": "bicycle",
    "MOTORCYCLIST": "rider",
    "BICYCLIST": "rider",
    "WHEELED_RIDER": "rider",
    "PEDESTRIAN": "person",
    "OFFICIAL_SIGNALER": "person",
    "STROLLER": "person",
    "WHEELCHAIR": "person",
}
"""Cityscapes classes of boxes; categories that are not listed, as bollards, cones, signs on wheels
and animals, stay in the street."""
ROTATION, POSITION = ("qw", "qx", "qy", "qz"), ("tx_m", "ty_m", "tz_m")
POSES, EXTRINSICS, INTRINSICS, BOXES = (
    "city_SE3_egovehicle.feather",
    "calibration/egovehicle_SE3_sensor.feather",
    "calibration/intrinsics.feather",
    "annotations.feather",
)
LONGEST_GAP_NS = 100_000_000
"""Between two poses that one is interpolated in; released logs have some 170 poses a second and one at each stamp."""


def is_one(folder: Path) -> bool:
    """Whether a folder is a log itself."""
    return (folder / POSES).is_file() and (folder / "calibration").is_dir()


def recognizes(path: Path) -> bool:
    """Whether a folder is a log of the dataset, or holds such, or splits with such."""
    return path.is_dir() and bool(_logs(path))


def scenes(path: Path) -> list[str]:
    """Names of the logs in a folder; "." where it is one."""
    return list(_logs(path))


def _logs(path: Path) -> dict[str, Path]:
    if is_one(path):
        return {".": path}
    found = {p.parent.name: p.parent for depth in ("*", "*/*") for p in sorted(path.glob(f"{depth}/{POSES}"))}
    return {name: folder for name, folder in sorted(found.items()) if is_one(folder)}


def read_argoverse2(path: Path, scene: str = ".") -> Drive:
    """Read a log.

    Args:
        path: folder of the log, of several, or of their splits; scene: which of them, "." = the folder itself.
    Raises:
        DriveError: with the file and the mend.
    """
    root = _logs(path)[scene]
    notices: list[str] = []
    poses = _poses(root / POSES)
    stamps, boxes = _boxes(root / BOXES, poses, notices)
    sweeps, missed = [], 0
    for stamp, file in _stamped(root / "sensors/lidar", ".feather").items():
        pose = poses.at(stamp)
        missed += pose is None
        if pose is not None:
            at_sweep = boxes_at(stamp / 1e9, stamps, boxes)
            sweeps.append(Sweep(file, partial(_points, file, pose), stamp / 1e9, at_sweep))
    frames = _frames(root, poses, partial(boxes_at, stamps=stamps, boxes=boxes), notices)
    if missed:
        notices.append(f"{missed} LiDAR sweeps have no pose and are left out")
    if poses.between:
        notices.append(f"{poses.between} poses are interpolated: {POSES} lacks their stamps")
    if not sweeps:
        notices.append("no LiDAR: sensors/lidar has no sweeps")
    return Drive(
        root=root,
        frames=tuple(frames),
        points=PointCloud(np.zeros((0, 3))),
        sources=tuple(p for p in (root / n for n in (POSES, EXTRINSICS, INTRINSICS, BOXES)) if p.is_file()),
        sweeps=tuple(sweeps),
        front_cameras=(FRONT,),
        notices=tuple(notices),
    )


@dataclass(eq=False)
class _Poses:
    """The vehicle's way.

    Attributes:
        path: of the table.
        stamps: ascending, nanoseconds; quats: (N, 4) wxyz; positions: (N, 3), metres in the city.
        between: how many poses were interpolated so far.
    """

    path: Path
    stamps: list[int]
    quats: Float64
    positions: Float64
    between: int = 0

    def at(self, stamp: int) -> Float64 | None:
        """(4, 4) city from vehicle; None where the table has no pose near. Raises DriveError: numbers that make none."""
        k = bisect.bisect_left(self.stamps, stamp)
        if k < len(self.stamps) and self.stamps[k] == stamp:
            return pose_of(self.quats[k], self.positions[k], self.path, f"the pose at {stamp}")
        if k in (0, len(self.stamps)) or self.stamps[k] - self.stamps[k - 1] > LONGEST_GAP_NS:
            return None
        self.between += 1
        share = (stamp - self.stamps[k - 1]) / (self.stamps[k] - self.stamps[k - 1])
        before, after = self.quats[k - 1], self.quats[k]
        # Of poses 10 ms apart the chord is as good as the arc; q and -q are one rotation.
        quat = before * (1 - share) + after * (share if before @ after >= 0 else -share)
        position = self.positions[k - 1] * (1 - share) + self.positions[k] * share
        return pose_of(quat, position, self.path, f"the pose at {stamp}")


def _poses(path: Path) -> _Poses:
    columns = read_columns(path, ("timestamp_ns", *ROTATION, *POSITION))
    stamps = columns.integers("timestamp_ns", "ns")
    order = np.argsort(stamps, kind="stable")
    return _Poses(path, stamps[order].tolist(), _table(columns, ROTATION)[order], _table(columns, POSITION)[order])


def _table(columns: Columns, names: Sequence[str]) -> Float64:
    return np.stack([columns.numbers(n) for n in names], axis=1)


def _stamped(folder: Path, *endings: str) -> dict[int, Path]:
    """Files that are named by a time stamp, in its order."""
    found = (
        {int(p.stem): p for p in folder.iterdir() if p.suffix in endings and p.stem.isdigit()}
        if folder.is_dir()
        else {}
    )
    return dict(sorted(found.items()))


def _boxes(path: Path, poses: _Poses, notices: list[str]) -> tuple[list[float], list[tuple[TrackedBox, ...]]]:
    """Times of the annotations, seconds, and the boxes of each in the city."""
    if not path.is_file():
        notices.append(f"no boxes of objects: {BOXES} is missing")
        return [], []
    sizes = ("length_m", "width_m", "height_m")
    columns = read_columns(path, ("timestamp_ns", "track_uuid", "category", *sizes, *ROTATION, *POSITION))
    stamps = columns.integers("timestamp_ns", "ns").tolist()
    tracks, kinds = columns.words("track_uuid"), columns.words("category")
    numbers = _table(columns, (*sizes, *POSITION, *ROTATION))
    good = np.isfinite(numbers).all(axis=1) & (numbers[:, :3] > 0).all(axis=1) & numbers[:, 6:].any(axis=1)
    ids = TrackIds()
    found: dict[int, dict[int, TrackedBox]] = {}
    places: dict[int, Float64 | None] = {stamp: poses.at(stamp) for stamp in sorted(set(stamps))}
    for i in sorted(range(columns.count), key=lambda i: (stamps[i], tracks[i])):
        pose, name = places[stamps[i]], BOX_CLASSES.get(kinds[i])
        if pose is None:
            continue
        here = found.setdefault(stamps[i], {})
        if name is None or not good[i]:  # type: ignore[index]
            continue
        length, width, height = numbers[i, :3].tolist()
        x, y, z = (pose[:3, :3] @ numbers[i, 3:6] + pose[:3, 3]).tolist()
        ahead = pose[:3, :3] @ quat_to_rotation(numbers[i, 6:])[:, 0]
        number = ids.of(tracks[i])
        box = TrackedBox(number, name, (x, y, z), (length, width, height), math.atan2(ahead[1], ahead[0]))
        here.setdefault(number, box)
    lost = sum(pose is None for pose in places.values())
    if lost:
        notices.append(f"boxes of {lost} sweeps have no pose and are left out")
    return [stamp / 1e9 for stamp in found], [tuple(here.values()) for here in found.values()]


@dataclass(frozen=True, eq=False)
class _Lens:
    size: tuple[int, int]
    focal: tuple[float, float]
    centre: tuple[float, float]
    vehicle_from_camera: Float64


def _lenses(root: Path) -> dict[str, _Lens]:
    extrinsics = read_columns(root / EXTRINSICS, ("sensor_name", *ROTATION, *POSITION))
    quats, positions = _table(extrinsics, ROTATION), _table(extrinsics, POSITION)
    places = {name: i for i, name in enumerate(extrinsics.words("sensor_name"))}
    names = ("fx_px", "fy_px", "cx_px", "cy_px")
    intrinsics = read_columns(root / INTRINSICS, ("sensor_name", "width_px", "height_px", *names))
    k = _table(intrinsics, names).tolist()
    size: NDArray[np.int64] = np.stack([intrinsics.integers(n) for n in ("width_px", "height_px")], axis=1)
    found = {}
    for i, name in enumerate(intrinsics.words("sensor_name")):
        if name in places:
            at = places[name]
            pose = pose_of(quats[at], positions[at], root / EXTRINSICS, f"the pose of {name}")
            found[name] = _Lens((int(size[i, 0]), int(size[i, 1])), (k[i][0], k[i][1]), (k[i][2], k[i][3]), pose)
    return found


def _frames(root: Path, poses: _Poses, boxes: partial[tuple[TrackedBox, ...]], notices: list[str]) -> list[Frame]:
    folder = root / "sensors/cameras"
    images: Mapping[str, dict[int, Path]] = {
        p.name: _stamped(p, ".jpg", ".jpeg", ".png") for p in (sorted(folder.iterdir()) if folder.is_dir() else ())
    }
    images = {name: files for name, files in images.items() if files}
    if not images:
        notices.append("no images: sensors/cameras has none")
        return []
    lenses = _lenses(root)
    found, missed = [], 0
    for camera in sorted(images, key=lambda name: (name != FRONT, name)):
        lens = lenses.get(camera)
        if lens is None:
            notices.append(f"camera {camera} is left out: the calibration does not have it")
            continue
        for stamp, file in images[camera].items():
            pose = poses.at(stamp)
            missed += pose is None
            if pose is None:
                continue
            camera_pose = pose @ lens.vehicle_from_camera
            found.append(
                Frame(
                    name=file.stem,
                    camera_name=camera,
                    camera=calibrated_camera(lens.size, lens.focal, lens.centre, camera_pose, root / INTRINSICS),
                    image_path=file,
                    timestamp=stamp / 1e9,
                    boxes=boxes(stamp / 1e9),
                    ego_rows=round(EGO_ROWS.get(camera, 0) * lens.size[1]),
                )
            )
    if missed:
        notices.append(f"{missed} photographs have no pose and are left out")
    if not found:
        raise DriveError("has no photograph with a pose and a calibration", path=folder, mend="download the log again")
    return found


def _points(path: Path, pose: Float64) -> SweepPoints:
    found = _table(read_columns(path, ("x", "y", "z")), "xyz")
    found = found[np.isfinite(found).all(axis=1)]
    return SweepPoints(found @ pose[:3, :3].T + pose[:3, 3])
