"""Shadow mapping: which points lie in the shadow of surfels, for a given direction of the sun.

Williams, *Casting curved shadows on curved surfaces* (1978): the scene is drawn as the sun sees it, keeping the depth of what is
nearest to the sun; a point that is farther away than the depth drawn at its place lies in shadow.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT
from unveil_core.base.types import Float64
from unveil_core.surfels.surfels import Surfels, rotations

__all__ = ["Discs", "in_shadow"]

REACH = 1.6
"""Radius to which a surfel is drawn, standard deviations: an opaque one is a quarter as dense there."""
OPAQUE = 0.3
"""Opacity under which a surfel casts no shadow. Reconstruction prunes fainter ones."""
CELL_M, BIAS_M = 0.06, 0.15
"""Pixel of the shadow map, and how much nearer to the sun a caster must be than what it shades, metres: a texel and a half, and
the noise of the ground's surfels."""
LARGEST_PX = 64
"""Half the side of the square that a surfel is drawn in at most, pixels: bounds the time that single huge ones take."""


@dataclass(frozen=True, eq=False)
class Discs:
    """Surfels as they cast shadows, whatever the direction of the sun.

    Attributes:
        means: (N, 3) float64 centres.
        extents: (N, 2, 3) float64 their tangent axes, as long as the standard deviations.
    """

    means: Float64
    extents: Float64

    @staticmethod
    def of(surfels: Surfels) -> Discs:
        """Those of the opaque ones."""
        opaque = surfels.opacity_logits.detach().numpy() > np.log(OPAQUE / (1 - OPAQUE))
        means, quats, log_scales = (
            part.detach()[torch.from_numpy(opaque)].double()
            for part in (surfels.means, surfels.quats, surfels.log_scales)
        )
        axes = rotations(quats)[:, :, :2] * log_scales[:, None, :2].exp()
        return Discs(means.numpy(), np.ascontiguousarray(axes.transpose(1, 2).numpy()))


def in_shadow(points: Float64, casters: Discs, towards_sun: Float64) -> NDArray[np.bool_]:
    """Whether points lie in shadow.

    Args:
        points: (P, 3) world points.
        casters: what casts shadows; the surface that the points lie on should not be among them.
        towards_sun: (3,) unit vector.
    Returns:
        (P,) bool.
    """
    if not len(points) or not len(casters.means):
        return np.zeros(len(points), dtype=bool)
    across = np.cross(towards_sun, [0.0, 0.0, 1.0] if abs(towards_sun[2]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    axes = np.stack([across, np.cross(towards_sun, across), towards_sun])
    x, y, height = axes @ points.T
    left, top = x.min() - CELL_M, y.min() - CELL_M
    columns, rows = (int(np.ceil(extent / CELL_M)) + 2 for extent in (x.max() - left, y.max() - top))
    nearest = np.full((rows, columns), -np.inf, dtype=np.float32)
    _draw(nearest, casters.means, casters.extents, axes, left, top, CELL_M)
    # Discs leave chinks between them that no light comes through.
    nearest = cv2.morphologyEx(
        np.where(np.isfinite(nearest), nearest, np.float32(-1e9)), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)
    )
    row, column = ((values / CELL_M).astype(int) for values in (y - top, x - left))
    return np.asarray(nearest[row, column] > height + BIAS_M)


@njit(**EXACT)
def _draw(nearest, means, extents, axes, left, top, cell):  # type: ignore[no-untyped-def]
    """Draw discs, orthographically: means (N, 3) and extents (N, 2, 3) as of :class:`Discs`; rows of ``axes`` (3, 3) are the map's
    x, its y and the depth, from ``left`` and ``top`` on in pixels of ``cell`` metres. ``nearest`` keeps the largest depth of each
    pixel, metres."""
    rows, columns = nearest.shape
    for n in range(means.shape[0]):
        # Numbers and no arrays: an array for each disc would take longer than the disc.
        mx, my, mz = means[n, 0], means[n, 1], means[n, 2]
        middle_x = (axes[0, 0] * mx + axes[0, 1] * my + axes[0, 2] * mz - left) / cell
        middle_y = (axes[1, 0] * mx + axes[1, 1] * my + axes[1, 2] * mz - top) / cell
        middle = axes[2, 0] * mx + axes[2, 1] * my + axes[2, 2] * mz
        px, py, pz = extents[n, 0, 0], extents[n, 0, 1], extents[n, 0, 2]
        ax = (axes[0, 0] * px + axes[0, 1] * py + axes[0, 2] * pz) / cell
        ay = (axes[1, 0] * px + axes[1, 1] * py + axes[1, 2] * pz) / cell
        az = axes[2, 0] * px + axes[2, 1] * py + axes[2, 2] * pz
        px, py, pz = extents[n, 1, 0], extents[n, 1, 1], extents[n, 1, 2]
        bx = (axes[0, 0] * px + axes[0, 1] * py + axes[0, 2] * pz) / cell
        by = (axes[1, 0] * px + axes[1, 1] * py + axes[1, 2] * pz) / cell
        bz = axes[2, 0] * px + axes[2, 1] * py + axes[2, 2] * pz
        # Seen from its edge a disc is still a pixel wide.
        half_x = min(LARGEST_PX, REACH * np.sqrt(ax * ax + bx * bx) + 0.5)
        half_y = min(LARGEST_PX, REACH * np.sqrt(ay * ay + by * by) + 0.5)
        if middle_x + half_x < 0 or middle_y + half_y < 0 or middle_x - half_x > columns or middle_y - half_y > rows:
            continue
        x0, x1 = int(np.floor(middle_x - half_x)), int(np.floor(middle_x + half_x))
        y0, y1 = int(np.floor(middle_y - half_y)), int(np.floor(middle_y + half_y))
        determinant = ax * by - bx * ay
        edge_on = abs(determinant) < 0.05
        for y in range(max(0, y0), min(rows, y1 + 1)):
            for x in range(max(0, x0), min(columns, x1 + 1)):
                dx, dy = x + 0.5 - middle_x, y + 0.5 - middle_y
                depth = middle
                if not edge_on:
                    u, v = (by * dx - bx * dy) / determinant, (ax * dy - ay * dx) / determinant
                    if u * u + v * v > REACH * REACH:
                        continue
                    depth += u * az + v * bz
                nearest[y, x] = max(nearest[y, x], np.float32(depth))
