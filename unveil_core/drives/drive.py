"""A drive in memory: frames with cameras and label files, points, and the way back to the coordinates of its files.

Every reader (transforms.json, COLMAP, …) returns a :class:`Drive`; importing one into a workspace undistorts it and brings it
to metres, z up and a local origin, and the imported copy opens as a :class:`Drive` again, so that all later stages know one type.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.numbers_in_names import counting_numbers
from unveil_core.base.plates.colours import PlateColours
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.labels.codes import LabelCodes
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.similarity import Similarity

__all__ = [
    "LATEST_S",
    "RATES",
    "Distortion",
    "Drive",
    "Footage",
    "Frame",
    "FrameLabels",
    "PointCloud",
    "Sweep",
    "SweepPoints",
    "frames_per_second",
    "is_frame_rate",
    "instants",
    "tracks",
]

LATEST_S = 1e19
"""Time stamps lie within: those in nanoseconds since 1970, too."""
MOST_EXACT = 10**15
"""Numbers that double precision tells apart."""
RATES = 1e-3, 1e4
"""Frames a second that cameras take."""


@dataclass(frozen=True)
class Distortion:
    """OpenCV lens distortion; ``model`` is ``"OPENCV"`` (k1 k2 p1 p2 k3 k4 k5 k6) or ``"OPENCV_FISHEYE"`` (k1 k2 k3 k4)."""

    model: str
    coefficients: tuple[float, ...]

    @property
    def is_zero(self) -> bool:
        """True where the lens is a pinhole and nothing needs undistorting (a fisheye never is)."""
        return self.model == "OPENCV" and not any(self.coefficients)


@dataclass(frozen=True, eq=False)
class FrameLabels:
    """Labels of one photograph, decoded from a dataset's own encoding.

    Attributes:
        semantic: (H, W) uint8 Cityscapes trainIds, 255 void.
        instance: (H, W) uint16 instance ids, 0 none; None where the dataset has none.
        ego: (H, W) bool, pixels that show the ego vehicle; None likewise.
    """

    semantic: NDArray[np.uint8]
    instance: NDArray[np.uint16] | None = None
    ego: NDArray[np.bool_] | None = None


@dataclass(frozen=True, eq=False)
class Footage:
    """A photograph as it came, beside the undistorted one of working size that was made of it.

    Attributes:
        path: of the file.
        camera: of the file's own size, with the frame's pose; its pinhole is that of ``distortion``.
        distortion: of its lens, None for a pinhole.
        plate: what its numbers mean, where it is an OpenEXR or DPX file.
    """

    path: Path
    camera: Camera
    distortion: Distortion | None = None
    plate: PlateColours | None = None


@dataclass(frozen=True, eq=False)
class Frame:
    """One photograph of the drive.

    Attributes:
        name: the file stem, unique within its camera.
        camera_name: the track that this frame belongs to ("camera" where the drive has only one).
        camera: intrinsics and pose; pose in the drive's local coordinates.
        image_path: the photograph.
        distortion: lens distortion of the file on disk, None once undistorted.
        semantic_path: picture of classes, or None. instance_path: of instance ids, or None. mask_path: of what is removed, or None.
            ``drives.labels.reading`` reads them.
        codes: what these pictures hold; imported ones Cityscapes trainIds (255 void), ids (0 none) and 0 = remove.
        depth_path: depth file named by the drive, or None.
        timestamp: seconds, or None.
        boxes: of tracked objects at this frame's time, where the drive has any.
        labels: reads the labels of a dataset that keeps them in an encoding of its own; None where it has none.
        image_bytes: reads the encoded photograph where ``image_path`` names a file that holds many; its suffix tells the
            encoding all the same, and its stem the frame.
        ego_path: 8-bit PNG of an imported drive, 255 where the photograph shows the ego vehicle; None where nowhere.
        footage: of an imported drive, the file that the photograph was made of; None where it is that file.
        ego_rows: lowest rows of the photograph that show the ego vehicle, where the dataset is known to have such.
        plate: what the numbers of the photograph mean, where that is an OpenEXR or DPX file.
    """

    name: str
    camera_name: str
    camera: Camera
    image_path: Path
    distortion: Distortion | None = None
    semantic_path: Path | None = None
    instance_path: Path | None = None
    mask_path: Path | None = None
    depth_path: Path | None = None
    timestamp: float | None = None
    boxes: tuple[TrackedBox, ...] = ()
    labels: Callable[[], FrameLabels] | None = None
    image_bytes: Callable[[], bytes] | None = None
    ego_path: Path | None = None
    footage: Footage | None = None
    ego_rows: int = 0
    codes: LabelCodes = field(default_factory=LabelCodes)
    plate: PlateColours | None = None

    @property
    def footage_path(self) -> Path:
        """The file as it came: of the footage, or the photograph where that is it."""
        return self.image_path if self.footage is None else self.footage.path


@dataclass(frozen=True, eq=False)
class PointCloud:
    """LiDAR or SfM points.

    Attributes:
        positions: (P, 3) float64.
        colors: (P, 3) uint8, or None.
        measured: their file has what only laser scanners write.
        classes: (P,) uint8 Cityscapes trainIds, 255 unknown; None where nothing labels them.
        moving: (P,) bool, points that lay in the box of a dynamic object when they were measured; None = none did.
    """

    positions: NDArray[np.float64]
    colors: NDArray[np.uint8] | None = None
    measured: bool = False
    classes: NDArray[np.uint8] | None = None
    moving: NDArray[np.bool_] | None = None

    def select(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> PointCloud:
        """The points of a mask (P,) or at indices (M,)."""

        def part(values: NDArray[Any] | None) -> Any:
            return None if values is None else values[keep]

        return PointCloud(self.positions[keep], part(self.colors), self.measured, part(self.classes), part(self.moving))


@dataclass(frozen=True, eq=False)
class SweepPoints:
    """Points of one sweep.

    Attributes:
        positions: (P, 3) float64 in the drive's coordinates.
        classes: (P,) uint8 Cityscapes trainIds, 255 unknown; None where the dataset does not label this sweep.
    """

    positions: NDArray[np.float64]
    classes: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class Sweep:
    """One turn of a LiDAR, read when it is asked for: a drive's sweeps do not fit into memory together.

    Attributes:
        path: of its file, for messages and digests.
        read: its points. Raises DriveError.
        timestamp: seconds, or None.
        boxes: of tracked objects at the sweep's time.
        annotated: its moment was annotated; False where the boxes are interpolated, in datasets that distinguish them.
    """

    path: Path
    read: Callable[[], SweepPoints]
    timestamp: float | None = None
    boxes: tuple[TrackedBox, ...] = ()
    annotated: bool = True


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive: frames in the order of travel, points, and how its coordinates lie in those of its files.

    Attributes:
        root: folder or file it was read from.
        frames: frames in order of travel (per camera in time order).
        points: LiDAR or SfM points; empty in a drive with sweeps until it is imported.
        sweeps: of its LiDARs, in order of time.
        to_world: from the coordinates of cameras, points and boxes to those of the files; before import the identity, or what files
            say that they leave out.
        units_per_metre: of these coordinates; None where the files do not tell. 1 once imported.
        scale_source: how the scale is known, see :class:`unveil_core.drives.scale_and_up.Placement`.
        up: (3,) unit vector; None where the files do not tell. z once imported.
        up_source: how up is known, likewise.
        semantic_classes: "cityscapes" or None.
        truth_root: folder of the true empty street, or None.
        sources: the files that it was read from, beside those of the frames and sweeps.
        front_cameras: names of the cameras that are read unless others are asked for; none = all.
        notices: what a user should know of how it was read, one line each.
        frame_rate: of its cameras, frames a second, from their time stamps; None where they have none. Set by import.
        key_frames: names of the annotated frames, where a dataset distinguishes them; None = all.
        pose_convention: in which the poses of its files were read, one of ``base.drive_options.POSE_CONVENTIONS``.
        keeps_origin: its origin stays that of its files, for a scene that they were made in and that results go back to.
    """

    root: Path
    frames: tuple[Frame, ...]
    points: PointCloud
    to_world: Similarity = field(default_factory=Similarity)
    units_per_metre: float | None = 1.0
    scale_source: str = "metric"
    up: NDArray[np.float64] | None = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    up_source: str = "drive"
    semantic_classes: str | None = None
    truth_root: Path | None = None
    sources: tuple[Path, ...] = ()
    sweeps: tuple[Sweep, ...] = ()
    front_cameras: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()
    frame_rate: float | None = None
    key_frames: frozenset[str] | None = None
    pose_convention: str = "opencv"
    keeps_origin: bool = False


