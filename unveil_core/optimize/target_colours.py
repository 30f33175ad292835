"""The colours that surfels start with before they are fitted: those of the pixels that show them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unveil_core.base.types import Levels, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.semantics.visibility import points_in_view
from unveil_core.surfels.initialize import repainted
from unveil_core.surfels.surfels import Surfels

__all__ = ["coloured_by"]


def coloured_by(surfels: Surfels, some: Mask, targets: Sequence[tuple[Camera, Levels]], *, near: float) -> Surfels:
    """Surfels of which some get the mean of the pixels in which no other surfel hides their middle.

    A view counts as much as a surfel is large in it, as in the least squares of all pixels. What no view shows stays as it is.

    Args:
        some: (N,) bool.
        targets: camera and picture (H, W, 3) levels of 255.
        near: least depth, metres.
    """
    if not some.any():
        return surfels
    positions, spacing = surfels.means.double().numpy(), surfels.log_scales.exp().amax(dim=1).double().numpy()
    facing = surfels.normals().double().numpy()
    total, weight = np.zeros((len(surfels), 3)), np.zeros(len(surfels))
    for camera, picture in targets:
        seen = points_in_view(positions, spacing, camera, near=near, normals=facing)
        wanted = some[seen.index]
        index = seen.index[wanted]
        large = 1 / seen.depth[wanted] ** 2
        total[index] += large[:, None] * picture[seen.rows[wanted], seen.columns[wanted]]
        weight[index] += large
    return repainted(surfels, total / np.maximum(weight, 1e-30)[:, None] / 255, weight > 0)
