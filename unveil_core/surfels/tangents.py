"""Tangent axes and aspect of surfels from the lines that a LiDAR leaves on a surface.

Its points are close along a line and wide across: a round surfel either leaves gaps or blurs. As *2D Gaussian Splatting*
(SIGGRAPH 2024, section 4.1) a surfel has two tangent axes with a scale each; they follow the points from the start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.geometry.cloud import neighbours_of, quats_from_normals

__all__ = ["ASPECT", "tangent_frames"]

ASPECT = 4.0
"""Largest ratio of length to width."""
ON_THE_LINE = 4


def _gap(distance: NDArray[np.float64], side: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P,) mean of the least distances (P, K) on either side, or that of the one side that has any; else inf."""
    before = np.where(side < 0, distance, np.inf).min(axis=1)
    after = np.where(side > 0, distance, np.inf).min(axis=1)
    return np.where(np.isfinite(before) & np.isfinite(after), (before + after) / 2, np.minimum(before, after))


def tangent_frames(
    positions: NDArray[np.float64], normals: NDArray[np.float64], *, neighbours: int = 16
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Tangent axes along and across the lines that points lie on, and how the spacing differs between both.

    The principal component of the nearest neighbours, projected on the tangent plane, is the direction of the line. The
    spacing is what the nearest points in either direction say: the covariance itself would say the opposite, since all of
    the nearest neighbours may lie on one line.

    Args:
        positions: (P, 3); normals: (P, 3) unit.
        neighbours: among how many the next line is looked for.
    Returns:
        quaternions (P, 4) wxyz, whose rotations have the two axes and the normal as columns; the factors (P, 2) of the
        spacing along both, of product 1 and a ratio of at most ``ASPECT``.
    """
    count = len(positions)
    k = min(neighbours, count - 1)
    quats = quats_from_normals(normals)
    if k < ON_THE_LINE:
        return quats, np.ones((count, 2))
    index = neighbours_of(positions, cKDTree(positions), k + 1)[1][:, 1:]
    w, x, y, _ = quats.T
    first = np.stack([1 - 2 * y * y, 2 * x * y, -2 * w * y], axis=1)
    offset = positions[index] - positions[:, None]
    u = np.einsum("pki,pi->pk", offset, first)
    v = np.einsum("pki,pi->pk", offset, np.cross(normals, first))
    on_u, on_v = u[:, :ON_THE_LINE], v[:, :ON_THE_LINE]
    half = 0.25 * np.arctan2(2 * np.sum(on_u * on_v, axis=1), np.sum(on_u**2 - on_v**2, axis=1))
    c, s = np.cos(2 * half)[:, None], np.sin(2 * half)[:, None]
    u, v = c * u + s * v, c * v - s * u
    reach, along = np.hypot(u, v), np.abs(u) >= np.abs(v)
    line, next_line = _gap(np.where(along, reach, np.inf), u), _gap(np.where(along, np.inf, reach), v)
    # Where all neighbours lie in one direction, nothing is known of the other.
    known = np.isfinite(line) & np.isfinite(next_line)
    ratio = np.where(known, next_line, 1.0) / np.maximum(np.where(known, line, 1.0), 1e-12)
    root = np.sqrt(np.clip(ratio, 1 / ASPECT, ASPECT))
    # The rotation about the normal comes first: quats * (cos half, 0, 0, sin half).
    c, s = np.cos(half), np.sin(half)
    turned = np.stack([w * c, x * c + y * s, y * c - x * s, w * s], axis=1)
    return turned, np.stack([1 / root, root], axis=1)
