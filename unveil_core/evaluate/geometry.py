"""Distance between a reconstructed and the true surface: Chamfer distance and F-score of points.

*3D StreetUnveiler*, section 4, holds points of the mesh against LiDAR: the Chamfer distance and the F-score at 0.25 m.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64
from unveil_core.geometry.camera import Camera

__all__ = ["SurfaceDistances", "depth_points", "surface_distances"]


@dataclass(frozen=True, eq=False)
class SurfaceDistances:
    """Distances between two sets of points, metres.

    Attributes:
        to_true: (P,) from each found point to the nearest true one; to_found: (Q,) the other way.
    """

    to_true: NDArray[np.float64]
    to_found: NDArray[np.float64]

    @property
    def chamfer(self) -> float:
        """Mean of the two mean distances; infinite where one side has no point."""
        if not len(self.to_true) or not len(self.to_found):
            return float("inf")
        return float((self.to_true.mean() + self.to_found.mean()) / 2)

    def precision(self, threshold: float) -> float:
        """Share of the found points within the threshold of a true one."""
        return float(np.mean(self.to_true <= threshold)) if len(self.to_true) else 0.0

    def recall(self, threshold: float) -> float:
        """Share of the true points within the threshold of a found one."""
        return float(np.mean(self.to_found <= threshold)) if len(self.to_found) else 0.0

    def f_score(self, threshold: float) -> float:
        """Harmonic mean of precision and recall."""
        p, r = self.precision(threshold), self.recall(threshold)
        return 2 * p * r / (p + r) if p + r > 0 else 0.0


def surface_distances(
    found: Float64, true: Float64, *, reference: Float64 | None = None, crop: float | None = None
) -> SurfaceDistances:
    """Nearest distances both ways.

    Args:
        found: (P, 3) points of the reconstruction; true: (Q, 3) points of the true surface that should be found.
        reference: (R, 3) true points that found ones may lie on, where these reach farther than ``true``.
        crop: found points farther than this from every true point do not count: the truth does not cover them.
    """
    reference = true if reference is None else reference
    if not len(found) or not len(true):
        return SurfaceDistances(np.full(len(found), np.inf), np.full(len(true), np.inf))
    to_true = cKDTree(reference).query(found)[0]
    to_found = cKDTree(found).query(true)[0]
    return SurfaceDistances(to_true if crop is None else to_true[to_true <= crop], to_found)


def depth_points(camera: Camera, depth: NDArray[np.floating], keep: NDArray[np.bool_]) -> Float64:
    """(P, 3) world points of a depth image, (H, W) along the optical axis; the camera may have another resolution.

    Args:
        keep: (H, W), which pixels count; those without finite positive depth never do.
    """
    height, width = depth.shape
    view = camera if (camera.width, camera.height) == (width, height) else camera.resized(width, height)
    good = keep & np.isfinite(depth) & (depth > 0)
    points: Float64 = view.centre + depth[good].astype(np.float64)[:, None] * view.rays()[good]
    return points
