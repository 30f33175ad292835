"""What structure from motion found: cameras and points in coordinates of their own."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.disk.open_safely import open_file
from unveil_core.base.types import Float64
from unveil_core.drives.drive import Distortion
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.lens import FISHEYE, undistorted
from unveil_core.geometry.similarity import Similarity

__all__ = ["FISHEYES", "Lens", "Model", "read_model"]

FISHEYES = ("OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
"""COLMAP's models that are fisheyes."""


@dataclass(frozen=True)
class Lens:
    """A lens as COLMAP has it.

    Attributes:
        model: its name there; width, height: of pictures, pixels; parameters: focal lengths, principal point, distortion.
    """

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]

    @property
    def focal_px(self) -> float:
        """Focal length, the mean of both where there are two, pixels."""
        return self.pinhole[0] if self._one_focal else (self.parameters[0] + self.parameters[1]) / 2

    @property
    def _one_focal(self) -> bool:
        return self.model.startswith(("SIMPLE_", "RADIAL"))

    @property
    def pinhole(self) -> tuple[float, float, float, float]:
        """fx, fy, cx, cy in pixels."""
        p = self.parameters
        return (p[0], p[0], p[1], p[2]) if self._one_focal else (p[0], p[1], p[2], p[3])

    @property
    def distortion(self) -> Distortion | None:
        """As OpenCV has it; None of a pinhole."""
        rest = self.parameters[3 if self._one_focal else 4 :]
        if self.model in FISHEYES:
            return Distortion(FISHEYE, (*rest, *[0.0] * (4 - len(rest))))
        # One radial term or two come before what OpenCV puts third and fourth.
        shown = (*rest, *[0.0] * (8 - len(rest)))
        found = Distortion("OPENCV", shown)
        return None if found.is_zero else found

    def camera(self, world_to_camera: Float64) -> Camera:
        """The pinhole of this lens at a pose (4, 4)."""
        return Camera(self.width, self.height, *self.pinhole, world_to_camera)

    def straight(self, pixels: Float64) -> Float64:
        """(N, 2) normalized pinhole coordinates of pixels (N, 2) of a picture."""
        fx, fy, cx, cy = self.pinhole
        normalized = (pixels - (cx, cy)) / (fx, fy)
        lens = self.distortion
        return normalized if lens is None else undistorted(lens.model, lens.coefficients, normalized)


@dataclass(frozen=True, eq=False)
class Model:
    """Attributes:
    names: of the pictures that have a camera, rising, relative to the folder of pictures.
    lens: (F,) of each picture, in ``lenses``.
    poses: (F, 4, 4) world to camera.
    points: (P, 3); errors: (P,) mean distance of their observations, pixels.
    seen_by, seen: (K,) picture and point of each observation; pixels: (K, 2) where, pixel centres at + 0.5.
    """

    names: tuple[str, ...]
    lens: NDArray[np.int64]
    lenses: tuple[Lens, ...]
    poses: Float64
    points: Float64
    errors: Float64
    seen_by: NDArray[np.int64]
    seen: NDArray[np.int64]
    pixels: Float64

    @property
    def centres(self) -> Float64:
        """(F, 3) of the cameras."""
        return -np.einsum("nji,nj->ni", self.poses[:, :3, :3], self.poses[:, :3, 3])

    def camera(self, i: int) -> Camera:
        """The pinhole camera of a picture."""
        return self.lenses[int(self.lens[i])].camera(self.poses[i])

    def frame_errors(self) -> Float64:
        """(F,) root mean square distance of what each picture shows from where its points project, pixels; NaN where none."""
        found = np.full(len(self.names), np.nan)
        for i in range(len(self.names)):
            own = self.seen_by == i
            if own.any():
                local = self.points[self.seen[own]] @ self.poses[i, :3, :3].T + self.poses[i, :3, 3]
                lens = self.lenses[int(self.lens[i])]
                off = lens.straight(self.pixels[own]) - local[:, :2] / local[:, 2:]
                found[i] = np.sqrt((off**2).sum(axis=1).mean()) * lens.focal_px
        return found

    def moved(self, to_local: Similarity) -> Model:
        """The model in the local coordinates of a similarity whose world is the model's own."""
        poses = np.stack([to_local.camera_to_local(self.camera(i)).world_to_camera for i in range(len(self.names))])
        return replace(self, poses=poses, points=to_local.to_local(self.points))

    def with_pictures(self, names: list[str], lens: list[int], poses: list[Float64]) -> Model:
        """With cameras of more pictures, which show none of the points; in the order of names."""
        every = [*self.names, *names]
        order = np.argsort(np.array(every), kind="stable")
        place = np.empty(len(order), np.int64)
        place[order] = np.arange(len(order))
        return replace(
            self,
            names=tuple(every[i] for i in order),
            lens=np.concatenate([self.lens, np.array(lens, np.int64)])[order],
            poses=np.concatenate([self.poses, np.array(poses).reshape(-1, 4, 4)])[order],
            seen_by=place[self.seen_by],
        )


def read_model(path: Path) -> Model:
    """The model that ``child.py`` wrote."""
    with open_file(path) as file, np.load(file) as held:
        lenses = tuple(
            Lens(str(name), int(size[0]), int(size[1]), tuple(json.loads(str(text))))
            for name, size, text in zip(held["models"], held["sizes"], held["parameters"], strict=True)
        )
        numbers = {k: held[k] for k in ("lens", "poses", "points", "errors", "seen_by", "seen", "pixels")}
        return Model(names=tuple(map(str, held["names"])), lenses=lenses, **numbers)
