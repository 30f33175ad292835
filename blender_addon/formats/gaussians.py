# SPDX-License-Identifier: GPL-3.0-or-later
"""A file of surfels as the Gaussians that splat renderers draw: extents, rotation, harmonics. No bpy here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .ply_file import Ply

__all__ = ["THIN_M", "Gaussians", "gaussians_of"]

THIN_M = 1e-4
"""Third extent of a surfel, which is a disc, and the least of any: metres, as the files have it. An extent of zero would have no
logarithm, and Blender packs logarithms over the range from the least extent to the greatest."""
MOST_M = 1e4
"""The greatest extent, metres: no street is longer, and a number beyond would overflow."""
LONGEST_M, SHARE_OF_DISTANCE, TIMES_WIDTH = 1.0, 0.05, 2.0
"""What a Gaussian may have, metres wherever it lies, of the distance to the nearest camera, or times its second extent: the most of
the three. The optimization sees it from the street alone, and nothing holds the far end of a needle. As ``unveil export`` has it
(``unveil_core/exports/splats/shortened.py`` tells how the numbers were found), so both show the same."""
CHUNK = 4096
"""Gaussians whose distances to all cameras are in memory at a time."""
NO_CAMERAS = np.zeros((0, 3))
BANDS = (0, 3, 8, 15, 24)
"""Coefficients of a channel beside the constant one, by the degree of the harmonics; Blender draws up to the fourth."""


@dataclass(frozen=True, eq=False)
class Gaussians:
    """N of them, all float32.

    Attributes:
        positions: (N, 3) in the scene's units.
        scales: (N, 3) standard deviations along their own axes, in the scene's units, not their logarithms.
        rotations: (N, 4) unit quaternions w, x, y, z.
        base: (N, 4) the harmonics' constant coefficients of red, green and blue, and the opacity from 0 to 1.
        harmonics: (K, N, 3) the further coefficients, each with its red, green and blue.
    """

    positions: np.ndarray
    scales: np.ndarray
    rotations: np.ndarray
    base: np.ndarray
    harmonics: np.ndarray

    def __len__(self) -> int:
        return len(self.positions)


def gaussians_of(ply: Ply, metre: float, chosen: np.ndarray, cameras: np.ndarray = NO_CAMERAS) -> Gaussians:
    """The Gaussians of a file.

    Args:
        ply: what it holds.
        metre: units of the scene in a metre.
        chosen: indices of those that are wanted.
        cameras: (C, 3) where the drive's are, metres; with none, extents are as the file has them.
    Raises:
        ValueError: it is no file of surfels.
    """
    table = ply.vertices[chosen]
    names = table.dtype.names or ()
    thin = ("scale_2",) if "scale_2" in names else ()
    try:
        logs = _columns(table, "scale_0", "scale_1", *thin)
        rotations = _columns(table, "rot_0", "rot_1", "rot_2", "rot_3")
        colors, opacity = _columns(table, "f_dc_0", "f_dc_1", "f_dc_2"), _columns(table, "opacity")
        further = _harmonics(table, names)
        if not all(np.isfinite(part).all() for part in (logs, rotations, colors, opacity, further)):
            raise ValueError("a number is not finite")
    except (KeyError, ValueError) as error:
        raise ValueError(f"holds no surfels: {error}") from error
    scales = np.full((len(table), 3), THIN_M)
    scales[:, : logs.shape[1]] = np.exp(np.clip(logs, np.log(THIN_M), np.log(MOST_M)))
    _shorten(scales, ply.positions[chosen], cameras)
    length = np.linalg.norm(rotations, axis=1, keepdims=True)
    rotations = np.where(length > 1e-12, rotations / np.maximum(length, 1e-12), (1.0, 0.0, 0.0, 0.0))
    return Gaussians(
        positions=(ply.positions[chosen] * metre).astype(np.float32),
        scales=(scales * metre).astype(np.float32),
        rotations=rotations.astype(np.float32),
        base=np.concatenate([colors, 1 / (1 + np.exp(-np.clip(opacity, -60, 60)))], axis=1).astype(np.float32),
        harmonics=further,
    )


def _shorten(scales: np.ndarray, positions: np.ndarray, cameras: np.ndarray) -> None:
    """Bring extents (N, 3), in place, to what :data:`LONGEST_M` and the others allow; all in metres."""
    ordered = np.sort(scales, axis=1)
    most = np.maximum(LONGEST_M, TIMES_WIDTH * ordered[:, 1])
    long = np.flatnonzero(ordered[:, 2] > most)
    for part in np.split(long, range(CHUNK, len(long), CHUNK)) if len(cameras) else ():
        away = np.linalg.norm(positions[part, None].astype(np.float64) - cameras, axis=2).min(axis=1)
        scales[part] = np.minimum(scales[part], np.maximum(most[part], SHARE_OF_DISTANCE * away)[:, None])


def _columns(table: np.ndarray, *names: str) -> np.ndarray:
    return np.stack([table[name].astype(np.float64) for name in names], axis=1)


def _harmonics(table: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """Whole bands of the further coefficients; the file has all of red, then of green, then of blue."""
    there = sum(name.startswith("f_rest_") for name in names) // 3
    kept = max(count for count in BANDS if count <= there)
    found = np.empty((kept, len(table), 3), np.float32)
    for number in range(kept):
        for channel in range(3):
            found[number, :, channel] = table[f"f_rest_{channel * there + number}"]
    return found
