"""Trunks and posts whose feet a removed object hides, carried down to the ground.

A crown or a lamp that ends where a car's roof was would float. The lowest slice that is seen of something slim is repeated
downwards, where a removed object hides the place and no frame looks through it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.clusters import connected_points
from unveil_core.geometry.images import border_px, grow
from unveil_core.ground.street import Ground
from unveil_core.inpaint.facade.facade_chart import FacadeView
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["carried_down"]

LOW_M, HANGS_M, HIGH_M = 0.25, 2.0, 2.6
"""Heights over the ground, metres: what begins over the first, a kerb, lacks its foot; what begins over the second hangs, for cars
hide nothing so high; up to the third stems are looked for, below most crowns and signs."""
SLIM_M, LINK_M, FEWEST = 0.6, 0.2, 25
"""Greatest thickness of a stem, largest horizontal gap within it, metres, and its fewest surfels."""
APART_M = 2.0
"""Distance within which plants have one trunk, metres: tufts of a low crown hang side by side, higher than the trunk reaches."""
FRINGE_M, SLICE_M = 0.1, 0.4
"""Length above the lowest surfels that is left out, for its colours are mixed with what hid it, and of the slice above, metres."""
BEHIND = 1.1
"""Ratio of what a frame sees to a place's depth from which on it looks through the place: nothing stands there."""
SIDES = 6
"""Of a stem, each of one colour."""
FLOOR_M = 0.05
"""How far under the ground a repeated surfel may lie, metres."""


def carried_down(
    standing: Surfels, plants: Sequence[int], ground: Ground, views: Sequence[FacadeView]
) -> Surfels | None:
    """Surfels for the hidden lower ends of stems; None where none is hidden.

    Args:
        standing: surfels of plants, posts, signs and lights that stay.
        plants: labels of those that have one trunk where many parts hang.
        ground: of the street; views: what the frames show.
    """
    path = ground.path
    means = standing.means.detach().double().numpy()
    height = ground.over(path.to_street(means))
    low = np.flatnonzero((standing.opacity_logits.detach().numpy() > 0) & (height > 0) & (height < HIGH_M))
    if len(low) < FEWEST:
        return None
    across = (means[low] @ path.axes.T)[:, :2]
    group = connected_points(across, LINK_M)
    stems: list[tuple[float, NDArray[np.int64], Float64]] = []
    for g in np.unique(group):
        members = np.flatnonzero(group == g)
        begins = float(np.percentile(height[low[members]], 3))
        # Higher up it may carry a crown.
        members = members[height[low[members]] < begins + FRINGE_M + SLICE_M]
        if len(members) < FEWEST or not LOW_M < begins < HANGS_M:
            continue
        if np.ptp(np.percentile(across[members], [10, 90], axis=0), axis=0).max() < SLIM_M:
            stems.append((begins, low[members], across[members].mean(axis=0)))
    parts: list[Surfels] = []
    trunks: list[Float64] = []
    is_plant = np.isin(standing.labels.numpy(), plants)
    for begins, index, stands in sorted(stems, key=lambda stem: stem[0]):
        if is_plant[index].mean() > 0.5:
            if any(np.linalg.norm(stands - other) < APART_M for other in trunks):
                continue
            trunks.append(stands)
        parts += _repeated(standing, index, height[index], begins + FRINGE_M, path.axes[2])
    if not parts:
        return None
    feet = concatenate(parts)
    feet = feet.select(torch.from_numpy(_only_hidden(feet.means.detach().double().numpy(), views)))
    return feet if len(feet) else None


def _repeated(standing: Surfels, index: NDArray[np.int64], height: Float64, start: float, up: Float64) -> list[Surfels]:
    """Copies down to the ground of a stem's slice over ``start`` metres, of surfels ``index`` (K,) at ``height`` (K,)."""
    chosen = height >= start
    if not chosen.any():
        return []
    part, height = standing.select(torch.from_numpy(index[chosen])), height[chosen]
    # Of one colour all along, on each of its sides: what differs by height would become a row of dashes.
    aside = part.means.detach().double().numpy()
    aside = aside - (aside @ up)[:, None] * up
    beside = cKDTree(aside).query(aside, k=min(len(part), max(2, len(part) // SIDES)))[1]
    part = replace(part, sh=part.sh[torch.from_numpy(np.reshape(beside, (len(part), -1)))].median(dim=1).values)
    copies = []
    for down in SLICE_M * np.arange(1, int(np.ceil((start + SLICE_M) / SLICE_M)) + 1):
        copy = part.select(torch.from_numpy(height - down > -FLOOR_M))
        copies.append(replace(copy, means=copy.means - down * torch.from_numpy(up).to(copy.means)))
    return copies


def _only_hidden(places: Float64, views: Sequence[FacadeView]) -> Mask:
    """Which places (N, 3) a removed object hides in some view, and through which none looks."""
    hidden, through = np.zeros((2, len(places)), dtype=bool)
    for view in views:
        which, pixel, z = view.camera.shown(places)
        x, y = pixel.astype(np.int64).T
        hidden[which[view.removed[y, x]]] = True
        # At the border of what is removed pixels are mixed.
        clear = ~grow(view.removed, border_px(view.camera.width, 1))[y, x]
        through[which[clear & (view.depth[y, x] > BEHIND * z)]] = True
    return hidden & ~through
