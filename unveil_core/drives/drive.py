"""A drive in memory: frames with cameras and label files, points, and the way back to the coordinates of its files.

Every reader (transforms.json, COLMAP, …) returns a :class:`Drive`; importing one into a workspace undistorts it and brings it
to metres, z up and a local origin, and the imported copy opens as a :class:`Drive` again, so that all later stages know one type.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.drives.boxes import TrackedBox
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.similarity import Similarity

__all__ = ["Distortion", "Drive", "Frame", "PointCloud", "tracks"]


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
class Frame:
    """One photograph of the drive.

    Attributes:
        name: the file stem, unique within its camera.
        camera_name: the track that this frame belongs to ("camera" where the drive has only one).
        camera: intrinsics and pose; pose in the drive's local coordinates.
        image_path: the photograph.
        distortion: lens distortion of the file on disk, None once undistorted.
        semantic_path: 8-bit PNG of Cityscapes trainIds (255 void), or None.
        instance_path: 16-bit PNG of instance ids (0 none), or None.
        mask_path: 8-bit PNG, 0 = remove, or None.
        depth_path: depth file named by the drive, or None.
        timestamp: seconds, or None.
        boxes: of tracked objects at this frame's time, where the drive has any.
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


@dataclass(frozen=True, eq=False)
class PointCloud:
    """LiDAR or SfM points: ``positions`` (P, 3) float64, ``colors`` (P, 3) uint8 or None; ``measured`` where their file has what
    only laser scanners write."""

    positions: NDArray[np.float64]
    colors: NDArray[np.uint8] | None = None
    measured: bool = False


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive: frames in the order of travel, points, and how its coordinates lie in those of its files.

    Attributes:
        root: folder or file it was read from.
        frames: frames in order of travel (per camera in time order).
        points: LiDAR or SfM points.
        to_world: from the coordinates of cameras, points and boxes to those of the files; identity before import.
        units_per_metre: of these coordinates; None where the files do not tell. 1 once imported.
        scale_source: how the scale is known, see :class:`unveil_core.drives.placement.Placement`.
        up: (3,) unit vector; None where the files do not tell. z once imported.
        up_source: how up is known, likewise.
        semantic_classes: "cityscapes" or None.
        truth_root: folder of the true empty street, or None.
        sources: the files that it was read from, beside those of the frames.
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


def tracks(drive: Drive) -> list[list[int]]:
    """Frame indices by camera, in order of travel."""
    names = list(dict.fromkeys(f.camera_name for f in drive.frames))
    return [[i for i, f in enumerate(drive.frames) if f.camera_name == n] for n in names]
