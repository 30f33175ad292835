"""The tables of a Waymo segment: where they lie, the keys that join them, poses and calibrations.

    <root>/[<split>/]<component>/<segment>.parquet

Rows are in no certain order and tables do not share one, so they are joined by their ``key.`` columns. Transforms are 16 numbers
by rows. The vehicle's x points forward, y left, z up, and so do a camera's: its optical axis is x. Facts:
waymo-research/waymo-open-dataset (``src/waymo_open_dataset/v2``, ``dataset.proto``, ``camera_model.cc``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Distortion
from unveil_core.drives.formats.cameras import rigid
from unveil_core.drives.formats.tables import Columns, read_columns

__all__ = [
    "Laser",
    "Lens",
    "Segment",
    "holds_components",
    "lasers",
    "lenses",
    "segment_at",
    "segments",
    "vehicle_poses",
]

STAMP, CAMERA, LASER, OBJECT = (
    "key.frame_timestamp_micros",
    "key.camera_name",
    "key.laser_name",
    "key.laser_object_id",
)
CONTEXT = "key.segment_context_name"
POSES, IMAGES = "vehicle_pose", "camera_image"
COMPONENTS = (
    POSES,
    IMAGES,
    "camera_calibration",
    "camera_segmentation",
    "lidar",
    "lidar_calibration",
    "lidar_pose",
    "lidar_box",
    "lidar_segmentation",
)
"""The tables that are read; a segment has some ten more."""
NAMES = {
    CAMERA: ("FRONT", "FRONT_LEFT", "FRONT_RIGHT", "SIDE_LEFT", "SIDE_RIGHT", "REAR_LEFT", "REAR", "REAR_RIGHT"),
    LASER: ("TOP", "FRONT", "SIDE_LEFT", "SIDE_RIGHT", "REAR"),
}
"""Of the numbers from 1; the first release wrote the names themselves."""
OPTICAL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""(4, 4) from a camera's axes as OpenCV has them (x right, y down, z forward) to Waymo's."""


@dataclass(frozen=True)
class Segment:
    """One segment: ``name`` and the ``files`` of its components."""

    name: str
    files: dict[str, Path]

    def keys(self, columns: Columns, *kinds: str) -> Iterator[tuple[int, tuple[int | str, ...]]]:
        """The number and the key of each of the segment's rows; a key's row is the first that has it.

        Args:
            columns: with those of ``kinds``, and the segment's name where the table has it.
        """
        parts: list[list[int] | list[str]] = []
        for kind in kinds:
            if kind == STAMP:
                parts.append(columns.integers(kind).tolist())
            else:
                parts.append([_name(word, NAMES.get(kind, ())) for word in columns.words(kind)])
        owners = columns.words(CONTEXT) if CONTEXT in columns else []
        others = self.name in owners  # else the file was renamed and is of one segment
        seen = set()
        for number, key in enumerate(zip(*parts, strict=True)):
            if key not in seen and not (others and owners[number] != self.name):
                seen.add(key)
                yield number, key


def _name(word: str, names: tuple[str, ...]) -> str:
    if names and word.isdigit():
        return names[int(word) - 1] if 1 <= int(word) <= len(names) else word
    return word


def holds_components(folder: Path) -> bool:
    """Whether a folder holds components itself."""
    return any((folder / c).is_dir() for c in (POSES, IMAGES))


def _roots(path: Path) -> list[Path]:
    """Folders that hold components: the path itself, else those of the splits in it."""
    if holds_components(path):
        return [path]
    return [p for p in sorted(path.iterdir()) if p.is_dir() and holds_components(p)] if path.is_dir() else []


def segments(path: Path) -> list[str]:
    """Names of the segments in a folder that have poses or photographs."""
    found = {p.stem for root in _roots(path) for c in (POSES, IMAGES) for p in (root / c).glob("*.parquet")}
    return sorted(found)


def segment_at(path: Path, name: str) -> Segment:
    """The tables of a segment that are there."""
    files: dict[str, Path] = {}
    for root in _roots(path):
        found = {c: root / c / f"{name}.parquet" for c in COMPONENTS}
        files = files or {c: p for c, p in found.items() if p.is_file()}
    return Segment(name, files)