def tracks(drive: Drive) -> list[list[int]]:
    """Frame indices by camera, in order of travel."""
    names = list(dict.fromkeys(f.camera_name for f in drive.frames))
    return [[i for i, f in enumerate(drive.frames) if f.camera_name == n] for n in names]


def instants(frames: Sequence[Frame]) -> NDArray[np.float64]:
    """(N,) when each frame was taken, comparable between the cameras of a rig.

    Its time stamp where all frames have one. Else the number in its name, where the names of each camera count by one that rises
    along its track and all cameras share a range of: frames of one moment have one number, also where a camera has fewer of them.
    Else its place in its track.
    """
    if all(f.timestamp is not None for f in frames):
        return np.array([f.timestamp for f in frames], dtype=np.float64)
    places = np.zeros(len(frames))
    numbers = np.full(len(frames), np.nan)
    first, last = [], []
    for camera in dict.fromkeys(f.camera_name for f in frames):
        track = [i for i, f in enumerate(frames) if f.camera_name == camera]
        places[track] = np.arange(len(track))
        counted = counting_numbers([frames[i].name for i in track])
        if counted is not None and max(counted) < MOST_EXACT:
            numbers[track] = counted
        first.append(numbers[track[0]])
        last.append(numbers[track[-1]] if (np.diff(numbers[track]) > 0).all() else np.nan)
    # What is no number is NaN, and so is the comparison.
    return numbers - np.min(first) if np.max(first) <= np.min(last) else places


def frames_per_second(frames: Sequence[Frame]) -> float | None:
    """Of one camera, by the median of the steps between its time stamps; None where they do not tell."""
    stamps = [f.timestamp for f in frames if f.timestamp is not None]
    if len(stamps) < len(frames):
        return None
    steps = [b - a for a, b in zip(stamps[:-1], stamps[1:], strict=True) if b > a]
    rate = round(1.0 / float(np.median(steps)), 3) if steps else 0.0
    return rate if is_frame_rate(rate) else None


def is_frame_rate(rate: float) -> bool:
    """Whether a camera may take so many frames a second; what follows from time stamps that are none may be anything."""
    return RATES[0] <= rate <= RATES[1]
