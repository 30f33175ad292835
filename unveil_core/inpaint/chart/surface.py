"""What all charts have in common: a surface whose texture lies in coordinates of its own, along the street and across or up."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unveil_core.base.types import Float32, Float64, Labels, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.ground.path import StreetPath
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels

__all__ = ["NEAREST_M", "OPACITY", "SCALE_FACTOR", "Surface", "shown_places", "surfels_on"]

NEAREST_M = 0.3
"""Depth in front of which a camera shows no place of a street, metres: closer than any camera stands to it."""
OPACITY, SCALE_FACTOR = 0.95, 0.7
"""Of surfels that fill what was not seen: opaque, and overlapping so that nothing shows between them."""


class Surface(Protocol):
    """The ground in (s, t), or what stands beside the street in (s, height)."""

    @property
    def texel(self) -> float:
        """Side of a texel, metres."""

    def world(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Float64:
        """(N, 3) world positions of texel centres."""

    def normal(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Float64:
        """(N, 3) unit normals there, to where the cameras are."""

    def index_of(self, street: Float64) -> tuple[NDArray[np.int64], NDArray[np.int64], Mask]:
        """Nearest rows and columns of street coordinates (N, 3), and whether these lie on the surface."""


def shown_places(
    world: Float64, s: Float64, path: StreetPath, camera: Camera, reach_m: float, *, furthest_m: float = np.inf
) -> tuple[NDArray[np.int64], Float64, Float64]:
    """Which places along a street a camera may show: indices (N,), pixels (N, 2) and depths (N,), metres.

    Args:
        world: (P, 3); s: (P,) their arc lengths, rising.
        reach_m: how far along the street it is asked, either way; furthest_m: the greatest depth.
    """
    here = float(path.to_street(camera.centre[None])[0, 0])
    first, last = np.searchsorted(s, (here - reach_m, here + reach_m))
    shown, pixel, depth = camera.shown(world[first:last], nearest=NEAREST_M, furthest=furthest_m)
    return first + shown, pixel, depth


def surfels_on(
    surface: Surface,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    colors: Float32,
    labels: Labels,
    *,
    spacing: float | Float64,
    sh_degree: int,
    behind: float = 0.0,
) -> Surfels:
    """Surfels at texels (N,), in colours (N, 3) from 0 to 1, turned along the surface's rows.

    Args:
        spacing: between them, metres, or (N, 2) from row to row and from column to column.
        behind: how far they lie behind the surface, metres.
    """
    normal, places = surface.normal(rows, columns), surface.world(rows, columns)
    quats, size = None, np.full(len(rows), spacing) if np.ndim(spacing) == 0 else np.asarray(spacing)
    if size.ndim == 2:
        along = surface.world(rows + 1, columns) - places
        along -= normal * np.sum(normal * along, axis=1, keepdims=True)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        axes = np.stack([along, np.cross(normal, along), normal], axis=2)
        quats = np.roll(Rotation.from_matrix(axes).as_quat(), 1, axis=1) if len(rows) else np.zeros((0, 4))
    return surfels_from_points(
        places - behind * normal,
        np.clip(np.round(colors * 255), 0, 255).astype(np.uint8),
        labels,
        normal,
        size,
        quats=quats,
        sh_degree=sh_degree,
        opacity=OPACITY,
        scale_factor=SCALE_FACTOR,
    )
