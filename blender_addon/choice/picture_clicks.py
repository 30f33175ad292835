# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a click in a 3D view lies in the picture of the camera that the view looks through."""

from __future__ import annotations

import bpy
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Vector

__all__ = ["share_of_picture"]


def share_of_picture(context: bpy.types.Context, x: float, y: float) -> tuple[float, float] | None:
    """Shares of the picture's width and height, from its upper left corner; None beside the picture.

    Args:
        context: of the view's window region; x, y: in the region, pixels from its lower left corner.
    """
    camera = context.scene.camera
    # The corners of the camera's frame, in the order upper right, lower right, lower left, upper left.
    corners = [
        location_3d_to_region_2d(context.region, context.region_data, camera.matrix_world @ corner)
        for corner in camera.data.view_frame(scene=context.scene)
    ]
    if any(c is None for c in corners):
        return None
    upper_left, lower_right = corners[3], corners[1]
    size = Vector((lower_right.x - upper_left.x, upper_left.y - lower_right.y))
    if min(size) <= 0:
        return None
    across, down = (x - upper_left.x) / size.x, (upper_left.y - y) / size.y
    return (across, down) if 0 <= across <= 1 and 0 <= down <= 1 else None
