"""Sweeps of KITTI's Velodyne: their files, and the motion of the vehicle while the scanner turned."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import LARGEST_FILE, open_file
from unveil_core.base.errors import DriveError
from unveil_core.base.types import Float64
from unveil_core.drives.drive import SweepPoints
from unveil_core.drives.formats.kitti.text import at, neighbours
from unveil_core.geometry.transforms import rigid_inverse

__all__ = ["Motion", "motion_to", "motions", "read_velodyne", "sweep_reader", "turn_seconds", "untwisted"]

TURN_S = 0.1
"""Time of one turn, seconds: the scanner of all KITTI recordings is set to 10 Hz."""
PLAUSIBLE_TURN_S = (0.08, 0.125)
"""Shortest and longest turn that time stamps of a sweep's start and end are believed; else :data:`TURN_S` is taken."""
SPIN = -1
"""The scanner turns clockwise seen from above, against the azimuth, so that what lies to the left is measured first. KITTI's own
readme says counter-clockwise; the devkit of KITTI-360 and odometry that was tried on the raw sweeps take clockwise, as does the
HDL-64E's encoder, whose angle grows from ahead to the right."""
REACH = 10
"""Frames to the next pose at most, where poses are sparse, for a velocity: one second."""
NEAREST_M = 0.9
"""What is nearer is no return but a blank: the least range of an HDL-64E, metres."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Velocity of the scanner, in its own axes: rotation (3,) rad/s and shift (3,) m/s."""

    rotation: Float64 = field(default_factory=lambda: np.zeros(3))
    shift: Float64 = field(default_factory=lambda: np.zeros(3))


def motion_to(here: Float64, there: Float64, seconds: float) -> Motion:
    """The constant velocity that leads from one pose (4, 4) to another one, ``seconds`` later; earlier where negative."""
    step = rigid_inverse(here) @ there
    return Motion(cv2.Rodrigues(step[:3, :3])[0].ravel() / seconds, step[:3, 3] / seconds)


def motions(
    number: int, poses: Mapping[int, Float64], numbers: Sequence[int], stamps: Sequence[float | None]
) -> tuple[Motion, Motion]:
    """Velocities of the scanner just before and just after a sweep, from its poses at the sweeps beside it.

    Args:
        number: of the sweep; poses: (4, 4) of the scanner by number; numbers: those that have one, ascending.
        stamps: seconds by number; where they are missing or do not ascend, sweeps are one turn apart.
    """

    def towards(other: int | None) -> Motion | None:
        if other is None:
            return None
        apart = (other - number) * TURN_S
        a, b = at(stamps, number), at(stamps, other)
        if a is not None and b is not None and 0.5 < (b - a) / apart < 2:
            apart = b - a
        return motion_to(poses[number], poses[other], apart)

    before, after = (towards(other) for other in neighbours(number, numbers, REACH))
    return before or after or Motion(), after or before or Motion()


def turn_seconds(start: float | None, end: float | None) -> float:
    """Time of one turn from the time stamps of its start and end, where they are plausible."""
    if start is not None and end is not None and PLAUSIBLE_TURN_S[0] <= end - start <= PLAUSIBLE_TURN_S[1]:
        return end - start
    return TURN_S


def untwisted(points: Float64, before: Motion, after: Motion, turn_s: float = TURN_S) -> Float64:
    """Points as the scanner would have measured them, had it stood still where it was when it looked ahead.

    A sweep starts and ends behind the vehicle, and has the pose of the moment when the scanner looks ahead: then the cameras are
    triggered. So the azimuth of a point tells how long before or after that moment it was measured.

    Args:
        points: (P, 3) as measured, scanner coordinates: x ahead, y left, z up.
        before, after: velocities in the first and the second half of the turn.
        turn_s: seconds of one turn.
    Returns:
        (P, 3).
    """
    time = SPIN * np.arctan2(points[:, 1], points[:, 0]) / (2 * math.pi) * turn_s
    found = np.empty_like(points)
    for part, motion in ((time < 0, before), (time >= 0, after)):
        some, t = points[part], time[part, None]
        speed = float(np.linalg.norm(motion.rotation))
        if speed > 0:
            axis, angle = motion.rotation / speed, speed * t
            along = (some @ axis)[:, None] * axis
            some = along + np.cos(angle) * (some - along) + np.sin(angle) * np.cross(axis, some)
        found[part] = some + t * motion.shift
    return found


def read_velodyne(path: Path) -> Float64:
    """(P, 3) positions of a sweep in scanner coordinates, metres; blanks and NaN are still among them.

    Raises:
        DriveError: missing, empty or cut short.
    """
    try:
        with open_file(path, LARGEST_FILE) as stream:
            values = np.fromfile(stream, dtype="<f4")
            size = os.fstat(stream.fileno()).st_size
    except OSError as error:
        raise DriveError("Not found, or not readable", path=path, mend="restore it or remove it") from error
    if size % 16 or not size:
        problem = "Cut short" if size else "Empty"
        raise DriveError(problem, path=path, mend="download it again, or remove it: a sweep may be missing")
    return values.reshape(-1, 4)[:, :3].astype(np.float64)


def sweep_reader(
    path: Path,
    pose: Float64,
    *,
    correct: Callable[[Float64], Float64] | None = None,
    classes: Callable[[int], NDArray[np.uint8]] | None = None,
) -> Callable[[], SweepPoints]:
    """What reads one sweep when it is asked for.

    Args:
        pose: (4, 4) from the scanner to the drive's coordinates.
        correct: brings points (P, 3) as measured to that pose, where the file does not have them so.
        classes: reads the trainIds of so many points, where they are labelled.
    """

    def read() -> SweepPoints:
        points = read_velodyne(path)
        labels = None if classes is None else classes(len(points))
        keep = np.isfinite(points).all(axis=1)
        keep[keep] = np.linalg.norm(points[keep], axis=1) > NEAREST_M  # type: ignore[index]
        points = points[keep]
        if correct is not None:
            points = correct(points)
        return SweepPoints(points @ pose[:3, :3].T + pose[:3, 3], None if labels is None else labels[keep])

    return read
