"""The one map between a drive's own coordinates and those that everything inside uses.

Inside, lengths are metres, z is up and the origin lies amid the cameras. A drive's own frame may have any unit, any axis up and
coordinates of millions (UTM). Between the two lies ``world = scale * rotation @ local + translation``, in float64. A drive whose
files have metres and z up keeps every bit but the shift: nothing is multiplied where scale and rotation are those of identity.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from unveil_core.base.types import Float64
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.transforms import nearest_rotation

__all__ = ["Similarity"]


@dataclass(frozen=True, eq=False)
class Similarity:
    """``world = scale * rotation @ local + translation``.

    Attributes:
        scale: world units per metre, positive.
        rotation: (3, 3) float64, turns local axes to the world's.
        translation: (3,) float64, where the local origin lies in the world.
    """

    scale: float = 1.0
    rotation: Float64 = field(default_factory=lambda: np.eye(3))
    translation: Float64 = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        rotation, translation = np.array(self.rotation, np.float64), np.array(self.translation, np.float64)
        if rotation.shape != (3, 3) or translation.shape != (3,):
            raise ValueError("a similarity has a 3x3 rotation and three numbers of translation")
        if not (math.isfinite(self.scale) and np.isfinite(rotation).all() and np.isfinite(translation).all()):
            raise ValueError("a similarity's numbers are finite")
        if not self.scale > 0:
            raise ValueError(f"a scale is positive, not {self.scale:g}")
        if nearest_rotation(rotation)[1] > 1e-6:
            raise ValueError("not a rotation: that of a similarity")
        for name, value in (("scale", float(self.scale)), ("rotation", rotation), ("translation", translation)):
            object.__setattr__(self, name, value)

    @property
    def turns(self) -> bool:
        """False where local axes are the world's."""
        return not np.array_equal(self.rotation, np.eye(3))

    @property
    def shifts_only(self) -> bool:
        """True where the world has metres and the local axes."""
        return self.scale == 1 and not self.turns

    @property
    def matrix(self) -> Float64:
        """(4, 4), from local to world."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.scale * self.rotation, self.translation
        return matrix

    @property
    def up(self) -> Float64:
        """(3,) unit, the world's direction that is up inside."""
        return np.array(self.rotation[:, 2])

    @property
    def inverse(self) -> Similarity:
        """The similarity from the world to local coordinates."""
        turned = self.directions_to_local(-self.translation)
        return Similarity(1 / self.scale, self.rotation.T, turned / self.scale)

    def after(self, inner: Similarity) -> Similarity:
        """The similarity that applies ``inner`` first, then this one."""
        return Similarity(self.scale * inner.scale, self.rotation @ inner.rotation, self.to_world(inner.translation))

    def to_world(self, points: ArrayLike) -> Float64:
        """(..., 3) float64 of local points (..., 3)."""
        return self.directions_to_world(points) * self.scale + self.translation

    def to_local(self, points: ArrayLike) -> Float64:
        """(..., 3) float64 of world points (..., 3)."""
        shifted = np.asarray(points, dtype=np.float64) - self.translation
        return self.directions_to_local(shifted) / self.scale

    def directions_to_world(self, directions: ArrayLike) -> Float64:
        """(..., 3) float64 of local directions (..., 3), as long as before."""
        directions = np.asarray(directions, dtype=np.float64)
        return directions @ self.rotation.T if self.turns else directions

    def directions_to_local(self, directions: ArrayLike) -> Float64:
        """(..., 3) float64 of world directions (..., 3), as long as before."""
        directions = np.asarray(directions, dtype=np.float64)
        return directions @ self.rotation if self.turns else directions

    def camera_to_world(self, camera: Camera) -> Camera:
        """A local camera in the world: it sees the same picture, depths are ``scale`` times as large."""
        pose = camera.world_to_camera.copy()
        if self.turns:
            pose[:3, :3] = pose[:3, :3] @ self.rotation.T
        # Through the centre, so that large coordinates cancel before they are turned.
        pose[:3, 3] = -pose[:3, :3] @ self.to_world(camera.centre)
        return replace(camera, world_to_camera=pose)

    def camera_to_local(self, camera: Camera) -> Camera:
        """A camera of the world in local coordinates, see :meth:`camera_to_world`."""
        pose = camera.world_to_camera.copy()
        centre = self.to_local(camera.centre)
        if self.turns:
            pose[:3, :3] = pose[:3, :3] @ self.rotation
        pose[:3, 3] = -pose[:3, :3] @ centre
        return replace(camera, world_to_camera=pose)

    def comments(self) -> list[str]:
        """Lines for the header of a file: the shift, and where there are such the scale and, by rows, the rotation."""
        lines = ["offset " + " ".join(repr(float(v)) for v in self.translation)]
        if not self.shifts_only:
            lines += [f"scale {self.scale!r}", "rotation " + " ".join(repr(float(v)) for v in self.rotation.ravel())]
        return lines

    def to_json(self) -> dict[str, object]:
        """As :meth:`from_json` reads it."""
        return {"scale": self.scale, "rotation": self.rotation.tolist(), "translation": self.translation.tolist()}

    @staticmethod
    def from_json(data: Any) -> Similarity:
        """Inverse of :meth:`to_json`.

        Raises:
            KeyError, TypeError, ValueError: something is missing, or makes no similarity.
        """
        rotation: Sequence[Sequence[float]] = data["rotation"]
        return Similarity(
            float(data["scale"]), np.array(rotation, np.float64), np.array(data["translation"], np.float64)
        )
