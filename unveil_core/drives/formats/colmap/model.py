"""The files of a COLMAP model, binary and text, as COLMAP's documentation describes them; pixel centres are at + 0.5 there, too.

COLMAP reads an image's line, then the line after it as the image's observations, which may be empty, and skips empty lines
before an image. Programs and people leave the second lines out: what is a line of observations is seen by what is in it.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import LARGEST_FILE, read_bytes
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_text
from unveil_core.drives.drive import Distortion, PointCloud
from unveil_core.geometry.lens import FISHEYE
from unveil_core.geometry.transforms import quat_to_rotation

__all__ = ["Lens", "ModelImage", "read_cameras", "read_images", "read_model_points"]

# model id: (name, parameters)
_MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
}
ONE_FOCAL_LENGTH = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
_BY_NAME = {name: count for name, count in _MODELS.values()}
MAX_REPROJECTION_PX = 4.0
MIN_TRACK = 3
MEND = "export the model again"
LARGEST_MODEL = 2 * LARGEST_FILE
"""Bytes of one of its files: the observations of some thousand images have a tenth of it."""
_N = TypeVar("_N", int, float)


@dataclass(frozen=True)
class Lens:
    model: str
    width: int
    height: int
    parameters: tuple[float, ...]

    def split(self) -> tuple[tuple[float, float, float, float], Distortion | None]:
        """(fx, fy, cx, cy) and the distortion."""
        p = self.parameters
        if self.model in ONE_FOCAL_LENGTH:
            intrinsics, rest = (p[0], p[0], p[1], p[2]), p[3:]
            rest = (*rest, *([0.0] * (2 - len(rest))))
            distortion = Distortion("OPENCV", (rest[0], rest[1], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        else:
            intrinsics, rest = (p[0], p[1], p[2], p[3]), p[4:]
            if self.model == FISHEYE:
                return intrinsics, Distortion(FISHEYE, tuple(rest))
            distortion = Distortion("OPENCV", (*rest, *([0.0] * (8 - len(rest)))))
        return intrinsics, None if distortion.is_zero else distortion


@dataclass(frozen=True, eq=False)
class ModelImage:
    """Attributes:
    name: of its file, relative to ``images/``; camera: id of its lens; world_to_camera: (4, 4).
    """

    name: str
    camera: int
    world_to_camera: NDArray[np.float64]


class _Bytes:
    """A cursor over a binary file that knows when it is cut short."""

    def __init__(self, path: Path) -> None:
        try:
            self.data = read_bytes(path, LARGEST_MODEL)
        except OSError as error:
            raise DriveError(
                f"cannot be read: {error.strerror}", path=path, mend="a COLMAP model has cameras, images and points3D"
            ) from error
        self.path, self.at = path, 0

    def take(self, layout: str) -> tuple:  # type: ignore[type-arg]
        try:
            values = struct.unpack_from(layout, self.data, self.at)
        except struct.error as error:
            raise DriveError("Cut short", path=self.path, mend="copy or export the model again") from error
        self.at += struct.calcsize(layout)
        return values

    def skip(self, size: int, count: int) -> None:
        self.at += size * count
        if self.at > len(self.data):
            raise DriveError("Cut short", path=self.path, mend="copy or export the model again")

    def text(self) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise DriveError("Cut short", path=self.path, mend="copy or export the model again")
        value = self.data[self.at : end].decode("utf-8", "replace")
        self.at = end + 1
        return value


@dataclass(frozen=True)
class _Line:
    """A line of a text file in words."""

    path: Path
    number: int
    words: list[str]

    def numbers(self, kind: type[_N], names: str, start: int, stop: int | None = None) -> tuple[_N, ...]:
        """Some of its words as numbers.

        Args:
            names: what they are, for the message.
        """
        words = self.words[start:stop]
        try:
            found = tuple(kind(word) for word in words)
        except ValueError as error:
            raise self.wrong(f"expected numbers for {names}, found {' '.join(words)[:40]!r}") from error
        if stop is not None and len(found) < stop - start:
            raise self.wrong(f"expected {names}, the line ends after {len(self.words)} of {stop} words")
        return found

    @property
    def is_image(self) -> bool:
        """Whether it is meant as an image's line: it begins with an id and ends with a name, and is not numbers by threes."""
        words = self.words
        return len(words) >= 9 and words[0].isdigit() and (len(words) % 3 != 0 or not self.is_numbers)

    @property
    def is_of_no_image(self) -> bool:
        """Whether these are observations whose image's line was taken out: places in fractions of pixels, by threes."""
        return len(self.words) % 3 == 0 and not self.words[0].isdigit() and self.is_numbers

    @property
    def is_numbers(self) -> bool:
        """Whether all words are numbers."""
        try:
            return len([float(word) for word in self.words]) > 0
        except ValueError:
            return False

    def wrong(self, problem: str) -> DriveError:
        """The error that names the line."""
        return DriveError(f"line {self.number}: {problem}", path=self.path, mend=MEND)


def _lines(path: Path) -> Iterator[_Line]:
    """Lines without comments, empty ones among them: an image without observations has an empty second line."""
    text = read_text(path, "a COLMAP model has cameras, images and points3D", most=LARGEST_MODEL)
    for number, line in enumerate(text.split("\n"), 1):
        if not line.lstrip().startswith("#"):
            yield _Line(path, number, line.split())


