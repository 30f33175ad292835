"""A short drive in memory that the writers beside it write in the encoding of each dataset."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.drives.boxes import TrackedBox

__all__ = [
    "OPENCV_AXES",
    "OPENCV_FROM_WAYMO",
    "Street",
    "rigid",
    "saved",
    "tiny_street",
    "transformed",
    "turned_about_z",
]

Array = NDArray[np.float64]
OPENCV_AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""From a camera (x right, y down, z ahead) to what looks where it does with x ahead, y left, z up."""
OPENCV_FROM_WAYMO = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
CAMERA_HEIGHT_M, CAMERA_AHEAD_M = 1.5, 1.4
"""Of the camera in the vehicle's axes, whose origin is on the ground amid the rear axle."""


def rigid(turn: NDArray[np.float64], shift: Sequence[float] | NDArray[np.float64]) -> Array:
    """(4, 4) of a rotation and a translation."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, shift
    return pose


def turned_about_z(yaw: float) -> Array:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def transformed(pose: Array, points: Array) -> Array:
    """(P, 3) by a pose (4, 4)."""
    return points @ pose[:3, :3].T + pose[:3, 3]


def saved(path: Path, image: NDArray[np.generic]) -> None:
    """Write a picture, in BGR where it has colours."""
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image, [cv2.IMWRITE_JPEG_QUALITY, 95])


@dataclass(frozen=True, eq=False)
class Street:
    """A drive of one camera past things that stand still.

    Attributes:
        images: (H, W, 3) uint8 each, BGR.
        semantics: (H, W) uint8 trainIds each; instances: (H, W) uint16 ids of the boxes each, 0 none.
        poses: (N, 4, 4) world from camera with OpenCV's axes; the world is z up, metres.
        focal: pixels; centre: pixels from the edge of the first pixel.
        times: (N,) seconds.
        points: (P, 3) in the world; kinds: (P,) their trainIds; colors: (P, 3) uint8.
        boxes: around the objects.
    """

    images: list[NDArray[np.uint8]]
    semantics: list[NDArray[np.uint8]]
    instances: list[NDArray[np.uint16]]
    poses: Array
    focal: float
    centre: tuple[float, float]
    times: Array
    points: Array
    kinds: NDArray[np.uint8]
    colors: NDArray[np.uint8]
    boxes: tuple[TrackedBox, ...]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the photographs."""
        height, width = self.images[0].shape[:2]
        return width, height

    @property
    def count(self) -> int:
        return len(self.images)

    @property
    def vehicle_from_camera(self) -> Array:
        """(4, 4); the vehicle has x ahead, y left, z up, and is level at the first frame."""
        ahead = self.poses[0][:3, 2]
        level = turned_about_z(np.arctan2(ahead[1], ahead[0]))
        return rigid(level.T @ self.poses[0][:3, :3], (CAMERA_AHEAD_M, 0.0, CAMERA_HEIGHT_M))

    @property
    def vehicles(self) -> Array:
        """(N, 4, 4) world from vehicle."""
        return self.poses @ np.linalg.inv(self.vehicle_from_camera)

    def calibration(self, *, from_first_centre: bool = True) -> Array:
        """(3, 3), its centre counted from the centre of the first pixel, or from its edge."""
        shift = 0.5 if from_first_centre else 0.0
        return np.array([
            [self.focal, 0, self.centre[0] - shift], [0, self.focal, self.centre[1] - shift], [0, 0, 1.0]
        ])  # fmt: skip

    def sweep(self, i: int) -> tuple[Array, NDArray[np.uint8]]:
        """Points and classes of the sweep at frame i, in the world: the sweeps share the points out among them."""
        return self.points[i :: self.count], self.kinds[i :: self.count]

    def moved(self, turn: Array, shift: Array) -> Street:
        """The street in a world that is turned, about z only where its boxes are to stay right, then shifted."""
        pose = rigid(turn, shift)
        yaw = float(np.arctan2(turn[1, 0], turn[0, 0]))
        boxes = tuple(
            TrackedBox(b.id, b.class_name, tuple(transformed(pose, np.array(b.centre)).tolist()), b.size, b.yaw + yaw)
            for b in self.boxes
        )
        return Street(
            self.images, self.semantics, self.instances, pose @ self.poses, self.focal, self.centre, self.times,
            transformed(pose, self.points), self.kinds, self.colors, boxes,
        )  # fmt: skip

    def local_boxes(self, pose: Array) -> list[tuple[TrackedBox, Array]]:
        """The boxes, and the pose (4, 4) of each in what lies at ``pose`` in the world."""
        back = np.linalg.inv(pose)
        return [(b, back @ rigid(turned_about_z(b.yaw), b.centre)) for b in self.boxes]


def tiny_street(count: int = 4) -> Street:
    """A street of 48x32 pixels far from the origin: road, a house, a car and a person, drawn as what lies where."""
    generator = np.random.default_rng(0)
    width, height = 48, 32
    poses, images, semantics, instances = [], [], [], []
    for i in range(count):
        level = turned_about_z(0.6 + 0.01 * i) @ OPENCV_AXES
        poses.append(rigid(level, (4100.0 + 1.1 * i, -2300.0 + 0.7 * i, 31.5)))
        images.append(cv2.GaussianBlur(generator.integers(0, 255, (height, width, 3), dtype=np.uint8), (0, 0), 3))
        label = np.zeros((height, width), np.uint8)
        label[:12], label[10:14, 30:] = 10, 2
        label[14:22, 6:16] = 13
        semantics.append(label)
        instances.append(np.where(label == 13, 1, 0).astype(np.uint16))
    start = rigid(turned_about_z(0.6), poses[0][:3, 3] - (0, 0, 1.5))
    road = np.column_stack([generator.uniform((4, -4), (30, 4), (300, 2)), generator.normal(0, 0.01, 300)])
    house = np.column_stack([generator.uniform(5, 30, 200), np.full(200, -7.0), generator.uniform(0, 6, 200)])
    boxes, parts, kinds = [], [road, house], [np.zeros(300, np.uint8), np.full(200, 2, np.uint8)]
    for number, (name, kind, at, size) in enumerate(
        (("car", 13, (12.0, 3.0, 0.75), (4.4, 1.8, 1.5)), ("person", 11, (9.0, -3.0, 0.85), (0.7, 0.6, 1.7))), 1
    ):
        parts.append(np.array(at) + generator.uniform(-0.45, 0.45, (80, 3)) * size)
        kinds.append(np.full(80, kind, np.uint8))
        centre = transformed(start, np.array(at))
        boxes.append(TrackedBox(number, name, tuple(centre.tolist()), size, 0.6))
    points = transformed(start, np.concatenate(parts))
    order = generator.permutation(len(points))
    return Street(
        images, semantics, instances, np.stack(poses), 40.0, (23.7, 16.2), 0.1 * np.arange(count),
        points[order], np.concatenate(kinds)[order], np.full((len(points), 3), 120, np.uint8), tuple(boxes),
    )  # fmt: skip
