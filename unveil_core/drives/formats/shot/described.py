"""``shot.json``: what a camera path does not tell of itself. Every key is optional."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json
from unveil_core.drives.drive import Distortion
from unveil_core.drives.scale_and_up import UP_AXES

__all__ = ["FILE", "ORDERS", "ZOOMS", "Described", "described"]

FILE = "shot.json"
ORDERS = tuple("".join(p) for p in permutations("XYZ"))
"""Axes in the order in which a rotation turns about them, the first first."""
ZOOMS = ("vertical_fov", "horizontal_fov", "focal_mm", "none")
"""What the last column of a path may be: degrees, or millimetres."""
LENS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
MOST_NUMBER = 1e9


@dataclass(frozen=True)
class Described:
    """Attributes:
    source: the file that says so, for messages.
    path: of the camera path, as named; plates: a folder, or the name of a file with #### or %04d for the number; points: a file.
    camera: name of the camera.
    frame_offset: number of a plate less that of its frame in the path; None = they are the same, or follow from the counts.
    fps: frames a second, for time stamps.
    rotation_order: one of :data:`ORDERS`; zoom: one of :data:`ZOOMS`.
    focal_mm: where the path has none; sensor_mm: width and height, or the width alone.
    pixel_aspect: width of a pixel over its height; None = as the plates say, else 1.
    units_per_metre: of the path; up: an axis by name, or None for what its format has.
    distortion: of OpenCV; None for a pinhole.
    """

    source: Path | None = None
    path: str | None = None
    plates: str | None = None
    points: str | None = None
    camera: str = "camera"
    frame_offset: int | None = None
    fps: float | None = None
    rotation_order: str = "ZXY"
    zoom: str = "vertical_fov"
    focal_mm: float | None = None
    sensor_mm: tuple[float, float | None] | None = None
    pixel_aspect: float | None = None
    units_per_metre: float | None = None
    up: str | None = None
    distortion: Distortion | None = None


def described(path: Path) -> Described:
    """What a shot.json says.

    Raises:
        DriveError: a key that is not known, or a value that is none.
    """
    content = read_json(path)
    if not isinstance(content, dict):
        raise DriveError("holds no JSON object", path=path, mend="see docs/shots.md")
    unknown = sorted(set(content) - set(READ))
    if unknown:
        raise DriveError(f"Not a known key: {unknown[0][:40]}", path=path, mend=f"keys are {', '.join(READ)}")
    found: dict[str, Any] = {}
    for key, value in content.items():
        wanted, read = READ[key]
        try:
            found["distortion" if key == "lens" else key] = read(value)
        except (TypeError, ValueError, OverflowError, AttributeError) as error:
            raise DriveError(f"Not a value of {key}: {str(value)[:40]!r}", path=path, mend=f"give {wanted}") from error
    return Described(source=path, **found)


def _text(value: object) -> str:
    if not isinstance(value, str) or not value:
        raise ValueError
    return value


def _positive(value: Any) -> float:
    found = float(value)
    if isinstance(value, bool | str) or not 1 / MOST_NUMBER < found < MOST_NUMBER:
        raise ValueError
    return found


def _whole(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or abs(value) > MOST_NUMBER:
        raise ValueError
    return value


def _sensor(value: Any) -> tuple[float, float | None]:
    if isinstance(value, list):
        width, height = value
        return _positive(width), _positive(height)
    return _positive(value), None


def _one_of(*names: str) -> Callable[[object], str]:
    def read(value: object) -> str:
        return names[names.index(str(value))]

    return read


def _lens(value: Any) -> Distortion:
    if set(value) - set(LENS):
        raise ValueError
    numbers = tuple(float(value.get(k, 0.0)) for k in LENS)
    if not all(map(math.isfinite, numbers)):
        raise ValueError
    return Distortion("OPENCV", numbers)


READ: dict[str, tuple[str, Callable[[Any], object]]] = {
    "path": ("the name of the file of the camera path", _text),
    "plates": ("a folder, or a name as plate.####.exr", _text),
    "points": ("the name of a .ply, .obj, .csv or .txt", _text),
    "camera": ("a name", _text),
    "frame_offset": ("a whole number: that of a plate less that of its frame in the path", _whole),
    "fps": ("frames a second", _positive),
    "rotation_order": (f"one of {', '.join(ORDERS)}", _one_of(*ORDERS)),
    "zoom": (f"one of {', '.join(ZOOMS)}", _one_of(*ZOOMS)),
    "focal_mm": ("millimetres", _positive),
    "sensor_mm": ("the width of the sensor in millimetres, or [width, height]", _sensor),
    "pixel_aspect": ("the width of a pixel over its height", _positive),
    "units_per_metre": ("a number, as 100 for centimetres", _positive),
    "up": (f"one of {', '.join(UP_AXES)}", _one_of(*UP_AXES)),
    "lens": (f"an object of OpenCV's numbers: {', '.join(LENS)}", _lens),
}
"""By key, what it wants, and what reads it."""
