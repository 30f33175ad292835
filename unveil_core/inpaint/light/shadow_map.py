"""Shadow mapping: which points lie in the shadow of surfels, for a given direction of the sun.

Williams, *Casting curved shadows on curved surfaces* (1978): the scene is drawn as the sun sees it, keeping the depth of what is
nearest to the sun; a point that is farther away than the depth drawn at its place lies in shadow.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.types import Float64
from unveil_core.surfels.surfels import Surfels, rotations

__all__ = ["in_shadow"]

REACH = 1.6
"""Radius to which a surfel is drawn, standard deviations: an opaque one is a quarter as dense there."""
OPAQUE = 0.3
"""Opacity under which a surfel casts no shadow. Reconstruction prunes fainter ones."""
LARGEST_PX = 64
"""Half the side of the square that a surfel is drawn in at most, pixels: bounds the time that single huge ones take."""


def in_shadow(
    points: Float64, casters: Surfels, towards_sun: Float64, *, cell: float, bias: float
) -> NDArray[np.bool_]:
    """Whether points lie in shadow.

    Args:
        points: (P, 3) world points.
        casters: surfels that cast shadows; the surface that the points lie on should not be among them.
        towards_sun: (3,) unit vector.
        cell: pixel of the shadow map, metres; bias: a caster counts only if it is nearer to the sun by this, metres.
    Returns:
        (P,) bool.
    """
    shaded = np.zeros(len(points), dtype=bool)
    casters = casters.select(casters.opacity_logits > np.log(OPAQUE / (1 - OPAQUE)))
    if not len(points) or not len(casters):
        return shaded
    across = np.cross(towards_sun, [0.0, 0.0, 1.0] if abs(towards_sun[2]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(towards_sun, across), towards_sun])
    at = points @ axes.T
    low = at[:, :2].min(axis=0) - cell
    size = np.ceil((at[:, :2].max(axis=0) - low) / cell).astype(int) + 2
    means = casters.means.detach().double().numpy() @ axes.T
    turned = axes @ rotations(casters.quats.detach()).double().numpy()
    scales = casters.log_scales.detach().double().exp().numpy()
    extent = (turned[:, :, :2] * scales[:, None, :2]).transpose(0, 2, 1)
    nearest = np.full((size[1], size[0]), -np.inf, dtype=np.float32)
    _draw(nearest, (means - np.array([*low, 0.0])) / np.array([cell, cell, 1.0]), extent / np.array([cell, cell, 1.0]))
    # Discs leave chinks between them that no light comes through.
    nearest = cv2.morphologyEx(
        np.where(np.isfinite(nearest), nearest, -1e9), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)
    )
    column, row = ((at[:, :2] - low) / cell).astype(int).T
    shaded = nearest[row, column] > at[:, 2] + bias
    return shaded


@njit(cache=True)
def _draw(nearest, means, extent):  # type: ignore[no-untyped-def]
    """Draw discs, orthographically: means (N, 3) in pixels and depth, extent (N, 2, 3) their axes as long as their
    standard deviations; ``nearest`` keeps the largest depth of each pixel."""
    rows, columns = nearest.shape
    for n in range(means.shape[0]):
        ax, ay, az = extent[n, 0]
        bx, by, bz = extent[n, 1]
        # Seen from its edge a disc is still a pixel wide.
        half_x = min(LARGEST_PX, REACH * np.sqrt(ax * ax + bx * bx) + 0.5)
        half_y = min(LARGEST_PX, REACH * np.sqrt(ay * ay + by * by) + 0.5)
        x0, x1 = int(np.floor(means[n, 0] - half_x)), int(np.floor(means[n, 0] + half_x))
        y0, y1 = int(np.floor(means[n, 1] - half_y)), int(np.floor(means[n, 1] + half_y))
        determinant = ax * by - bx * ay
        edge_on = abs(determinant) < 0.05
        for y in range(max(0, y0), min(rows, y1 + 1)):
            for x in range(max(0, x0), min(columns, x1 + 1)):
                dx, dy = x + 0.5 - means[n, 0], y + 0.5 - means[n, 1]
                depth = means[n, 2]
                if not edge_on:
                    u, v = (by * dx - bx * dy) / determinant, (ax * dy - ay * dx) / determinant
                    if u * u + v * v > REACH * REACH:
                        continue
                    depth += u * az + v * bz
                nearest[y, x] = max(nearest[y, x], np.float32(depth))
