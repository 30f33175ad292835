# SPDX-License-Identifier: GPL-3.0-or-later
"""An imported drive, as the files of its workspace tell it, in Blender's conventions. No bpy here.

Scene coordinates are those of the workspace, z up with an origin amid the cameras, in units of the scene instead of metres.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .open_safely import LARGEST_TEXT, json_in, refuse_links

__all__ = ["FARTHEST", "DriveFrame", "ImportedDrive", "Lens", "file_below", "file_name", "read_drive", "read_json"]

FARTHEST, LONGEST_SIDE = 1e12, 1 << 20
"""Of coordinates, metres or units of the drive, and of a picture, pixels: what is larger is damaged."""
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""From a camera that looks along +z with y down to Blender's, which looks along -z with y up."""


@dataclass(frozen=True)
class Lens:
    """Blender's settings of a camera; ``aspect`` is the pixel aspect (x, y), which is the scene's."""

    focal_mm: float
    shift_x: float
    shift_y: float
    aspect: tuple[float, float]
    sensor_mm: float = 36.0


@dataclass(frozen=True, eq=False)
class DriveFrame:
    """One photograph.

    Attributes:
        name: file stem.
        image: the file that fits behind Blender's camera: the footage, or where that has a lens the undistorted picture.
        width, height: of it, pixels; fx, fy, cx, cy: pixels from the corner of the picture.
        camera_to_scene: (4, 4) float64, of Blender's camera.
        footage: the file as it came; what is delivered has its size and lens.
        in_lens: whether that shows what no camera without a lens does.
        timestamp: seconds, None if the drive does not tell.
    """

    name: str
    image: Path
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    camera_to_scene: np.ndarray
    footage: Path
    in_lens: bool = False
    timestamp: float | None = None

    @property
    def lens(self) -> Lens:
        """With a horizontal sensor fit."""
        ratio = self.fx / self.fy
        return Lens(
            focal_mm=self.fx * 36.0 / self.width,
            shift_x=-(self.cx - self.width / 2) / self.width,
            shift_y=(self.cy - self.height / 2) * ratio / self.width,
            aspect=(1.0, ratio) if ratio >= 1 else (1 / ratio, 1.0),
        )


