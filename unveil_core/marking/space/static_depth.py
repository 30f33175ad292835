"""Depth of the static scene in a frame, from its points and the ground between them."""

from __future__ import annotations

import cv2
import numpy as np

from unveil_core.base.types import Float64
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.marking.space.scene_points import ScenePoints

__all__ = ["static_depth"]

REACH = 0.02
"""A pixel has the depth of the nearest point in the picture within this share of its width; beyond, that of the ground."""


def static_depth(camera: Camera, small: Camera, points: ScenePoints, frame: int) -> Float64:
    """(H, W) metres along the optical axis, inf where neither a point nor the ground is known.

    Args:
        camera: of the points' view; small: the same in the size (H, W) that is asked for.
        frame: the index of the camera's frame among those of the points' views.
    """
    shape = (small.height, small.width)
    found = np.full(shape, np.inf)
    if points.ground is not None:
        found = points.ground.depth(small, np.ones(shape, dtype=bool), near=NEAR_M, far=FAR_M)
    seen = points.views[frame]
    if not len(seen.index):
        return found
    order = np.argsort(-seen.depth)  # the nearest last
    depth = np.zeros(shape)
    rows, columns = seen.rows * shape[0] // camera.height, seen.columns * shape[1] // camera.width
    depth[rows[order], columns[order]] = seen.depth[order]
    away, label = cv2.distanceTransformWithLabels(
        (depth == 0).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    table = np.zeros(int(label.max()) + 1)
    table[label[depth > 0]] = depth[depth > 0]
    near = away <= max(2.0, REACH * small.width)
    return np.where(near, table[label], found)
