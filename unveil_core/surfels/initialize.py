"""From points to surfels: orientation, size and colour from the points' own neighbourhoods.

The paper starts from LiDAR and SfM points (section 3.1); normals and spacing of the points spare the optimization the
work of finding them.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.kernels.hashing import slot_of
from unveil_core.base.parallel import thread_count
from unveil_core.surfels.surfels import Surfels

__all__ = ["SH_C0", "estimate_normals", "quats_from_normals", "surfels_from_points", "thin_points"]

SH_C0 = 0.28209479177387814
"""The constant spherical-harmonic basis function."""


def thin_points(positions: NDArray[np.float64], cell: NDArray[np.float64] | float) -> NDArray[np.int64]:
    """Indices of one point per cell of a grid, the first in the given order.

    Args:
        positions: (P, 3).
        cell: grid size in metres, one for all or (P,) per point (rounded to powers of two of the smallest).
    """
    size = np.broadcast_to(np.asarray(cell, dtype=np.float64), (len(positions),))
    level = np.round(np.log2(np.maximum(size / max(size.min(initial=np.inf), 1e-12), 1.0)))
    size = size.min(initial=np.inf) * 2.0**level
    key = np.floor(positions / size[:, None]).astype(np.int64)
    key = np.column_stack([key, level.astype(np.int64)])
    table = np.full(1 << int(2 * len(key)).bit_length(), -1, dtype=np.int64)
    return np.flatnonzero(_firsts(key, table))


@njit(cache=True)
def _firsts(keys, table):  # type: ignore[no-untyped-def]
    """(P,) which of the keys (P, 4) are the first of their kind; ``table``: twice as many free slots, -1."""
    first = np.zeros(len(keys), dtype=np.bool_)
    for i in range(len(keys)):
        x, y, z, level = keys[i, 0], keys[i, 1], keys[i, 2], keys[i, 3]
        slot = slot_of(slot_of(x, 1 << 62) ^ (y << 21) ^ (z << 42) ^ level, table.size)
        while True:
            other = table[slot]
            if other < 0:
                table[slot], first[i] = i, True
                break
            if keys[other, 0] == x and keys[other, 1] == y and keys[other, 2] == z and keys[other, 3] == level:
                break
            slot = (slot + 1) & (table.size - 1)
    return first


def estimate_normals(
    positions: NDArray[np.float64], viewpoints: NDArray[np.float64], *, neighbours: int = 12
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normals by principal components of each point's neighbourhood, turned towards the nearest viewpoint.

    Args:
        positions: (P, 3).
        viewpoints: (V, 3) camera centres.
        neighbours: size of the neighbourhood.
    Returns:
        unit normals (P, 3) and the spacing (P,): root mean square distance to the three nearest neighbours.
    """
    count = len(positions)
    k = min(neighbours, count - 1)
    if k < 3:
        toward = viewpoints.mean(axis=0) - positions
        return toward / np.maximum(np.linalg.norm(toward, axis=1, keepdims=True), 1e-12), np.full(count, 0.1)
    distance, index = cKDTree(positions).query(positions, k=k + 1, workers=thread_count())
    spacing = np.sqrt(np.mean(distance[:, 1:4] ** 2, axis=1))
    local = positions[index] - positions[index].mean(axis=1, keepdims=True)
    covariance = np.einsum("pki,pkj->pij", local, local)
    normal = np.linalg.eigh(covariance)[1][:, :, 0]
    nearest = cKDTree(viewpoints).query(positions)[1]
    flip = np.sum(normal * (viewpoints[nearest] - positions), axis=1) < 0
    normal[flip] *= -1
    return normal, spacing


def quats_from_normals(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Quaternions (P, 4) wxyz that turn the z axis to ``normal`` (P, 3) by the shortest way."""
    w = 1 + normal[:, 2]
    quat = np.stack([w, -normal[:, 1], normal[:, 0], np.zeros(len(normal))], axis=1)
    quat[w < 1e-6] = (0.0, 1.0, 0.0, 0.0)
    return quat / np.linalg.norm(quat, axis=1, keepdims=True)


def surfels_from_points(
    positions: NDArray[np.float64],
    colors: NDArray[np.uint8],
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
        positions: (P, 3); colors: (P, 3) uint8; labels: (P,) compact; normals: (P, 3) unit.
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