def _lens(path: Path, model: str, width: int, height: int, parameters: tuple[float, ...]) -> Lens:
    if model not in _BY_NAME:
        raise DriveError(f"Not a known camera model: {model}", path=path, mend="undistort the images with COLMAP first")
    if len(parameters) != _BY_NAME[model]:
        raise DriveError(f"camera model {model} has {len(parameters)} parameters", path=path)
    focal = parameters[: 1 if model in ONE_FOCAL_LENGTH else 2]
    if (
        not np.isfinite(parameters).all()
        or min(focal) <= 0
        or not 1 <= min(width, height) <= max(width, height) < 1 << 20
    ):
        problem = f"has numbers that make no camera: {width}x{height} pixels, {' '.join(map(str, parameters))[:100]}"
        raise DriveError(problem, path=path, mend=MEND)
    return Lens(model, width, height, parameters)


def read_cameras(folder: Path) -> dict[int, Lens]:
    lenses = {}
    if (folder / "cameras.bin").is_file():
        stream = _Bytes(folder / "cameras.bin")
        for _ in range(stream.take("<Q")[0]):
            key, model, width, height = stream.take("<iiQQ")
            name, count = _MODELS.get(model, (f"number {model}", 0))
            lenses[key] = _lens(stream.path, name, width, height, stream.take(f"<{count}d"))
    else:
        path = folder / "cameras.txt"
        for line in _lines(path):
            if line.words:
                (key,) = line.numbers(int, "a camera's id", 0, 1)
                width, height = line.numbers(int, "width and height", 2, 4)
                lenses[key] = _lens(path, line.words[1], width, height, line.numbers(float, "a camera's parameters", 4))
    return lenses


def read_images(folder: Path) -> list[ModelImage]:
    """The images of the model in a folder, in the order of its file.

    Raises:
        DriveError: missing or damaged, or a pose that is none.
    """
    found: list[tuple[str, int, Sequence[float]]] = []
    if (folder / "images.bin").is_file():
        stream = _Bytes(folder / "images.bin")
        for _ in range(stream.take("<Q")[0]):
            values = stream.take("<i7di")
            name = stream.text()
            stream.skip(24, stream.take("<Q")[0])  # the 2D observations are not needed
            found.append((name, values[8], values[1:8]))
    else:
        for line in _image_lines(folder / "images.txt"):
            pose_numbers = line.numbers(float, "qw qx qy qz tx ty tz", 1, 8)
            (camera,) = line.numbers(int, "a camera's id", 8, 9)
            if len(line.words) < 10:
                raise line.wrong("the image's name is missing")
            found.append((" ".join(line.words[9:]), camera, pose_numbers))
    images = []
    for name, camera, numbers in found:
        if not np.isfinite(numbers).all() or not 1e-9 < np.linalg.norm(numbers[:4]) < 1e9:
            raise DriveError(f"Not a rotation: the pose of {name}", path=folder, mend="drop the image or redo its pose")
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = quat_to_rotation(numbers[:4]), numbers[4:]
        images.append(ModelImage(name, camera, pose))
    return images


def _image_lines(path: Path) -> Iterator[_Line]:
    """The lines of images, without those of observations, which may be missing."""
    pending = empty = False  # of the image before, its observations are to come, after an empty line
    for line in _lines(path):
        if not line.words:
            empty = pending
        elif pending and not line.is_image and (not empty or line.is_numbers):
            pending = empty = False
        elif line.is_of_no_image:
            continue
        else:
            pending, empty = True, False
            yield line


def read_model_points(folder: Path) -> PointCloud:
    """The points of the model in a folder that at least three images agree on, and those that no image was needed for: points
    without a track were measured and put into the model.

    Raises:
        DriveError: missing, damaged, or none.
    """
    rows: list[tuple[float, ...]] = []
    if (folder / "points3D.bin").is_file():
        stream = _Bytes(folder / "points3D.bin")
        for _ in range(stream.take("<Q")[0]):
            _, x, y, z, r, g, b, error = stream.take("<QdddBBBd")
            track = stream.take("<Q")[0]
            stream.skip(8, track)
            rows.append((x, y, z, r, g, b, error, track))
    else:
        for line in _lines(folder / "points3D.txt"):
            if line.words:
                rows.append((*line.numbers(float, "x y z r g b error", 1, 8), (len(line.words) - 8) / 2))
    table = np.array(rows, dtype=np.float64).reshape(-1, 8)
    finite = np.isfinite(table[:, :6]).all(axis=1)
    measured = finite & (table[:, 7] == 0)
    agreed = finite & (table[:, 6] <= MAX_REPROJECTION_PX) & (table[:, 7] >= MIN_TRACK)
    good = measured | agreed
    if not good.any():
        problem, mend = "holds no points", "export the model with its points, or put measured ones into it"
        if len(table):
            seen = int((table[:, 7] >= MIN_TRACK).sum())
            problem = f"holds {len(table)} points, none of them seen by three images"
            if seen:
                right = f"none of these right to {MAX_REPROJECTION_PX:g} pixels"
                problem = f"holds {len(table)} points, {seen} of them seen by three images, and {right}"
            mend = "run the mapper with more overlap"
        raise DriveError(problem, path=folder, mend=mend)
    table = table[good]
    return PointCloud(
        table[:, :3].copy(), table[:, 3:6].clip(0, 255).astype(np.uint8), bool(measured.sum() * 2 > good.sum())
    )
