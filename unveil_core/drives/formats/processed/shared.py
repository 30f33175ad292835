"""What the processed layouts share: matrices in text files, boxes from matrices, lenses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from unveil_core.base.checks.numbers_in_names import natural_key
from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox, boxes_at
from unveil_core.drives.drive import Distortion
from unveil_core.drives.formats.cameras import read_numbers, rigid

__all__ = ["Boxes", "Matrices", "boxes_near", "boxes_of_track", "by_numbers", "lens"]

Boxes = dict[int, tuple[TrackedBox, ...]]
"""By frame number."""
MEND = "prepare the scene again"
SAME_CLOCK_S = 1.0
"""Boxes are of a frame, cameras a few hundredths of a second beside it; further apart the time stamps are of other clocks."""


def by_numbers(folder: Path) -> list[Path]:
    """What is in a folder, numbers in names as numbers; nothing of one that is not there."""
    return sorted(folder.iterdir(), key=lambda p: natural_key(p.name)) if folder.is_dir() else []


class Matrices:
    """The matrices and numbers that a scene keeps in text files, read once each.

    Attributes:
        root: folder of the scene. files: those that were read, for digests.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.files: list[Path] = []
        self._read: dict[Path, Float64 | None] = {}

    def numbers(self, path: Path) -> list[float]:
        """All numbers of a file.

        Raises:
            DriveError: missing, or a line that is not numbers.
        """
        self.files.append(path)
        return [v for line in read_numbers(path, MEND) for v in line]

    def matrix(self, relative: str) -> Float64 | None:
        """(4, 4) rigid transform of a file; None where there is no such file.

        Raises:
            DriveError: it holds none.
        """
        path = self.root / relative
        if path not in self._read:
            self._read[path] = rigid(self.numbers(path), path, "the pose") if path.is_file() else None
        return self._read[path]


def boxes_of_track(number: int, class_name: str, poses: Float64, sizes: Float64) -> list[TrackedBox | None]:
    """The boxes of one object.

    Args:
        number: its id; class_name: a Cityscapes class.
        poses: (n, 4, 4) world from object, whose x is forward. sizes: (n, 3) length, width and height, metres.
    Returns:
        one for each pose; None where its numbers make no box.
    """
    found: list[TrackedBox | None] = []
    for pose, size in zip(poses.tolist(), sizes.tolist(), strict=True):
        yaw = math.atan2(pose[1][0], pose[0][0])
        centre = (pose[0][3], pose[1][3], pose[2][3])
        sound = all(math.isfinite(v) for v in (*centre, *size, yaw)) and min(size) > 0
        found.append(TrackedBox(number, class_name, centre, tuple(size), yaw) if sound else None)
    return found


def boxes_near(time: float | None, number: int, stamps: Mapping[int, float], boxes: Boxes) -> tuple[TrackedBox, ...]:
    """The boxes of a frame, moved to the time of its photograph where both are known."""
    around = [n for n in (number - 1, number, number + 1) if n in stamps]
    times = [stamps[n] for n in around]
    if time is None or number not in stamps or abs(time - stamps[number]) > SAME_CLOCK_S or sorted(set(times)) != times:
        return boxes.get(number, ())
    return boxes_at(time, times, [boxes.get(n, ()) for n in around])


def lens(coefficients: Sequence[float]) -> Distortion | None:
    """OpenCV's k1 k2 p1 p2 k3, of which later ones may be left out; None where all are 0."""
    five = (*(float(c) for c in coefficients), *(0.0,) * 8)[:8]
    found = Distortion("OPENCV", five)
    return None if found.is_zero else found
