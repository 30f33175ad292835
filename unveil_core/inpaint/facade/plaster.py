"""The plaster of the houses along a facade: its colour, and what is like it."""

from __future__ import annotations

import numpy as np

from unveil_core.base.types import Float32, Mask

__all__ = ["DARKEST", "WALL_M", "likeness", "plaster_colors", "unlike_plaster"]

WALL_M, HUE, LEVEL = 1.0, 0.2, 0.4
"""Half length along the street over which the plaster's colour is read, metres, and standard deviations of hue and of brightness
(shares) within which something is plaster. Chosen on the two sample streets."""
PLASTER_M2 = 2.0
"""Area of a facade that tells the plaster's colour, square metres, where that much is known anywhere: the far edge of a house with
the sky beside it is a bright streak, and whole houses were brightened to it. From 2 to 4 on the result is the same."""
UNLIKE = 0.1
"""Difference of a colour from the plaster's, as a share, from which on it is something else."""
DARKEST = 0.05
"""Brightness below which differences are measured against this, levels from 0 to 1."""


def plaster_colors(color: Float32, known: Mask, texels_per_m: float) -> Float32:
    """(A, 3) the colour that most of the facade has, by place along the street."""
    half = max(1, int(WALL_M * texels_per_m))
    hop = max(1, half // 4)
    centres = np.arange(0, len(color) + hop, hop)
    parts = [np.s_[max(0, centre - half) : centre + half + 1 : 2, ::2] for centre in centres]
    area = 4 / texels_per_m**2 * np.array([known[part].sum() for part in parts])
    enough = (area > 0) & (area >= min(PLASTER_M2, area.max() / 2))
    wall = np.full((len(centres), 3), np.nan)
    for k in np.flatnonzero(enough):
        wall[k] = np.median(color[parts[k]][known[parts[k]]], axis=0)
    at = np.flatnonzero(np.isfinite(wall[:, 0]))
    if not len(at):
        return np.full((len(color), 3), 0.5, dtype=np.float32)
    # Not interpolated: from house to house it changes at once.
    nearest = np.abs(np.arange(len(color))[:, None] - centres[at][None]).argmin(axis=1)
    return wall[at][nearest].astype(np.float32)


def likeness(color: Float32, plaster: Float32) -> Float32:
    """(…, 1) from 0 to 1, how far a colour (…, 3) is the plaster's, in its hue first: plaster in the shade of a sill is plaster."""
    level, usual = (np.maximum(c.mean(axis=-1, keepdims=True), 0.02) for c in (color, plaster))
    hue = ((color / level - plaster / usual) ** 2).sum(axis=-1, keepdims=True)
    return np.asarray(np.exp(-hue / (2 * HUE**2) - (level / usual - 1) ** 2 / (2 * LEVEL**2)), dtype=np.float32)


def unlike_plaster(color: Float32, wall: Float32) -> Mask:
    """(…,) whether colours (…, 3) are not those of the plaster (…, 3)."""
    unlike: Mask = np.abs(color / np.maximum(wall, 1e-3) - 1).max(axis=-1) > UNLIKE
    return unlike