def vehicle_poses(segment: Segment) -> dict[int, Float64]:
    """(4, 4) world from vehicle by the time stamp of the frame, microseconds: of the middle of the LiDAR's turn.

    Raises:
        DriveError: a pose that is no rigid transform.
    """
    path = segment.files.get(POSES)
    if path is None:
        return {}
    column = "[VehiclePoseComponent].world_from_vehicle.transform"
    columns = read_columns(path, (STAMP, column), (CONTEXT,))
    numbers = columns.vectors(column, 16)
    return {int(stamp): rigid(numbers[i], path, f"the pose at {stamp}") for i, (stamp,) in segment.keys(columns, STAMP)}


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera's calibration.

    Attributes:
        size: width and height, pixels.
        focal, centre: pixels, the centre as OpenCV counts it.
        distortion: of its lens.
        vehicle_from_camera: (4, 4), the camera with OpenCV's axes.
    """

    size: tuple[int, int]
    focal: tuple[float, float]
    centre: tuple[float, float]
    distortion: Distortion | None
    vehicle_from_camera: Float64


def lenses(segment: Segment) -> dict[str, Lens]:
    """Calibrations of the cameras, by name.

    Raises:
        DriveError: the table is missing, or numbers that make no camera.
    """
    path = segment.files.get("camera_calibration")
    if path is None:
        raise DriveError("has photographs but no camera_calibration", path=_beside(segment), mend="download it, too")
    prefix = "[CameraCalibrationComponent]"
    extrinsic, sides = f"{prefix}.extrinsic.transform", (f"{prefix}.width", f"{prefix}.height")
    inner = [f"{prefix}.intrinsic.{n}" for n in ("f_u", "f_v", "c_u", "c_v")]
    bent = [f"{prefix}.intrinsic.{n}" for n in ("k1", "k2", "p1", "p2", "k3")]
    columns = read_columns(path, (CAMERA, extrinsic, *sides, *inner), (CONTEXT, *bent))
    k = np.stack([columns.numbers(n) for n in inner], axis=1)
    coefficients = np.zeros((columns.count, len(bent)))
    for j, name in enumerate(bent):
        if name in columns:
            coefficients[:, j] = np.nan_to_num(columns.numbers(name))
    poses, size = columns.vectors(extrinsic, 16), np.stack([columns.integers(n) for n in sides], axis=1)
    found = {}
    for i, (key,) in segment.keys(columns, CAMERA):
        camera = str(key)
        pose = rigid(poses[i], path, f"the extrinsic of camera {camera}") @ OPTICAL
        distortion = Distortion("OPENCV", tuple(coefficients[i].tolist()))
        # Waymo's pixel 0 is the left edge of the first pixel, not its centre.
        centre = (float(k[i, 2]) - 0.5, float(k[i, 3]) - 0.5)
        found[camera] = Lens(
            (int(size[i, 0]), int(size[i, 1])),
            (float(k[i, 0]), float(k[i, 1])),
            centre,
            None if distortion.is_zero else distortion,
            pose,
        )
    return found


@dataclass(frozen=True, eq=False)
class Laser:
    """A LiDAR's calibration.

    Attributes:
        vehicle_from_laser: (4, 4).
        lowest, highest: inclination of the beams where they are evenly spread, radians.
        inclinations: (H,) of each beam, ascending; None where they are evenly spread.
    """

    vehicle_from_laser: Float64
    lowest: float
    highest: float
    inclinations: NDArray[np.float64] | None


def lasers(segment: Segment) -> dict[str, Laser]:
    """Calibrations of the LiDARs, by name; none where the table is missing.

    Raises:
        DriveError: an extrinsic that is no rigid transform.
    """
    path = segment.files.get("lidar_calibration")
    if path is None:
        return {}
    prefix = "[LiDARCalibrationComponent]"
    extrinsic, beams = f"{prefix}.extrinsic.transform", f"{prefix}.beam_inclination"
    spread = (f"{beams}.min", f"{beams}.max")
    columns = read_columns(path, (LASER, extrinsic), (CONTEXT, *spread, f"{beams}.values"))
    poses, each = columns.vectors(extrinsic, 16), [None] * columns.count
    if f"{beams}.values" in columns:
        each = columns.lists(f"{beams}.values")  # type: ignore[assignment]
    low, high = (columns.numbers(n) if n in columns else np.full(columns.count, np.nan) for n in spread)
    return {
        str(name): Laser(
            rigid(poses[i], path, f"the extrinsic of laser {name}"),
            float(low[i]),
            float(high[i]),
            None if each[i] is None or not len(each[i]) else np.asarray(each[i], dtype=np.float64),  # type: ignore[arg-type]
        )
        for i, (name,) in segment.keys(columns, LASER)
    }


def _beside(segment: Segment) -> Path:
    return next(iter(segment.files.values())).parent.parent
