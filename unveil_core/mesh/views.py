"""Depth views of a surfel scene, for fusing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.frame_cache import Frames
from unveil_core.drives.drive import Frame
from unveil_core.mesh.tsdf import DepthView
from unveil_core.raster.near_camera import near_camera
from unveil_core.raster.on_device import array, rendered
from unveil_core.surfels.surfels import Surfels
from unveil_core.view.surface import SURFACE_PLANES, surface_depth

__all__ = ["depth_views"]


def depth_views(
    surfels: Surfels,
    frames: Sequence[Frame],
    *,
    near: float,
    far: float,
    without: Sequence[NDArray[np.bool_]] | None = None,
) -> Sequence[DepthView]:
    """Depth and colour of the frames' cameras, where the surfels are solid, made when they are asked for.

    Args:
        without: per frame (H, W), pixels that are left out.
    """

    def view(i: int) -> DepthView:
        camera = frames[i].camera
        out = rendered(near_camera(surfels, camera), camera, ("rgb", *SURFACE_PLANES), near=near, far=far)
        rgb = np.clip(array(out.rgb) / np.maximum(array(out.alpha), 1e-3)[..., None], 0, 1)
        depth = surface_depth(out)
        return DepthView(camera, depth if without is None else np.where(without[i], 0, depth), rgb)

    return Frames(len(frames), view)
