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
SOLID = 0.5
"""Alpha above which a pixel shows a surface, a share of 1: half of the light, so that the median depth is that of something."""
ONE_SURFACE = 0.03
"""Share of the median depth within which the mean one is that of the same surface: what delivery takes for the same place, too.
Tried from 0.01 to 0.1 on the sample streets, see benchmarks/results/surface_depth.json."""


def surface_depth(out: Rendered, solid: float = SOLID) -> Float32:
    """The depth of a scene's surfaces, in metres along the optical axis (not along the ray), 0 where a pixel shows none.

    The mean depth of the light that surfels stop where it agrees with the median one, at which half of the light is stopped; where
    it does not, the median. On one surface the mean is the smoother: a road seen at a flat angle is stopped by many surfels, of
    which the median picks one. Where the light of a post and of the wall behind it meet in a pixel, the mean lies between them,
    where nothing is; the median is on one of them.

    Args:
        out: with :data:`SURFACE_PLANES`.
        solid: alpha above which a pixel shows a surface, at least that of :data:`SOLID`.
    Returns:
        (H, W) float32.
    """
    alpha, median = array(out.alpha), array(out.median_depth)
    mean = array(out.depth) / np.maximum(alpha, SOLID)
    depth = np.where(np.abs(mean - median) < ONE_SURFACE * median, mean, median)
    return np.where(alpha > solid, depth, 0).astype(np.float32)


def scene_depth(surfels: Surfels, camera: Camera, solid: float = SOLID) -> Float32:
    """(H, W) :func:`surface_depth` of a scene from a camera."""
    return surface_depth(rendered(near_camera(surfels, camera), camera, SURFACE_PLANES, near=NEAR_M, far=FAR_M), solid)
