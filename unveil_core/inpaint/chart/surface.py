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
STEEPEST = 4.0
"""Rise from one surfel to the next over their distance up to which they are of one surface, as the largest aspect of surfels from
points (``surfels.tangents``)."""
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
    normal = surface.normal(rows, columns)
    quats, size = _laid(surface, rows, columns, normal, np.broadcast_to(spacing, (len(rows), 2)))
    return surfels_from_points(
        surface.world(rows, columns) - behind * normal,
        np.maximum(colors * np.float32(255), 0),
        labels,
        normal,
        size,
        quats=quats,
        sh_degree=sh_degree,
        opacity=OPACITY,
        scale_factor=SCALE_FACTOR,
    )


def _laid(
    surface: Surface, rows: NDArray[np.int64], columns: NDArray[np.int64], normal: Float64, spacing: Float64
) -> tuple[Float64, Float64]:
    """Quaternions (N, 4) of surfels that lie in the surface as it rises around them, and how far it is from one to the next along
    both of their axes (N, 2), metres: level ones leave chinks between them on a slope, and more so at a kerb.

    Args:
        normal: (N, 3) of the surface as it is laid out; spacing: (N, 2) between them as the surface is laid out, metres.
    """
    if not len(rows):
        return np.zeros((0, 4)), np.zeros((0, 2))
    span = []
    for axis, away in enumerate(spacing.T):
        reach = np.maximum(np.round(away / surface.texel / 2), 1).astype(np.int64)
        there, back = (
            surface.world(rows + sign * reach * (axis == 0), columns + sign * reach * (axis == 1)) for sign in (1, -1)
        )
        step = (there - back) * (away / (2 * surface.texel * reach))[:, None]
        rise = np.sum(step * normal, axis=1, keepdims=True)
        # Farther apart than that they are not of one surface: there they stay level.
        together = np.abs(rise) <= STEEPEST * away[:, None]
        span.append(np.where(together, step, step - rise * normal))
    along, across = span
    facing = np.cross(along, across)
    facing *= np.where(np.sum(facing * normal, axis=1) < 0, -1.0, 1.0)[:, None]
    first, third = (v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12) for v in (along, facing))
    second = np.cross(third, first)
    size = np.stack([np.linalg.norm(along, axis=1), np.abs(np.sum(across * second, axis=1))], axis=1)
    quats = Rotation.from_matrix(np.stack([first, second, third], axis=2)).as_quat()
    return np.roll(quats, 1, axis=1), size
