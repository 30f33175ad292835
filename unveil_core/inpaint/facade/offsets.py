"""Where the facades of one side of the street stand: their distance from the path, by arc length."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.mechanisms import on
from unveil_core.base.types import Float64, Mask
from unveil_core.ground.street import Ground
from unveil_core.surfels.surfels import Surfels

__all__ = ["LOW_M", "carried_on", "facade_offsets", "fanned_out", "share_facing"]

BIN_M, AROUND_M, LEAST = 0.25, 0.75, 12
"""Spacing along s at which the facade's offset is found, half length of the stretch whose surfels count for it, metres, and
how many there must be. Chosen on the two sample streets."""
LEVEL_M, OF_LEVEL, LEVELS = 0.5, 3, 3
"""Height of a level of the wall, metres, how many surfels tell where it is, and how many levels must: a wall is tall, while what
wrong labels leave of a car or a bin, in the street, lies at one height."""
LOW_M, HIGH_M = 0.3, 8.0
"""Heights over the ground between which a wall's surfels give the facade's offset, metres: over kerbs and shrubs, under roofs."""
STEP_M, GAP_M = 0.5, 6.0
"""Difference of offset under which two stretches are one facade, over a gap up to the second, metres: the projection of a bay,
and a van's length. Chosen on the two sample streets."""
BESIDE_M = 20.0
"""Distance from the path up to which walls are those of the street's own houses, metres: of wide streets, too, but hardly of side
streets. Only the share of walls that face the street goes by it."""
LONG_M = 2.5
"""Shortest facade along s, metres: shorter things that are labelled as building are posts and pillars."""
TOUCH_M = 1.5
"""Length of what is hidden neither way, metres, over which a facade still runs into the hidden stretch behind it."""
FAN, ALONG_M = 2.0, 0.5
"""How many times longer than the path the line beside it may be on which a facade stands, and the length over which that
is measured, metres. In a corner all of a side street's mouth is a metre of the path, and its rows are slits between lengths of
facade that stand for nothing."""
CARRIED_M = 20.0
"""Distance along s over which a facade goes on behind something that hides it to the eaves, metres: the length of an articulated
lorry, from either end half of it and as much again for the angle at which it is seen."""


def facade_offsets(walls: Surfels, ground: Ground, s: Float64, *, left: bool) -> Float64:
    """(A,) lateral offset of the facade at arc lengths ``s`` (A,) increasing, NaN where no house stands.

    Args:
        walls: surfels of houses; left: which side of the street.
    """
    street, height, facing = _places(walls, ground)
    facing &= (street[:, 1] > 0) == left
    order = np.argsort(street[facing, 0], kind="stable")
    along, aside = street[facing][order, :2].T
    level = np.floor(height[facing][order] / LEVEL_M).astype(np.int64)
    at = np.arange(s[0], s[-1] + BIN_M, BIN_M)
    ends = (np.searchsorted(along, at + d * AROUND_M) for d in (-1, 1))
    offset = np.array([_tall_wall(aside[low:high], level[low:high]) for low, high in zip(*ends, strict=True)])
    return _in_one_piece(offset, at, s)


def _in_one_piece(offset: Float64, at: Float64, s: Float64) -> Float64:
    """(A,) offsets at arc lengths ``s`` (A,) of a wall that was found at ``at`` (B,), ``BIN_M`` apart, with ``offset`` (B,), NaN
    where none stands: without spikes and short pieces, and joined over short gaps."""
    offset = _without_spikes(offset, round(LONG_M / 2 / BIN_M))
    known = np.flatnonzero(np.isfinite(offset))
    for a, b in zip(known, known[1:], strict=False):
        if 1 < b - a <= GAP_M / BIN_M and abs(offset[b] - offset[a]) < STEP_M:
            offset[a : b + 1] = np.linspace(offset[a], offset[b], b - a + 1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.isfinite(offset), [0]]).astype(np.int8)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if (last - first) * BIN_M < LONG_M:
            offset[first:last] = np.nan
    place, stands = (s - at[0]) / BIN_M, np.isfinite(offset)
    below, above = (np.clip(part(place).astype(int), 0, len(at) - 1) for part in (np.floor, np.ceil))
    smooth = np.interp(s, at, np.nan_to_num(offset))
    return np.where(stands[below] & stands[above], smooth, np.nan)


