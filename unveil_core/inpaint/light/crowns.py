"""Completes the crowns of trees for the shadow map: a drive sees the near side of a crown, and the whole of it stops the sun.

A crown is assumed symmetric about its trunk: its surfels are repeated, turned by half a turn.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.clusters import connected_points
from unveil_core.ground.street import Ground
from unveil_core.surfels.surfels import Surfels

__all__ = ["CROWN_M", "FOOT_M", "complete_crowns", "trunk_places", "turned_half"]

FOOT_M = (0.4, 1.6)
"""Heights over the ground between which a tree is only its trunk, metres: of street trees, kept clear for traffic; not of
conifers and hedges, which are left as they are."""
THICK_M = 0.9
"""Widest extent of a trunk, metres; wider things at this height are bushes. Old plane trees are wider and are not completed."""
CROWN_M = 4.0
"""Radius of a crown about its trunk, metres: of street trees."""
LEAST = 8
"""Fewest surfels of a trunk. Chosen on the two sample streets."""
CELL_M = 0.25
"""Cells of the ground in which low surfels are put together to trunks, metres: cells that touch are one."""


def complete_crowns(plants: Surfels, ground: Ground) -> Surfels:
    """The far sides of trees.

    Args:
        plants: surfels of vegetation.
        ground: what they stand on.
    Returns:
        what is to be added, possibly nothing.
    """
    path = ground.path
    means = plants.means.detach().double().numpy()
    street = path.to_street(means)
    height = ground.over(street)
    local = means @ path.axes.T
    crown = np.flatnonzero(height > FOOT_M[1])
    low = local[(height > FOOT_M[0]) & (height <= FOOT_M[1]), :2]
    trunks = trunk_places(low, local[crown, :2])
    if not len(trunks):
        return plants.select(torch.zeros(len(plants), dtype=torch.bool))
    distance, nearest = cKDTree(trunks).query(local[crown, :2])
    near = distance < CROWN_M
    crown, trunk = crown[near], trunks[nearest[near]]
    which = np.zeros(len(plants), dtype=bool)
    which[crown] = True
    return turned_half(plants, which, trunk, ground)


def turned_half(plants: Surfels, which: Mask, trunks: Float64, ground: Ground) -> Surfels:
    """The M surfels of a mask (N,), each turned by half a turn about an upright line, ``trunks`` (M, 2) along the ground's axes."""
    path, part = ground.path, plants.select(torch.from_numpy(which))
    turned = part.means.detach().double().numpy() @ path.axes.T
    turned[:, :2] = 2 * trunks - turned[:, :2]
    # Half a turn about the unit vector u is the quaternion (0, u).
    up = torch.from_numpy(path.axes[2]).to(part.quats)
    w, v = part.quats[:, :1], part.quats[:, 1:]
    quats = torch.cat([-(v @ up)[:, None], w * up + torch.linalg.cross(up.expand_as(v), v)], dim=1)
    return replace(part, means=torch.from_numpy(turned @ path.axes).to(part.means), quats=quats)


def trunk_places(low: Float64, high: Float64) -> Float64:
    """(T, 2) middles of trunks: narrow near the ground (N, 2 horizontal positions ``low``), with something above (``high``)."""
    if not len(low) or not len(high):
        return np.zeros((0, 2))
    index = np.floor((low - low.min(axis=0)) / CELL_M).astype(np.int64)
    places, member = np.unique(index, axis=0, return_inverse=True)
    # Cells that touch, also at a corner, belong together.
    group = connected_points(places.astype(np.float64), 1.5)[member.ravel()]
    above = cKDTree(high)
    middles = []
    for g in np.unique(group):
        foot = low[group == g]
        if len(foot) < LEAST or np.ptp(np.percentile(foot, [5, 95], axis=0), axis=0).max() > THICK_M:
            continue
        middle = np.median(foot, axis=0)
        if above.query_ball_point(middle, CROWN_M / 2, return_length=True) >= 5 * LEAST:
            middles.append(middle)
    return np.array(middles).reshape(-1, 2)
