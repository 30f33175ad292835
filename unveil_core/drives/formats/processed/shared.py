"""What the processed layouts share: boxes from matrices, Waymo's lens, scenes of a folder."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from unveil_core.base.types import Float64
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import Distortion

__all__ = ["boxes_of_track", "lens", "scenes_of"]


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


def lens(coefficients: Sequence[float]) -> Distortion | None:
    """OpenCV's k1 k2 p1 p2 k3, of which later ones may be left out; None where all are 0."""
    five = (*(float(c) for c in coefficients), *(0.0,) * 8)[:8]
    found = Distortion("OPENCV", five)
    return None if found.is_zero else found


def scenes_of(path: Path, is_one: Callable[[Path], bool]) -> list[str]:
    """Names of the scenes in a folder, by number where they are numbers; "." where it is one itself."""
    if not path.is_dir():
        return []
    if is_one(path):
        return ["."]
    return sorted(p.name for p in path.iterdir() if p.is_dir() and is_one(p))
