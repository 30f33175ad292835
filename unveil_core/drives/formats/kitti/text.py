"""The text files of KITTI: calibrations, time stamps, rectified projections; and files that are named by a number."""

from __future__ import annotations

import bisect
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_text
from unveil_core.base.types import Float64
from unveil_core.drives.checks.sizes import calibration_size, is_clean_ratio
from unveil_core.drives.formats.cameras import calibrated_camera, picture_size, rigid
from unveil_core.geometry.camera import Camera

__all__ = [
    "PICTURES",
    "RectifiedLens",
    "absolute",
    "at",
    "left_out",
    "neighbours",
    "numbered",
    "pictures",
    "read_calibration",
    "read_size",
    "read_stamps",
    "rectified_lens",
    "usable_pose",
]

PICTURES = (".png", ".jpg", ".jpeg")
"""Endings of photographs: KITTI has PNG, copies that save space have JPEG."""


def absolute(path: Path) -> Path:
    """The path without ``.`` and ``..``, so that it has the parents that its name says; links are kept."""
    return Path(os.path.abspath(path))


def numbered(folder: Path, endings: Sequence[str]) -> dict[int, Path]:
    """Files that are named by a number, by that number, ascending; of several endings the first found is taken."""
    found: dict[int, Path] = {}
    if folder.is_dir():
        with os.scandir(folder) as entries:
            for entry in entries:
                stem, ending = os.path.splitext(entry.name)
                if ending.lower() in endings and stem.isascii() and stem.isdigit():
                    found.setdefault(int(stem), folder / entry.name)
    return dict(sorted(found.items()))


def pictures(folder: Path) -> dict[int, Path]:
    """The photographs in a folder by number."""
    return numbered(folder, PICTURES)


def read_calibration(path: Path, counts: Mapping[str, int], mend: str) -> dict[str, Float64]:
    """Entries of a calibration file, of lines ``key: numbers``. Lines that hold something else, as a date, are left out.

    Args:
        counts: the keys that are wanted, and how many numbers each has.
        mend: what to do where the file is missing or lacks one.
    Returns:
        arrays of that many numbers.
    Raises:
        DriveError: the file or a key is missing, or a key has other than so many finite numbers.
    """
    lines = read_text(path, mend).splitlines()
    found: dict[str, Float64] = {}
    for line in lines:
        key, _, rest = line.partition(":")
        if key.strip() in counts:
            try:
                found[key.strip()] = np.array([float(word) for word in rest.split()])
            except ValueError as error:
                raise DriveError(f"Not numbers: {key.strip()}: {error}", path=path, mend=mend) from error
    for key, count in counts.items():
        if key not in found:
            raise DriveError(f"lacks the key {key}", path=path, mend=mend)
        if len(found[key]) != count or not np.isfinite(found[key]).all():
            raise DriveError(f"Not {count} finite numbers: {key}", path=path, mend=mend)
    return found


def read_stamps(path: Path) -> list[float | None]:
    """Seconds of each line of a file of dates ``YYYY-MM-DD HH:MM:SS.nnnnnnnnn``; None for empty lines, [] without a file.

    Raises:
        DriveError: a line that is no date.
    """
    if not path.is_file():
        return []
    stamps: list[float | None] = []
    try:
        for line in read_text(path).splitlines():
            whole, _, fraction = line.strip().partition(".")
            if not whole:
                stamps.append(None)
                continue
            # Their nanoseconds are more digits than a datetime keeps.
            date = datetime.fromisoformat(whole).replace(tzinfo=UTC)
            stamps.append(date.timestamp() + (float(f"0.{fraction}") if fraction else 0.0))
    except (OSError, ValueError) as error:
        problem = f"Not a time stamp: line {len(stamps) + 1}: {error}"
        raise DriveError(problem, path=path, mend="download it again") from error
    return stamps


def usable_pose(numbers: Sequence[float] | Float64, path: Path) -> Float64 | None:
    """(4, 4) of 12 numbers; None where they are NaN or no rotation, so that the frame is left out."""
    try:
        return rigid(numbers, path, "a pose")
    except DriveError:
        return None


def neighbours(number: int, numbers: Sequence[int], reach: int) -> tuple[int | None, int | None]:
    """The nearest smaller and greater of ascending numbers, None where there is none at most ``reach`` away."""
    before = bisect.bisect_left(numbers, number) - 1
    after = bisect.bisect_right(numbers, number)
    smaller = numbers[before] if before >= 0 and number - numbers[before] <= reach else None
    greater = numbers[after] if after < len(numbers) and numbers[after] - number <= reach else None
    return smaller, greater


@dataclass(frozen=True, eq=False)
class RectifiedLens:
    """A rectified camera, whose projection matrix is P = K [I | t].

    Attributes:
        size: width and height, pixels.
        focal, middle: of K, pixels, counted as OpenCV does.
        from_first: (4, 4) from the axes of camera 0, rectified, to this camera's: the shift t, nearly along x only.
        path: of the calibration, for messages.
    """

    size: tuple[int, int]
    focal: tuple[float, float]
    middle: tuple[float, float]
    from_first: Float64
    path: Path

    def camera(self, pose: Float64) -> Camera:
        """The camera at a pose (4, 4) to the drive's coordinates."""
        return calibrated_camera(self.size, self.focal, self.middle, pose, self.path)


def read_size(path: Path, key: str) -> tuple[int, int] | None:
    """Width and height of rectified pictures as a calibration file tells it by a key, as ``S_rect_02``; None where it does not."""
    for line in read_text(path).splitlines():
        name, _, rest = line.partition(":")
        if name.strip() == key:
            with suppress(ValueError):
                width, height = (float(word) for word in rest.split())
                if min(width, height) >= 1 and max(width, height) < 1 << 20:
                    return round(width), round(height)
    return None


def rectified_lens(
    projection: Float64, first: Path, path: Path, calibrated: tuple[int, int] | None = None
) -> RectifiedLens:
    """The lens of a projection matrix, of the size that it was calibrated for.

    Args:
        projection: its 12 numbers.
        first: one of the camera's pictures, whose size is that of all; checking a drive finds pictures of another size.
        path: of the calibration, for messages.
        calibrated: width and height that the calibration tells. It counts where the picture is that, reduced or enlarged.
    Raises:
        DriveError: K is no camera, or the picture is not readable.
    """
    matrix = projection.reshape(3, 4)
    k = matrix[:, :3]
    if k[0, 0] <= 0 or k[1, 1] <= 0 or k[2, 2] != 1 or np.abs(k[[0, 1, 2, 2], [1, 0, 0, 1]]).max() > 1e-6:
        raise DriveError("has a projection matrix that makes no camera", path=path, mend="download it again")
    shift = np.eye(4)
    shift[:3, 3] = np.linalg.solve(k, matrix[:, 3])
    picture, centre = picture_size(first), (float(k[0, 2]), float(k[1, 2]))
    if calibrated is None:
        size = calibration_size(picture, centre)
    else:
        size = calibrated if is_clean_ratio(calibrated, picture) else picture
    return RectifiedLens(size, (float(k[0, 0]), float(k[1, 1])), centre, shift, path)


def at(stamps: Sequence[float | None], number: int) -> float | None:
    """The time stamp of a number; None where the list ends before."""
    return stamps[number] if number < len(stamps) else None


def left_out(what: str, some: int, of: int, why: str) -> list[str]:
    """The notice that some of a drive's files are not used, [] where all are."""
    return [f"{what}: {some} of {of} {why}"] if some else []
