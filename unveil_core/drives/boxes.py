"""Boxes of tracked objects, as a drive may give them per frame: the same id in several frames is one object on its way."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.errors import DriveError
from unveil_core.geometry.similarity import Similarity

__all__ = ["TrackedBox", "between", "boxes_at", "has_moved", "read_boxes"]

MEND = "a box is {id, class, centre: [x, y, z], size: [length, width, height], yaw}, metres and radians"

MOVED_SHARE, MOVED_M = 0.25, 0.3
"""An object moved if its box did by more than this share of its length plus this many metres: annotated boxes wander a little."""


@dataclass(frozen=True)
class TrackedBox:
    """An upright box around one object at the time of one frame.

    Attributes:
        id: of the object, 1 to 65535, the same in all frames.
        class_name: a Cityscapes class (checked where it is used).
        centre: (3,) of the box.
        size: length, width, and height, which is along the drive's up.
        yaw: of the length, radians about the up axis, counterclockwise seen from above; 0 along x where z is up, else along x
            made level (see :func:`unveil_core.geometry.axes.upright`).
    """

    id: int
    class_name: str
    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    yaw: float

    def to_local(self, to_world: Similarity) -> TrackedBox:
        """The box of a drive's files in local coordinates. Its yaw stays: it counts from what becomes x."""
        x, y, z = (float(v) for v in to_world.to_local(self.centre))
        length, width, height = (v / to_world.scale for v in self.size)
        return TrackedBox(self.id, self.class_name, (x, y, z), (length, width, height), self.yaw)

    def local(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """(P, 3) of points in the box's own axes, in half sizes: inside are those in [-1, 1]."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        x, y, z = (points - np.asarray(self.centre)).T
        turned = np.stack([x * cos + y * sin, -x * sin + y * cos, z], axis=1)
        return turned / (np.asarray(self.size) / 2)

    def corners(self) -> NDArray[np.float64]:
        """(8, 3) world positions."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * np.asarray(self.size) / 2
        turned = np.stack(
            [signs[:, 0] * cos - signs[:, 1] * sin, signs[:, 0] * sin + signs[:, 1] * cos, signs[:, 2]], 1
        )
        return turned + np.asarray(self.centre)

    def to_json(self) -> dict[str, object]:
        """As :func:`read_boxes` reads it."""
        return {
            "id": self.id,
            "class": self.class_name,
            "centre": list(self.centre),
            "size": list(self.size),
            "yaw": self.yaw,
        }


def _three(value: object) -> tuple[float, float, float]:
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 3:
        raise ValueError("three numbers are wanted")
    x, y, z = (float(v) for v in value)
    return x, y, z


def _box(entry: Any) -> TrackedBox:
    number, name = entry["id"], str(entry["class"])
    if isinstance(number, bool) or not isinstance(number, int) or not 0 < number < 65536:
        raise ValueError(f"not an id from 1 to 65535: {number!r}")
    if not name:
        raise ValueError("its class is empty")
    box = TrackedBox(number, name, _three(entry["centre"]), _three(entry["size"]), float(entry.get("yaw", 0.0)))
    if not all(math.isfinite(v) for v in (*box.centre, *box.size, box.yaw)):
        raise ValueError("a number is not finite")
    if min(box.size) <= 0:
        raise ValueError(f"size {list(box.size)} is not positive")
    return box


def read_boxes(entries: object, path: Path, frame: str) -> tuple[TrackedBox, ...]:
    """The checked boxes of one frame.

    Args:
        entries: the list of the file, None = none.
        path: of the file, for messages; frame: its name.
    Raises:
        DriveError: not a list of boxes, a size or number that makes no box, or an id used twice.
    """
    if entries is None:
        return ()
    if not isinstance(entries, list):
        raise DriveError(f"Not a list: the boxes of frame {frame}", path=path, mend=MEND)
    boxes: list[TrackedBox] = []
    for i, entry in enumerate(entries):
        try:
            boxes.append(_box(entry))
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            problem = f"lacks {error}" if isinstance(error, KeyError) else str(error)
            raise DriveError(f"box {i} of frame {frame}: {problem}", path=path, mend=MEND) from error
    if len({b.id for b in boxes}) < len(boxes):
        raise DriveError(
            f"frame {frame} has two boxes of one id",
            path=path,
            mend="an id stands for one object and occurs once a frame",
        )
    return tuple(boxes)


def has_moved(boxes: Sequence[TrackedBox]) -> bool:
    """Whether an object moved between some of its boxes."""
    reach = float(np.linalg.norm(np.ptp([b.centre for b in boxes], axis=0)))
    return reach > MOVED_SHARE * max(max(b.size[:2]) for b in boxes) + MOVED_M


def boxes_at(time: float, stamps: Sequence[float], boxes: Sequence[Sequence[TrackedBox]]) -> tuple[TrackedBox, ...]:
    """The boxes at a time, interpolated between annotations before and after it; outside of them the nearest.

    Args:
        time: seconds; stamps: of the annotations, ascending; boxes: of each.
    """
    if not stamps:
        return ()
    k = bisect.bisect_left(stamps, time)
    if k == 0 or k == len(stamps):
        return tuple(boxes[min(k, len(stamps) - 1)])
    share = (time - stamps[k - 1]) / (stamps[k] - stamps[k - 1])
    later = {b.id: b for b in boxes[k]}
    nearest = boxes[k - 1] if share < 0.5 else boxes[k]
    earlier = {b.id: b for b in boxes[k - 1]}
    return tuple(
        between(earlier[b.id], later[b.id], share) if b.id in earlier and b.id in later else b for b in nearest
    )


def between(a: TrackedBox, b: TrackedBox, share: float) -> TrackedBox:
    """The box of an object at a share of the time from one box to another; before the first where it is negative, after the second
    where it is over 1.

    In plain numbers: datasets ask for hundreds of thousands of boxes, for which small arrays are slow.
    """
    turn = (b.yaw - a.yaw + math.pi) % (2 * math.pi) - math.pi
    rest = 1 - share
    (x0, y0, z0), (x1, y1, z1) = a.centre, b.centre
    (length0, width0, height0), (length1, width1, height1) = a.size, b.size
    centre = (rest * x0 + share * x1, rest * y0 + share * y1, rest * z0 + share * z1)
    size = (rest * length0 + share * length1, rest * width0 + share * width1, rest * height0 + share * height1)
    return TrackedBox(a.id, a.class_name, centre, size, a.yaw + share * turn)
