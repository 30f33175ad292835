"""What every backend agrees on: which planes are made together, their shapes, and the settings of a pass."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

from torch import Tensor

from unveil_core.geometry.camera import Camera
from unveil_core.raster.spec import FIELD_MARGIN, PLANES, Limits

__all__ = [
    "GEOMETRY",
    "GROUPS",
    "TILE",
    "Group",
    "Inputs",
    "Settings",
    "field_of_view",
    "group_for",
    "plane_shapes",
    "tile_counts",
]

TILE = 16
"""Pixels along a tile, in every backend's lists."""

Inputs = tuple[Tensor, Tensor, Tensor, Tensor, Tensor]
"""means (N, 3), quats (N, 4), log_scales (N, 2) or (N, 3), opacity_logits (N,), sh (N, C, 3): float32."""


class Group(NamedTuple):
    """Planes that are made together: rgb and alpha, and what the switches add."""

    geometry: bool
    semantics: bool
    label_distortion: bool


GROUPS = {
    "colour": Group(geometry=False, semantics=False, label_distortion=False),
    "semantic": Group(geometry=False, semantics=True, label_distortion=False),
    "geometry": Group(geometry=True, semantics=False, label_distortion=False),
    "all": Group(geometry=True, semantics=True, label_distortion=True),
}
"""By name, the cheapest first."""
GEOMETRY = ("depth", "median_depth", "normal", "distortion")
"""Planes that ``Group.geometry`` adds."""


@dataclass(frozen=True)
class Settings:
    """What to render.

    Attributes:
        group: name in ``GROUPS``.
        label_count: K.
        coefficients: how many spherical-harmonic coefficients are used.
        near, far: metres.
        limits: where a backend stops counting.
        planes: those of the group that are wanted. The triton backend leaves out the label distortion, a pass of its own,
            where it is not among them.
    """

    group: str
    label_count: int
    coefficients: int
    near: float
    far: float
    limits: Limits = Limits()
    planes: tuple[str, ...] = PLANES

    @property
    def c1(self) -> float:
        """m = far / (far - near) - c1 / depth is the mapped depth; differences of m need c1 alone."""
        return self.far * self.near / (self.far - self.near)

    @property
    def inv_near(self) -> float:
        """One over the nearest depth that counts."""
        return 1.0 / self.near


def field_of_view(camera: Camera) -> tuple[float, float, float, float]:
    """Least and greatest x / z, then y / z, at which an ellipsoid's Jacobian is taken (see ``raster.spec``)."""
    bounds: list[float] = []
    for size, focal, centre in ((camera.width, camera.fx, camera.cx), (camera.height, camera.fy, camera.cy)):
        bounds += [float((0.5 * size * (1.0 + s * FIELD_MARGIN) - centre) / focal) for s in (-1.0, 1.0)]
    return bounds[0], bounds[1], bounds[2], bounds[3]


def tile_counts(width: int, height: int) -> tuple[int, int]:
    """How many tiles cover an image, across and down."""
    return -(-width // TILE), -(-height // TILE)


def plane_shapes(group: Group, width: int, height: int, label_count: int) -> dict[str, tuple[int, ...]]:
    """Shapes in the kernels' order; planes that the group does not make are empty."""
    flat = (height, width)
    return {
        "rgb": (*flat, 3),
        "alpha": flat,
        "depth": flat if group.geometry else (0, 0),
        "median_depth": flat if group.geometry else (0, 0),
        "normal": (*flat, 3) if group.geometry else (0, 0, 0),
        "distortion": flat if group.geometry else (0, 0),
        "semantics": (*flat, label_count) if group.semantics else (0, 0, 0),
        "label_distortion": flat if group.label_distortion else (0, 0),
    }


def group_for(wanted: Collection[str]) -> str:
    """The cheapest group that makes all these planes."""
    for name, group in GROUPS.items():
        made = {plane for plane, shape in plane_shapes(group, 1, 1, 1).items() if 0 not in shape}
        if made.issuperset(wanted):
            return name
    raise ValueError(f"no group makes {', '.join(wanted)}")
