"""COLMAP models, binary and text. Formats as COLMAP's documentation describes them; pixel centres are at + 0.5 there too."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.checks.named_paths import named_path
from unveil_core.base.disk.open_safely import LARGEST_FILE, read_bytes
from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_text
from unveil_core.drives.checks.conventions import WORLD_TO_CAMERA
from unveil_core.drives.drive import Distortion, Drive, Frame, PointCloud
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.lens import FISHEYE
from unveil_core.geometry.transforms import quat_to_rotation

__all__ = ["find_model", "has_model", "read_colmap", "read_model_points"]

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
class _Lens:
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


def find_model(path: Path) -> Path | None:
    """The folder of a COLMAP model at or under ``path`` in one of the usual places."""
    for place in ("", "sparse/0", "sparse", "colmap/sparse/0"):
        folder = path / place
        if any((folder / f"images{suffix}").is_file() for suffix in (".bin", ".txt")):
            return folder
    return None


def has_model(path: Path) -> bool:
    """Whether a folder is, or holds in one of the usual places, a model with cameras, not only files of such a name."""
    folder = find_model(path)
    return folder is not None and any((folder / f"cameras{suffix}").is_file() for suffix in (".bin", ".txt"))


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
            raise DriveError("is cut short", path=self.path, mend="copy or export the model again") from error
        self.at += struct.calcsize(layout)
        return values

    def skip(self, size: int, count: int) -> None:
        self.at += size * count
        if self.at > len(self.data):
            raise DriveError("is cut short", path=self.path, mend="copy or export the model again")

    def text(self) -> str:
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise DriveError("is cut short", path=self.path, mend="copy or export the model again")
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
            raise self.wrong(f"{names} are numbers, found {' '.join(words)[:40]!r}") from error
        if stop is not None and len(found) < stop - start:
            raise self.wrong(f"{names} are expected, the line ends after {len(self.words)} of {stop} words")
        return found

    def wrong(self, problem: str) -> DriveError:
        """The error that names the line."""
        return DriveError(f"line {self.number}: {problem}", path=self.path, mend=MEND)


def _lines(path: Path) -> Iterator[_Line]:
    """Lines without comments, empty ones among them: an image without observations has an empty second line."""
    text = read_text(path, "a COLMAP model has cameras, images and points3D", most=LARGEST_MODEL)
    for number, line in enumerate(text.split("\n"), 1):
        if not line.startswith("#"):
            yield _Line(path, number, line.split())


def _lens(path: Path, model: str, width: int, height: int, parameters: tuple[float, ...]) -> _Lens:
    if model not in _BY_NAME:
        raise DriveError(f"camera model {model} is not known", path=path, mend="undistort the images with COLMAP first")
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
    return _Lens(model, width, height, parameters)


def _read_cameras(folder: Path) -> dict[int, _Lens]:
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


def _read_images(folder: Path) -> list[tuple[str, int, NDArray[np.float64]]]:
    """(name, camera id, world-to-camera) per image."""
    found = []
    if (folder / "images.bin").is_file():
        stream = _Bytes(folder / "images.bin")
        for _ in range(stream.take("<Q")[0]):
            values = stream.take("<i7di")
            name = stream.text()
            stream.skip(24, stream.take("<Q")[0])  # the 2D observations are not needed
            found.append((name, values[8], values[1:8]))
    else:
        rows = list(_lines(folder / "images.txt"))
        for line in rows[::2]:  # every second line lists the observations
            if line.words:
                pose_numbers = line.numbers(float, "qw qx qy qz tx ty tz", 1, 8)
                (camera,) = line.numbers(int, "a camera's id", 8, 9)
                if len(line.words) < 10:
                    raise line.wrong("the image's name is missing")
                found.append((" ".join(line.words[9:]), camera, pose_numbers))
    images = []
    for name, camera, numbers in found:
        if not np.isfinite(numbers).all() or not 1e-9 < np.linalg.norm(numbers[:4]) < 1e9:
            raise DriveError(
                f"the pose of {name} is no rotation or holds NaN", path=folder, mend="drop the image or redo its pose"
            )
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = quat_to_rotation(numbers[:4]), numbers[4:]
        images.append((name, camera, pose))
    return sorted(images, key=lambda i: i[0])


def read_model_points(folder: Path) -> PointCloud:
    """The points of the model in a folder that at least three images agree on.

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
    good = np.isfinite(table).all(axis=1) & (table[:, 6] <= MAX_REPROJECTION_PX) & (table[:, 7] >= MIN_TRACK)
    table = table[good]
    if not len(table):
        raise DriveError(
            "holds no points that three images agree on", path=folder, mend="run the mapper with more overlap"
        )
    return PointCloud(table[:, :3].copy(), table[:, 3:6].clip(0, 255).astype(np.uint8))


def read_colmap(path: Path) -> Drive:
    """Read a COLMAP model with its images and, where present, masks.

    Images lie in ``images/`` of the folder that holds the model, masks in ``masks/NAME.png`` or ``masks/STEM.png`` (0 = remove).
    The model knows neither scale nor up.
    """
    folder = find_model(path)
    if folder is None:
        raise DriveError(
            "holds no COLMAP model", path=path, mend="sparse/0 with cameras, images and points3D is looked for"
        )
    root = path
    while not (root / "images").is_dir() and root != root.parent and root != path.parent.parent.parent:
        root = root.parent
    if not (root / "images").is_dir():
        raise DriveError("has no folder images/ beside its model", path=path)
    lenses = _read_cameras(folder)
    frames = []
    for name, camera_id, pose in _read_images(folder):
        if camera_id not in lenses:
            raise DriveError(f"image {name} names camera {camera_id}, which is not there", path=folder)
        lens = lenses[camera_id]
        (fx, fy, cx, cy), distortion = lens.split()
        named_path(root / "masks", f"{name}.png", folder, "an image's name")  # is the longest that is looked for
        if not Path(name).name:
            raise DriveError(f"an image's name is none of a file: {name[:40]!r}", path=folder, mend="correct it")
        image = root / "images" / name
        masks = (root / "masks" / f"{name}.png", (root / "masks" / name).with_suffix(".png"))
        parent = Path(name).parent.as_posix()
        frames.append(
            Frame(
                name=image.stem,
                camera_name="camera" if parent == "." else parent.replace("/", "_"),
                camera=Camera(lens.width, lens.height, fx, fy, cx, cy, pose),
                image_path=image,
                distortion=distortion,
                mask_path=next((m for m in masks if m.is_file()), None),
            )
        )
    if not frames:
        raise DriveError("has no images", path=folder, mend="a drive needs at least one frame")
    return Drive(
        root=path,
        frames=tuple(frames),
        points=read_model_points(folder),
        units_per_metre=None,
        scale_source="",
        up=None,
        up_source="",
        truth_root=root / "truth" if (root / "truth").is_dir() else None,
        sources=tuple(sorted(p for p in folder.iterdir() if p.stem in ("cameras", "images", "points3D"))),
        pose_convention=WORLD_TO_CAMERA,
    )
