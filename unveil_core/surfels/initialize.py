"""From points to surfels: orientation, size and colour from the points' own neighbourhoods.

The paper starts from LiDAR and SfM points (section 3.1); normals and spacing of the points spare the optimization the
work of finding them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.base.types import Levels
from unveil_core.geometry.cloud import quats_from_normals
from unveil_core.surfels.surfels import Surfels

__all__ = ["SH_C0", "repainted", "surfels_from_points"]

SH_C0 = 0.28209479177387814
"""The constant spherical-harmonic basis function."""


def repainted(surfels: Surfels, colors: NDArray[np.floating[Any]], some: NDArray[np.bool_]) -> Surfels:
    """Surfels of which some, (N,) bool, have other colours (N, 3) in [0, 1], the same from all directions."""
    sh = surfels.sh.clone()
    chosen = torch.from_numpy(some)
    sh[chosen] = 0
    sh[chosen, 0] = torch.from_numpy(((colors[some] - 0.5) / SH_C0).astype(np.float32))
    return replace(surfels, sh=sh)


def surfels_from_points(
    positions: NDArray[np.float64],
    colors: Levels,
    labels: NDArray[np.int64],
    normals: NDArray[np.float64],
    spacing: NDArray[np.float64],
    *,
    quats: NDArray[np.float64] | None = None,
    sh_degree: int = 0,
    opacity: float = 0.5,
    scale_factor: float = 0.8,
) -> Surfels:
    """One surfel per point.

    Args:
        positions: (P, 3); colors: (P, 3) levels of 255; labels: (P,) compact; normals: (P, 3) unit.
        spacing: (P,) metres, or (P, 2) along both tangent axes of ``quats`` (P, 4), see ``tangent_frames``.
        sh_degree: degree of the colour; higher coefficients start at zero.
        opacity: starting opacity.
        scale_factor: standard deviation as a share of the spacing.
    """
    sh = np.zeros((len(positions), (sh_degree + 1) ** 2, 3), dtype=np.float32)
    sh[:, 0] = (colors.astype(np.float64) / 255 - 0.5) / SH_C0
    quats = quats_from_normals(normals) if quats is None else quats
    spacing = np.broadcast_to(spacing[:, None] if spacing.ndim == 1 else spacing, (len(positions), 2))
    scale = np.log(np.maximum(spacing * scale_factor, 1e-7))
    return Surfels(
        means=torch.from_numpy(positions.astype(np.float32)),
        quats=torch.from_numpy(quats.astype(np.float32)),
        log_scales=torch.from_numpy(scale.astype(np.float32)),
        opacity_logits=torch.full((len(positions),), float(np.log(opacity / (1 - opacity)))),
        sh=torch.from_numpy(sh),
        labels=torch.from_numpy(labels.astype(np.int64)),
    )
