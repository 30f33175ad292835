"""Fewer splats that look alike from the drive: those that share a small angle become one.

What a splat is worth on a page is its opacity times the area that is seen of it. Splats within a cell are merged, and the cells
grow with the distance from the drive's cameras, so that each is seen under about the same angle: what is far loses first, and
nowhere is a hole, as there would be if the least were left out.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from unveil_core.base.types import Float32, Float64
from unveil_core.geometry.transforms import rotation_to_quat
from unveil_core.raster.spec import ALPHA_MAX
from unveil_core.report.scene.splats import Splats, slices
from unveil_core.surfels.surfels import rotations

__all__ = ["MOST_SPLATS", "within_budget"]

MOST_SPLATS = 150_000
"""On a page: 4 MB of its text, and what a phone's graphics draw many times a second."""
NEAREST_M = 2.0
"""Nearer than so a viewer's camera rarely is, metres: cells do not become smaller."""
FINEST = 0.002
"""Angle of the first cells that are tried, radians: two pixels of a usual picture."""
STEPS = 4
"""Sizes of cells between one and its double."""
SMALLEST = FINEST / 100
"""Smaller cells hold the same splats, which lie in one place."""
CLOSE_ENOUGH, SAME, MOST_TRIES = 0.95, 1.02, 60
"""The angle is searched by halving until so much of the budget is used, or angles differ by no more; some ten times. The last is a
limit for scenes of any size: cells grow by 2^60."""
OVERLAP = 0.6
"""Splats that together stop more light than one can are made larger instead, to a standard deviation of at most so much of their
cell: neighbours then overlap as those of a trained scene do, and leave no gaps."""
PRIMES = np.array([73856093, 19349669, 83492791, 2654435761, 97531, 7919], dtype=np.uint64)
"""Mix the numbers of a cell to one; two of a million cells that fall together do no harm."""


def within_budget(splats: Splats, eyes: Float64, most: int = MOST_SPLATS) -> Splats:
    """The splats (N), or at most ``most`` that stand for them.

    Args:
        eyes: (C, 3) places of the drive's cameras.
        most: at least a few hundred: octants, facings and origins are never merged.
    """
    if len(splats) <= most:
        return splats
    distance = np.maximum(cKDTree(eyes).query(splats.means)[0], NEAREST_M)
    best: tuple[NDArray[np.int64], Float64] | None = None
    low, high, angle = 0.0, np.inf, FINEST
    for _ in range(MOST_TRIES):
        sizes = np.exp2(np.floor(np.log2(angle * distance) * STEPS) / STEPS)
        _, cells = np.unique(_keys(splats, sizes), return_inverse=True)
        count = int(cells.max()) + 1
        low, high = (angle, high) if count > most else (low, angle)
        if count <= most:
            best = cells, sizes
            if count > CLOSE_ENOUGH * most:
                break
        if best is not None and (high < SAME * low or high < SMALLEST):
            break
        angle = 2 * low if np.isinf(high) else high / 2 if low == 0 else float(np.sqrt(low * high))
    assert best is not None, "cells of the size of the scene hold all splats"
    return _merged(splats, *best)


def _keys(splats: Splats, sizes: Float64) -> NDArray[np.uint64]:
    """(N,) a number for each splat's cell: its place, size, the axis that the splat faces, and where its colour comes from.

    Args:
        sizes: (N,) sides of the cells, metres.
    """
    keys = np.empty(len(splats), np.uint64)
    for part in slices(len(splats)):
        place = np.floor(splats.means[part] / sizes[part][:, None])
        faces = np.abs(_axes(splats.quats[part])[:, :, 2]).argmax(axis=1)
        numbers = np.column_stack([place, np.round(np.log2(sizes[part]) * STEPS), faces, splats.origins[part]])
        mixed = numbers.astype(np.int64).view(np.uint64) * PRIMES
        keys[part] = np.bitwise_xor.reduce(mixed ^ (mixed >> np.uint64(29)), axis=1)
    return keys


def _axes(quats: Float32) -> Float64:
    """(N, 3, 3) float64 rotations; their columns are the axes of the ellipse and the normal."""
    found: Float64 = rotations(torch.from_numpy(quats).double()).numpy()
    return found


def _merged(splats: Splats, cells: NDArray[np.int64], sizes: Float64) -> Splats:
    """One splat for each cell, with the mean, the spread and the light-stopping area of those in it.

    Args:
        cells, sizes: (N,) each splat's cell, from 0, and its side.
    """
    count = int(cells.max()) + 1
    sums = np.zeros((count, 13))  # weight, colour, mean, spread
    origins, sides = np.zeros(count, np.uint8), np.zeros(count)
    low = splats.means.min(axis=0).astype(np.float64)
    for part in slices(len(splats)):
        scales = np.exp(splats.log_scales[part].astype(np.float64))
        weights = splats.opacities[part] * scales.prod(axis=1)
        arms = _axes(splats.quats[part])[:, :, :2] * scales[:, None, :]
        places = splats.means[part] - low
        spread = np.einsum("nij,nkj->nik", arms, arms) + places[:, :, None] * places[:, None, :]
        rows = np.column_stack([np.ones(len(weights)), splats.colors[part], places, spread[:, *np.triu_indices(3)]])
        for k in range(rows.shape[1]):
            sums[:, k] += np.bincount(cells[part], weights * rows[:, k], minlength=count)
        origins[cells[part]] = splats.origins[part]
        sides[cells[part]] = sizes[part]
    weights = sums[:, :1]
    mean = sums[:, 4:7] / weights
    covariance = np.zeros((count, 3, 3))
    covariance[:, *np.triu_indices(3)] = sums[:, 7:] / weights
    covariance += np.triu(covariance, 1).transpose(0, 2, 1)
    covariance -= mean[:, :, None] * mean[:, None, :]
    variances, axes = np.linalg.eigh(covariance)
    scales = np.sqrt(np.maximum(variances[:, :0:-1], 1e-10))
    excess = np.sqrt(np.maximum(sums[:, 0] / scales.prod(axis=1) / ALPHA_MAX, 1))[:, None]
    scales = np.maximum(scales, np.minimum(scales * excess, OVERLAP * sides[:, None]))
    return Splats(
        means=(mean + low).astype(np.float32),
        quats=rotation_to_quat(_right_handed(axes[:, :, ::-1])).astype(np.float32),
        log_scales=np.log(scales).astype(np.float32),
        opacities=np.minimum(sums[:, 0] / scales.prod(axis=1), ALPHA_MAX).astype(np.float32),
        colors=(sums[:, 1:4] / weights).astype(np.float32),
        origins=origins,
    )


def _right_handed(axes: Float64) -> Float64:
    """(N, 3, 3) rotations: the third of orthogonal columns points where the others say."""
    return np.dstack([axes[:, :, :2], np.cross(axes[:, :, 0], axes[:, :, 1])])
