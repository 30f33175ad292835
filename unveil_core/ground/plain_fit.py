"""The height of a street whose points are not to be trusted to a hand: smooth along, a parabola across.

Without a LiDAR, surfels on bare asphalt are put where the images allow, centimetres to half a metre too low, and what few views
show lies lowest: medians follow them, cell by cell. Most of the points that agree do so on the true surface. It is found by
iteratively reweighted least squares with a redescending weight (Geman and McClure, *Statistical methods for tomographic image
reconstruction*, 1987), whose scale falls from round to round.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.ndimage import median_filter
from scipy.sparse.linalg import spsolve

from unveil_core.base.types import Float64
from unveil_core.geometry.cell_medians import cell_medians, groups

__all__ = ["NOISY_M", "cross_profile", "height_noise", "plain_heights"]

NOISY_M = 0.08
"""Median spread of height within a cell from which on points are noisy, metres: of twelve drawn streets with a LiDAR it is 0.02 to
0.06, of two without 0.10 and 0.12."""
CELL_M, FEWEST = 0.5, 6
"""Side of such a cell across the street, metres (along it is a metre), and its fewest points."""
LANE_M = 2.5
"""Points so near the path tell how noisy all are: the lane that the car itself drove on."""
SCALES_M = (0.3, 0.2, 0.12, 0.08, 0.06, 0.06, 0.06)
"""Scale of the weights from round to round, metres: from the spread of the points to that of the surface around the model."""
STIFF = 30.0
"""Weight of the squared change of grade from metre to metre, a point's weighing 1 for each of those of its metre: grades
change over some five metres."""
WIDTH_M = 8.0
"""Farther aside points do not count, and the height stays: beyond sidewalks there are gardens and walls."""
KERB_M = 0.4
"""What departs from the plain surface by more is no ground of it, metres."""
FEWEST_OF_PROFILE, TOGETHER_M = 30, 0.08
"""Points that tell what a lateral offset does, and how close together the middle half of them lies, metres: where photographs agree
each is right to 2 cm, and a kerb in a bend takes 7."""
SURE_SHARE = 0.25
"""Weight of the measured points against all others. They are few, and right to centimetres."""


def height_noise(street: Float64) -> float:
    """Median over cells of the spread of height in them, between the quartiles, metres; 0 where no cell has enough points.

    Args:
        street: (P, 3) street coordinates.
    """
    near = street[np.abs(street[:, 1]) < LANE_M]
    if not len(near):
        return 0.0
    # A steep street spreads over a cell, too.
    metre, heights = cell_medians(np.floor(near[:, 0]).astype(np.int64), near[:, 2])
    level = np.interp(near[:, 0], metre + 0.5, heights)
    near = np.column_stack([near[:, :2], near[:, 2] - level])
    cell = np.floor(near[:, 0]).astype(np.int64) * 1000 + np.floor(near[:, 1] / CELL_M).astype(np.int64)
    order = np.argsort(cell, kind="stable")
    parts = [p for p in groups(cell[order], near[order, 2])[1] if len(p) >= FEWEST]
    return float(np.median([np.subtract(*np.percentile(p, [75, 25])) for p in parts])) if parts else 0.0


def plain_heights(street: Float64, sure: Float64, s: Float64, t: Float64, base: Float64) -> Float64:
    """(A, B) heights at arc lengths (A,), a metre apart, and lateral offsets (B,).

    Args:
        street: (P, 3) street coordinates of points on the ground, sure: (Q, 3) of measured ones.
        base: (A,) heights of the middle to begin with.
    """
    points = np.concatenate([street, sure])
    share = np.ones(len(points))
    if len(sure):
        share[len(street) :] = max(1.0, SURE_SHARE * len(street) / len(sure))
    use = (np.abs(points[:, 1]) < WIDTH_M) & (points[:, 0] >= s[0]) & (points[:, 0] <= s[-1])
    points, share = points[use], share[use]
    rows = _rows(points, s)
    bend = sparse.diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(max(len(s) - 2, 0), len(s)))
    bend = sparse.hstack([bend, sparse.csr_array((max(len(s) - 2, 0), 2))]).tocsr()
    found = np.concatenate([base, [0.0, 0.0]])
    for scale in SCALES_M:
        weight = share / np.square(1 + np.square((points[:, 2] - rows @ found) / scale))
        stiff = STIFF * weight.sum() / len(s) * (bend.T @ bend) + 1e-6 * sparse.eye_array(len(found))
        found = spsolve((rows.T @ (weight[:, None] * rows) + stiff).tocsc(), rows.T @ (weight * points[:, 2]))
    across = np.clip(t, -WIDTH_M, WIDTH_M)
    heights: Float64 = found[:-2, None] + found[-2] * across[None] + found[-1] * np.square(across)[None]
    return heights


def cross_profile(over: Float64, t: Float64) -> Float64:
    """(B,) by how much lateral offsets, evenly spaced, lie over the plain surface all along a street: camber, gutters and kerbs.

    Args:
        over: (P, 2) lateral offset and height over the plain surface of points that lie on the ground.
    """
    cell = np.round((over[:, 0] - t[0]) / (t[1] - t[0])).astype(np.int64)
    counts = (np.abs(over[:, 1]) < KERB_M) & (cell >= 0) & (cell < len(t))
    cells, heights = cell_medians(cell[counts], over[counts, 1], fewest=FEWEST_OF_PROFILE, together=TOGETHER_M)
    return np.interp(t, t[cells], median_filter(heights, 3, mode="nearest")) if len(cells) else np.zeros(len(t))


def _rows(points: Float64, s: Float64) -> sparse.csr_array:
    """(P, A + 2) what each coefficient adds to the height at a point: linear between the heights of the middle, and a parabola."""
    place = np.clip(points[:, 0] - s[0], 0, len(s) - 1.001)
    below: NDArray[np.int64] = place.astype(np.int64)
    part, each = place - below, np.arange(len(points))
    values = np.concatenate([1 - part, part, points[:, 1], np.square(points[:, 1])])
    columns = np.concatenate([below, below + 1, np.full(len(each), len(s)), np.full(len(each), len(s) + 1)])
    return sparse.csr_array((values, (np.tile(each, 4), columns)), shape=(len(points), len(s) + 2))
