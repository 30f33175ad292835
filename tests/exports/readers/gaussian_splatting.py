"""A COLMAP model as the reference implementation of 3D Gaussian Splatting reads and draws it (its older versions, whose rules many
took over): what it does with files and numbers was read in its published source.

* A picture is looked for in ``images/`` by the last part of its name; the name is cut at its first dot.
* Lines are split at white space, in the encoding of the system.
* Cameras are PINHOLE, and the principal point is taken to be in the middle.
* Matrices are single precision.
* Points come from ``sparse/0/points3D.ply`` where it is there, with normals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.plain_ply import read_plain_ply

__all__ = ["View", "read_as_3dgs"]


@dataclass
class View:
    """A picture that was found, and its camera."""

    picture: Path
    name: str
    width: int
    height: int
    focal: tuple[float, float]
    world_view: np.ndarray

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) where it draws points (N, 3), counted from the outer edge of the first pixel; all in single precision."""
        fov = [2 * math.atan(side / (2 * f)) for side, f in zip((self.width, self.height), self.focal, strict=True)]
        scale = np.array([1 / math.tan(angle / 2) for angle in fov], np.float32)
        homogeneous = np.concatenate([points.astype(np.float32), np.ones((len(points), 1), np.float32)], axis=1)
        local = homogeneous @ self.world_view.T
        ndc = local[:, :2] * scale / local[:, 2:3]
        return (ndc + np.float32(1)) * np.float32(0.5) * np.array([self.width, self.height], np.float32)


def read_as_3dgs(folder: Path) -> tuple[list[View], np.ndarray]:
    """Its views, in the order of their names, and points (N, 3); a ValueError where it stops."""
    cameras: dict[int, tuple[int, int, list[float]]] = {}
    for line in _lines(folder / "sparse/0/cameras.txt"):
        words = line.split()
        if words[1] != "PINHOLE":
            raise ValueError(f"camera model {words[1]} is not handled")
        cameras[int(words[0])] = (int(words[2]), int(words[3]), [float(w) for w in words[4:]])
    views: dict[str, View] = {}
    for line in _lines(folder / "sparse/0/images.txt"):
        words = line.split()
        if len(words) < 10:
            continue
        width, height, numbers = cameras[int(words[8])]
        picture = folder / "images" / words[9].split("/")[-1]
        if not picture.is_file():
            raise ValueError(f"No such file: {picture}")
        name = picture.name.split(".")[0]
        if name in views:
            raise ValueError(f"two pictures are called {name}")
        world_view = np.eye(4)
        world_view[:3, :3], world_view[:3, 3] = (
            _rotation([float(w) for w in words[1:5]]),
            [float(w) for w in words[5:8]],
        )
        views[name] = View(picture, name, width, height, (numbers[0], numbers[1]), world_view.astype(np.float32))
    table = read_plain_ply(folder / "sparse/0/points3D.ply")
    if not {"nx", "ny", "nz", "red", "green", "blue"} <= set(table.dtype.names or ()):
        raise ValueError("points without colours or normals")
    return [views[name] for name in sorted(views)], np.stack([table[n] for n in "xyz"], axis=1)


def _lines(path: Path) -> list[str]:
    text = path.read_bytes().decode("ascii")  # what no system's encoding reads otherwise
    return [line for line in text.split("\n") if line and not line.startswith("#")]


def _rotation(quat: list[float]) -> np.ndarray:
    w, x, y, z = quat
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