def _tall_wall(aside: Float64, level: NDArray[np.int64]) -> float:
    """Offset of the tall wall that most of a stretch's surfels (P,) lie on, at ``aside`` and of ``level``; NaN where none is."""
    while len(aside) >= LEAST:
        middle = float(np.median(aside))
        own = np.abs(aside - middle) < STEP_M
        if (np.bincount(level[own]) >= OF_LEVEL).sum() >= LEVELS:
            return middle
        if not own.any():  # the median lies between two walls
            break
        aside, level = aside[~own], level[~own]
    return np.nan


def fanned_out(ground: Ground, s: Float64, offset: Float64) -> Mask:
    """(A,) whether rows at arc lengths ``s`` (A,) spread at their ``offset`` (A,) from a path that bends."""
    ends = [
        ground.path.to_world(np.column_stack([s + d, np.nan_to_num(offset), np.zeros(len(s))]))
        for d in (-ALONG_M / 2, ALONG_M / 2)
    ]
    ratio = np.linalg.norm(ends[1] - ends[0], axis=1) / ALONG_M
    fanned: Mask = np.isfinite(offset) & (ratio > FAN)
    return fanned


def share_facing(walls: Surfels, ground: Ground) -> float | None:
    """Share of the surfels of houses beside the street that face it, 0 to 1, as facades parallel to it do; the others make none.
    None where there are too few to tell.

    Args:
        walls: surfels of houses.
    """
    street, _, facing = _places(walls, ground)
    beside = np.abs(street[:, 1]) < BESIDE_M
    return float(facing[beside].mean()) if beside.sum() >= LEAST else None


def _places(walls: Surfels, ground: Ground) -> tuple[Float64, Float64, Mask]:
    """Of the N surfels of walls that lie where a facade's would: street coordinates (N, 3), heights over the ground (N,), and which
    face the street."""
    street = ground.path.to_street(walls.means.detach().double().numpy())
    height = ground.over(street)
    low = (height > LOW_M) & (height < HIGH_M)
    street, height, normals = street[low], height[low], walls.normals().detach().double().numpy()[low]
    return street, height, ground.path.faced_by(street[:, 0], normals)


def _without_spikes(offset: Float64, half: int) -> Float64:
    """Offsets (A,), each the median of those that are known no more than ``half`` places away: what stands out for less is a
    post, or a piece of wall that was drawn out towards the cameras."""
    padded = np.pad(offset, half, constant_values=np.nan)
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1)
    known = np.isfinite(offset)
    result = offset.copy()
    result[known] = np.nanmedian(around[known], axis=1)
    return result


def carried_on(offset: Float64, hidden: Mask, texel: float) -> Float64:
    """Offsets (A,) ``texel`` metres apart, those of ``hidden`` (A,) stretches like that of the facade that runs into them.

    A facade that was seen to end before is not carried on; of two, each place gets the nearer one's, at most ``CARRIED_M``
    away.
    """
    result = offset.copy()
    if not on("carried_facades"):
        return result
    edges = np.flatnonzero(np.diff(np.concatenate([[0], hidden & ~np.isfinite(offset), [0]]).astype(np.int8)))
    touch, farthest = max(1, round(TOUCH_M / texel)), CARRIED_M / texel
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        rows = np.arange(first, last)
        distance = np.full((2, last - first), np.inf)
        value = np.full(2, np.nan)
        for side, beside in enumerate((offset[max(0, first - touch) : first][::-1], offset[last : last + touch])):
            known = np.flatnonzero(np.isfinite(beside))
            if len(known):
                value[side] = beside[known[0]]
                distance[side] = rows - first if side == 0 else last - 1 - rows
        nearest = distance.argmin(axis=0)
        result[rows] = np.where(distance.min(axis=0) <= farthest, value[nearest], np.nan)
    return result