@dataclass(frozen=True, eq=False)
class ImportedDrive:
    """A drive in scene coordinates. Those of its files are ``units_per_metre / metre * rotation @ scene + offset``.

    Attributes:
        workspace: its folder.
        source: what was imported.
        tracks: frames by camera name, in time.
        offset: (3,) float64; rotation: (3, 3) float64.
        frame_rate: frames a second, None if the drive does not tell.
        metre: units of the scene.
    """

    workspace: Path
    source: str
    tracks: dict[str, tuple[DriveFrame, ...]]
    offset: np.ndarray
    units_per_metre: float
    rotation: np.ndarray
    frame_rate: float | None = None
    metre: float = 1.0

    @property
    def name(self) -> str:
        """For people."""
        path = Path(self.source)
        return path.parent.name if path.suffix else path.name

    def to_drive(self, scene: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the scene in the drive's own coordinates, as its files have them."""
        return scene @ self.rotation.T * (self.units_per_metre / self.metre) + self.offset

    def from_drive(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the drive's own coordinates in the scene."""
        return (points - self.offset) @ self.rotation * (self.metre / self.units_per_metre)


def read_json(path: Path) -> Any:
    """What a file holds, None where it is not there.

    Raises:
        ValueError: it is no JSON; the message names the file.
    """
    try:
        return json_in(path, LARGEST_TEXT)
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: Not readable: {error}") from error


def read_drive(workspace: str | Path, metre: float = 1.0) -> ImportedDrive:
    """The imported drive of a workspace.

    Args:
        metre: units of the scene that it is for.
    Raises:
        ValueError: there is none, or it is damaged, or the workspace holds a link, a pipe or a device; one line that names it.
    """
    workspace = Path(workspace)
    try:
        refuse_links(workspace)
    except OSError as error:
        raise ValueError(f"{error.filename}: Not readable: {error.strerror}") from error
    path = workspace / "drive" / "cameras.json"
    data = read_json(path)
    if data is None:
        raise ValueError(f"{workspace}: No imported drive (import one first)")
    try:
        similarity = data["to_world"]
        offset = np.array(similarity["translation"], np.float64).reshape(3)
        rotation = np.array(similarity["rotation"], np.float64).reshape(3, 3)
        scale = float(similarity["scale"])
        if not (np.abs(offset) < FARTHEST).all() or not 1 / FARTHEST < scale < FARTHEST:
            raise ValueError("its transform to the drive is out of range")
        if not np.isfinite(rotation).all() or np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3:
            raise ValueError("its transform to the drive does not rotate")
        rate = _number(data.get("frame_rate"))
        if rate is not None and not RATES[0] <= rate <= RATES[1]:
            raise ValueError(f"{rate:g} frames a second")
        drive = ImportedDrive(workspace, str(data["source"]), {}, offset, scale, rotation, rate, metre)
        tracks: dict[str, list[DriveFrame]] = {}
        for entry in data["frames"]:
            tracks.setdefault(file_name(entry["camera"]), []).append(_frame(entry, drive))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ValueError(f"{path}: Not an imported drive: {error} (import it again)") from error
    drive.tracks.update({name: tuple(frames) for name, frames in tracks.items()})
    return drive


def _number(value: Any) -> float | None:
    number = None if value is None else float(value)
    if number is not None and not abs(number) <= LATEST_S:
        raise ValueError(f"{number:g} seconds, or frames a second")
    return number


LATEST_S, RATES = 1e19, (1e-3, 1e4)
"""Time stamps, also those of nanoseconds since 1970, and frames a second; others are none."""
DEVICES = re.compile(r"(con|prn|aux|nul|clock\$|conin\$|conout\$|com[0-9¹²³]|lpt[0-9¹²³])(?=[ .]|$)", re.IGNORECASE)
"""Of Windows: who opens one may wait for ever."""
UNSEEN = frozenset(("Cc", "Cf", "Cs", "Zl", "Zp"))
"""Categories of characters that names do not have."""


def file_name(text: object) -> str:
    """The name of one file or folder, as import gives them; others would lead out of the workspace's folders.

    Raises:
        ValueError: it is none.
    """
    name = str(text)
    strange = any(c in '<>:"/\\|?*' or unicodedata.category(c) in UNSEEN for c in name)
    whole = name == name.strip(" .") != "" and not strange
    if not whole or DEVICES.match(name):
        raise ValueError(f"{name[:40]!r} is not a file name")
    return name


def file_below(folder: Path, name: object) -> Path:
    """A file in a folder or below, by its parts with slashes between.

    Raises:
        ValueError: it leads elsewhere.
    """
    return folder.joinpath(*(file_name(part) for part in str(name).split("/")))


def _frame(entry: dict, drive: ImportedDrive) -> DriveFrame:
    pose = np.array(entry["world_to_camera"], dtype=np.float64).reshape(4, 4)
    placed = np.eye(4)
    placed[:3, :3] = pose[:3, :3].T
    placed[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    footage = entry.get("footage", entry)
    in_lens = footage.get("distortion") is not None
    shown = entry if in_lens else footage
    width, height = int(shown["width"]), int(shown["height"])
    lens = [float(shown[key]) for key in ("fx", "fy", "cx", "cy")]
    sound = 1 <= min(width, height) <= max(width, height) < LONGEST_SIDE and (np.abs(placed) < FARTHEST).all()
    placed[:3, 3] *= drive.metre
    if not sound or not (np.abs(lens) < FARTHEST).all() or min(lens[:2]) < 1 / FARTHEST:
        raise ValueError(f"the camera of frame {entry['name']} has no size, focal length or pose")
    return DriveFrame(
        file_name(entry["name"]),
        file_below(drive.workspace / "drive", shown["image"]),
        width,
        height,
        *lens,
        placed @ FLIP,
        file_below(drive.workspace / "drive", footage["image"]),
        in_lens,
        _number(entry.get("timestamp")),
    )
