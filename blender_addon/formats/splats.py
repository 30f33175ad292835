# SPDX-License-Identifier: GPL-3.0-or-later
"""Points and surfels as small faces in one mesh: what the Solid view shows in colour. Geometry only, no bpy here."""

from __future__ import annotations

import numpy as np

from .ply_file import Ply

__all__ = ["SH_C0", "discs", "fair_share", "surfel_discs", "tetrahedra"]

SH_C0 = 0.28209479177387814
TETRA = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]) / np.sqrt(3.0)
TETRA_FACES = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
"""Turned outwards."""
LOG_SCALES = -40.0, 15.0
"""Natural logarithms of the shortest and longest extent that is drawn, metres."""
SIGMAS = 1.5
"""Half the edge of a disc's square, standard deviations."""


def fair_share(count: int, most: int, seed: int = 0) -> np.ndarray:
    """Indices of at most so many of ``count`` things, picked evenly, in order."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(seed).choice(count, most, replace=False))


def tetrahedra(centres: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A tetrahedron per point: vertices (4 N, 3) and triangles (4 N, 3).

    Args:
        centres: (N, 3); radius: (N,) of their corners.
    """
    vertices = (centres[:, None] + TETRA[None] * radius[:, None, None]).reshape(-1, 3)
    faces = (np.arange(len(centres))[:, None, None] * 4 + TETRA_FACES[None]).reshape(-1, 3)
    return vertices.astype(np.float32), faces.astype(np.int32)


def discs(centres: np.ndarray, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A square per disc: vertices (4 N, 3) and quads (N, 4).

    Args:
        centres, first, second: (N, 3) middle and both half edges.
    """
    corners = [centres + i * first + j * second for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    vertices = np.stack(corners, axis=1).reshape(-1, 3)
    return vertices.astype(np.float32), np.arange(4 * len(centres), dtype=np.int32).reshape(-1, 4)


def surfel_discs(ply: Ply) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Middle (N, 3), both half edges (N, 3) in the file's coordinates, and colours (N, 3) uint8 of its surfels.

    Raises:
        ValueError: it is no file of surfels.
    """
    table = ply.vertices
    try:
        quats = np.stack([table[f"rot_{i}"] for i in range(4)], axis=1).astype(np.float64)
        logs = np.stack([table["scale_0"], table["scale_1"]], axis=1).astype(np.float64)
        flat = np.stack([table[f"f_dc_{i}"] for i in range(3)], axis=1)
        if not all(np.isfinite(values).all() for values in (quats, logs, flat)):
            raise ValueError("a number is not finite")
        scales = np.exp(np.clip(logs, *LOG_SCALES))
    except (KeyError, ValueError) as error:
        raise ValueError(f"holds no surfels: {error}") from error
    w, x, y, z = (quats / np.maximum(np.linalg.norm(quats, axis=1, keepdims=True), 1e-12)).T
    first = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1)
    second = np.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], axis=1)
    colors = np.clip(np.round((flat * SH_C0 + 0.5) * 255), 0, 255).astype(np.uint8)
    return ply.positions, first * scales[:, :1] * SIGMAS, second * scales[:, 1:] * SIGMAS, colors
