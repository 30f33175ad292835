"""The depth of a scene in a picture: the one definition that Python, plates, mesh, provenance, delivery and evaluation share."""

from __future__ import annotations

import numpy as np

from unveil_core.base.types import Float32
from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.raster.api import Rendered
from unveil_core.raster.near_camera import near_camera
from unveil_core.raster.on_device import array, rendered
from unveil_core.surfels.surfels import Surfels

__all__ = ["ONE_SURFACE", "SOLID", "SURFACE_PLANES", "scene_depth", "surface_depth"]

SURFACE_PLANES = ("alpha", "depth", "median_depth")
"""Planes that :func:`surface_depth` follows from; the rasterizer makes the two depths in one pass."""
ONE_SURFACE = 0.03
"""Share of the median depth within which the mean one is that of the same surface: what delivery takes for the same place, too.
Tried from 0.01 to 0.1 on the sample street, see benchmarks/results/surface_depth.json."""
SOLID = 0.5
"""Alpha above which a pixel shows a surface: half of the light, so that the median depth is that of something. The few pixels
between this and 0.7 are right more often than wrong, and a fifth of them are the sky, see the same file."""


def surface_depth(out: Rendered) -> Float32:
    """The depth of a scene's surfaces, in metres along the optical axis (not along the ray), 0 where a pixel shows none.

    A pixel shows a surface where surfels stop more than :data:`SOLID` of its light. Its depth is the mean of where that light is
    stopped if the mean agrees with the median, else the median, at which half of the light is stopped. On one surface the mean is
    the smoother: at a road seen at a flat angle many surfels stop light, of which the median picks one. Where the light of a post
    and of the wall behind it meet in a pixel, the mean lies between them, where nothing is; the median is on one of them.

    Args:
        out: with :data:`SURFACE_PLANES`.
    Returns:
        (H, W) float32.
    """
    alpha, median = array(out.alpha), array(out.median_depth)
    mean = array(out.depth) / np.maximum(alpha, SOLID)
    depth = np.where(np.abs(mean - median) < ONE_SURFACE * median, mean, median)
    return np.where(alpha > SOLID, depth, 0).astype(np.float32)


def scene_depth(surfels: Surfels, camera: Camera) -> Float32:
    """(H, W) :func:`surface_depth` of a scene from a camera."""
    return surface_depth(rendered(near_camera(surfels, camera), camera, SURFACE_PLANES, near=NEAR_M, far=FAR_M))
