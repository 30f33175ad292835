"""New surfels for invented pixels, on the completed depth: they carry what one view invents to all others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Levels
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.chart.surface import OPACITY, SCALE_FACTOR
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels

__all__ = ["seed_pixels"]


def seed_pixels(
    camera: Camera,
    color: Levels,
    depth: NDArray[np.float64],
    label: NDArray[np.int64],
    mask: NDArray[np.bool_],
    *,
    sh_degree: int,
) -> Surfels:
    """One surfel per pixel of ``mask``, facing the camera, as large as the pixel there.

    Args:
        color: (H, W, 3) levels of 255; depth: (H, W) along the optical axis; label: (H, W) compact.
    """
    rows, columns = np.nonzero(mask)
    z = depth[rows, columns]
    rays = camera.rays()[rows, columns]
    positions = camera.centre + z[:, None] * rays
    normal = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return surfels_from_points(
        positions,
        color[rows, columns],
        label[rows, columns],
        normal,
        z / camera.fx,
        sh_degree=sh_degree,
        opacity=OPACITY,
        scale_factor=SCALE_FACTOR,
    )
