"""Where each pixel of a clean frame has its colour from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.types import Mask
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.origin import CONTINUED, ORIGIN_COUNT, ORIGINAL, RELIT, SEEN_ELSEWHERE
from unveil_core.raster.near_camera import near_camera
from unveil_core.raster.on_device import array
from unveil_core.raster.on_device import rendered as rendered_planes
from unveil_core.surfels.surfels import Surfels
from unveil_core.view.surface import SURFACE_PLANES, surface_depth

__all__ = ["frame_origins", "marked_by", "rendered_origins"]

Origins = NDArray[np.uint8]


def marked_by(surfels: Surfels, origins: Origins) -> Surfels:
    """The surfels with their origins (M,) as labels."""
    return replace(surfels, labels=torch.from_numpy(origins.astype(np.int64)))


def rendered_origins(marked: Surfels, camera: Camera) -> tuple[Origins, NDArray[np.float32]]:
    """(H, W) the origin that has most weight in each pixel of a rendered scene, and (H, W) its depth, see
    :func:`unveil_core.view.surface.surface_depth`.

    The sky counts as seen elsewhere: it is a panorama of what all frames show of it.

    Args:
        marked: M surfels, see :func:`marked_by`.
    """
    planes = (*SURFACE_PLANES, "semantics")
    near = near_camera(marked, camera)
    out = rendered_planes(near, camera, planes, label_count=ORIGIN_COUNT, near=NEAR_M, far=FAR_M)
    weight = array(out.semantics).copy()
    weight[..., SEEN_ELSEWHERE] += 1 - array(out.alpha)
    return weight.argmax(axis=2).astype(np.uint8), surface_depth(out)


def frame_origins(rendered: Origins, inpainted: Origins, optimized: Mask, shadows: Mask, unobserved: Mask) -> Origins:
    """(H, W) origins of a clean frame.

    Args:
        rendered: (H, W) of the optimized scene; inpainted: (H, W) of the inpainted frame, with SEEN_ELSEWHERE for all surfels.
        optimized: (H, W) pixels that show the optimized scene; shadows: (H, W) pixels that show the inpainted frame.
        unobserved: (H, W) pixels behind which lies what no frame shows.
    """
    from_surfels = optimized | (inpainted == SEEN_ELSEWHERE)
    origin = np.where(from_surfels, rendered, inpainted)
    # A surface reaches a little into what no frame shows; it was fitted to what lies beside that.
    origin[unobserved & ((origin == SEEN_ELSEWHERE) | (origin == RELIT))] = CONTINUED
    origin[~(optimized | shadows)] = ORIGINAL
    return origin.astype(np.uint8)
