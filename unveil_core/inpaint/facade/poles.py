"""Trunks, poles and signs whose feet a parked car hides: what stands goes on down to the ground."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.geometry.clusters import connected_points
from unveil_core.geometry.images import border_px, grow
from unveil_core.ground.street import Ground
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["feet_of_uprights"]

LOW_M, HIGH_M = 0.25, 2.6
"""Heights over the ground between which something narrow is looked for, and its foot is missing where it begins above the first,
metres."""
HANGS_M = 2.0
"""What begins above this hangs, metres."""
NARROW_M, LINK_M, LEAST = 0.6, 0.2, 25
"""Its thickness at most, the gap that still belongs to it, metres, and how many surfels it must have."""
FRINGE_M, SLICE_M = 0.1, 0.4
"""What is left out above where it begins, for there it is mixed with what hid it, and the length that is repeated, metres."""
BEHIND = 1.1
"""Where the scene is farther away than so many times the depth, something else was seen through the place."""


def feet_of_uprights(
    standing: Surfels, ground: Ground, cameras: Sequence[Camera], depths: Sequence[NDArray[np.float32]],
    removed: Sequence[NDArray[np.bool_]],
) -> Surfels | None:  # fmt: skip
    """Surfels for the hidden lower ends of what stands upright and is narrow; None where none is hidden.

    Args:
        standing: surfels of plants, poles and signs.
        cameras, depths, removed: the views, depth (H, W) of the full scene and what is removed (H, W) bool.
    """
    path = ground.path
    means = standing.means.detach().double().numpy()
    street = path.to_street(means)
    height = ground.over(street)
    opaque = standing.opacity_logits.detach().numpy() > 0
    low = np.flatnonzero(opaque & (height > 0) & (height < HIGH_M))
    if len(low) < LEAST:
        return None
    across = (means[low] @ path.axes.T)[:, :2]
    group = connected_points(across, LINK_M)
    parts = []
    for g in np.unique(group):
        own = np.flatnonzero(group == g)
        if len(own) < LEAST:
            continue
        begins = float(np.percentile(height[low[own]], 3))
        # Higher up it may carry a crown.
        own = own[height[low[own]] < begins + (FRINGE_M + SLICE_M)]
        thick = np.ptp(np.percentile(across[own], [10, 90], axis=0), axis=0).max()
        if thick < NARROW_M and LOW_M < begins < HANGS_M:
            parts += _repeated(standing, low[own], height[low[own]], begins, path.axes[2])
    if not parts:
        return None
    feet = concatenate(parts)
    feet = feet.select(torch.from_numpy(_hidden(feet, cameras, depths, removed)))
    return feet if len(feet) else None


def _repeated(
    standing: Surfels, own: NDArray[np.int64], height: NDArray[np.float64], begins: float, up: NDArray[np.float64]
) -> list[Surfels]:  # fmt: skip
    """The lowest slice of an upright, again and again down to the ground."""
    start = begins + FRINGE_M
    chosen = (height >= start) & (height < start + SLICE_M)
    if chosen.sum() < LEAST / 5:
        return []
    part, at = standing.select(torch.from_numpy(own[chosen])), height[chosen]
    copies = []
    for k in range(1, int(np.ceil(start / SLICE_M)) + 1):
        down = k * SLICE_M
        stays = torch.from_numpy(at - down > -0.05)
        copy = part.select(stays)
        copies.append(replace(copy, means=copy.means - down * torch.from_numpy(up).to(copy.means)))
    return copies


def _hidden(
    feet: Surfels,
    cameras: Sequence[Camera],
    depths: Sequence[NDArray[np.float32]],
    removed: Sequence[NDArray[np.bool_]],
) -> NDArray[np.bool_]:
    """(N,) bool, what something removed hides in some view, and through which no view saw anything farther off."""
    means = feet.means.detach().double().numpy()
    asked, through = np.zeros(len(means), dtype=bool), np.zeros(len(means), dtype=bool)
    for camera, depth, gone in zip(cameras, depths, removed, strict=True):
        pixel, z = camera.project(means)
        inside = np.flatnonzero(camera.in_picture(pixel, z))
        x, y = pixel[inside].astype(np.int64).T
        asked[inside[gone[y, x]]] = True
        # At the border of what is removed pixels are mixed.
        clear = ~grow(gone, border_px(camera.width, 1))[y, x]
        through[inside[clear & (depth[y, x] > BEHIND * z[inside])]] = True
    return asked & ~through
