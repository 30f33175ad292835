"""Hedges, garden walls and fences along one side of the street, read from the frames and completed.

Behind a row of parked cars only their top is seen, or nothing of them; they reach down to the ground, and go on behind a car as
beside it. So that tops meet tops and feet meet feet, what is copied is stretched to the height that it gets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_opening, maximum_filter, median_filter, minimum_filter
from scipy.spatial import cKDTree

from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.ground.street import Ground
from unveil_core.inpaint.facade.facade_chart import (
    FacadeChart,
    FacadeView,
    empty_chart,
    read_views,
    rows_between,
    wall_surfels,
    where_hidden,
)
from unveil_core.inpaint.facade.offsets import LOW_M, carried_on, fanned_out, offsets_along
from unveil_core.inpaint.facade.wall_fill import fill_wall
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["Barriers", "complete_barriers", "read_barriers"]

HIGH_M = 2.3
"""Height over the ground up to which the surfels of a barrier give its place, metres: the top of a garden wall."""
OVER_M = 4.0
"""Height up to which it is no barrier if more of it lies over the highest, metres: a crown."""
AROUND_M, LEAST = 1.0, 6
"""Half length of the stretch whose surfels count for a barrier's offset, metres, and how many there must be: over the roofs of cars
little of it is seen."""
BESIDE_M = 0.5
"""Distance from the middle of a barrier up to which surfels are its own, metres: half of a thick hedge, and its relief."""
BUSH_M, FLAT = 2.0, 0.7
"""Distance from its middle within which this share of what stands there must be a barrier's own, metres: bushes are as deep as they
are long."""
LONG_M = 1.2
"""Length along s over which they must spread, metres: a trunk, a bin or a post has less."""
FAR_M = 20.0
"""Distance from the path up to which a barrier is the street's own, metres."""
TOP_M = 2.6
"""Height of the charts, metres: over the highest barrier."""
FOOT_M = 1.0
"""Height up to which a place must be hidden for the barrier beside it to go on there, metres."""
CARRIED_M = 6.0
"""Distance along s over which a barrier goes on where nothing tells, metres: a car's length and the gaps before and behind it."""
END_M, STRAIGHT_M, BULGE_M = 3.0, 0.25, 0.5
"""Length either way, metres, over which a barrier's offset differs by no more than the second if it is to go on, metres, and by no
more than the third anywhere: bushes bulge."""
THICK_M = 1.0
"""How far behind the plane a barrier's pixel still shows its top, metres."""
SEEN_OVER_M = 0.2
"""Height over which what lies behind must be seen to tell a barrier's top, metres: more than the gap between two boards."""
SMOOTH_M = 1.0
"""Length along s over which the top is a median, metres."""
GATE_M = 0.4
"""Height under which there is no barrier, metres: what is seen through a gate reaches down to where the nearest car hides it."""
LEVELS = 40
"""Texels from the foot of a barrier to its top when it is filled: 4 cm of the tallest ones."""


@dataclass(frozen=True, eq=False)
class Barriers:
    """The barriers along one side of the street.

    Attributes:
        chart: their texture from the ground up.
        top: (A,) int64, columns of each row that are a barrier's, 0 where none stands.
        label: (A,) int64, of what stands at each row.
    """

    chart: FacadeChart
    top: NDArray[np.int64]
    label: NDArray[np.int64]


def read_barriers(
    ground: Ground,
    barriers: Surfels,
    views: Sequence[FacadeView],
    *,
    left: bool,
    along: tuple[float, float] = (-np.inf, np.inf),
    texel_m: float = 0.04,
    reach_m: float = 40.0,
) -> Barriers | None:
    """Read the barriers of one side from the frames. None where none stands.

    Args:
        barriers: surfels of hedges, garden walls and fences; views: whose ``on_wall`` are pixels of these.
        left: which side of the street; along: arc lengths between which it is read.
        texel_m: texel size, metres; reach_m: how far a view looks, metres.
    """
    s = rows_between(ground, along, texel_m)
    if len(s) < 2:
        return None
    place, labels = _places(barriers, ground, left=left)
    offset = _offsets(place, s)
    spread = _spread(offset, texel_m)
    offset[fanned_out(ground, s, offset) | (spread > BULGE_M)] = np.nan
    stood = np.isfinite(offset)
    if not stood.any():
        return None
    own = np.abs(place[:, 1] - np.interp(place[:, 0], s[stood], offset[stood])) < BESIDE_M
    if not own.any():
        return None
    label = labels[own][cKDTree(place[own, :1]).query(s[:, None])[1]]
    _, hidden = where_hidden(ground, s, offset, views, reach_m, TOP_M, FOOT_M, THICK_M)
    straight = _long(stood, round(END_M / texel_m)) & (spread <= STRAIGHT_M)
    carried = carried_on(np.where(straight, offset, np.nan), hidden & ~stood, texel_m, CARRIED_M)
    offset = np.where(stood, offset, carried)
    offset[fanned_out(ground, s, offset)] = np.nan
    chart = read_views(empty_chart(ground, s, offset, TOP_M), views, reach_m, THICK_M)
    return Barriers(chart, _tops(chart, stood), label)


def complete_barriers(barriers: Barriers, *, sh_degree: int) -> tuple[Surfels | None, Mask]:
    """Surfels of the parts of barriers behind removed objects that nobody saw, None for none; and (A, B) the texels of the chart
    that they fill."""
    chart, parts, filled = barriers.chart, [], np.zeros_like(barriers.chart.known)
    for label in np.unique(barriers.label[barriers.top > 0]):
        # Of a fence one learns nothing for a hedge.
        color, part = _filled(chart, np.where(barriers.label == label, barriers.top, 0))
        filled |= part
        parts.append(wall_surfels(chart, color, part, label=int(label), sh_degree=sh_degree))
    found = [part for part in parts if part is not None]
    return concatenate(found) if found else None, filled


def _filled(chart: FacadeChart, top: NDArray[np.int64]) -> tuple[Float32, Mask]:
    """Colours (A, B, 3) of barriers up to their ``top`` (A,), and the texels (A, B) behind removed objects that were filled."""
    heights = np.arange(chart.known.shape[1])
    own = heights < top[:, None]
    # Every barrier from foot to top in as many texels, and filled so.
    column = top[:, None] * (np.arange(LEVELS) + 0.5) / LEVELS - 0.5
    upright = _sampled(chart.color, column, cv2.INTER_LINEAR)
    seen, asked = (
        (top > 0)[:, None] & (_sampled(mask.astype(np.float32), column, cv2.INTER_NEAREST) > 0.5)
        for mask in (chart.known & own, chart.unseen & own)
    )
    fill = fill_wall(upright, seen, asked, texel=chart.texel)
    level = (heights + 0.5) / np.maximum(top, 1)[:, None] * LEVELS - 0.5
    filled = _sampled(fill.filled.astype(np.float32), level, cv2.INTER_NEAREST) > 0.5
    return _sampled(fill.color, level, cv2.INTER_LINEAR), chart.unseen & own & filled


def _sampled(image: Float32, column: Float64, how: int) -> Float32:
    """An image (A, B, ...) at a ``column`` (A, C) of each row."""
    column = np.clip(column, 0, image.shape[1] - 1).astype(np.float32)
    row = np.repeat(np.arange(len(column), dtype=np.float32)[:, None], column.shape[1], axis=1)
    return np.asarray(cv2.remap(image, column, row, how))


def _places(barriers: Surfels, ground: Ground, *, left: bool) -> tuple[Float64, NDArray[np.int64]]:
    """Of the surfels that may be barriers of one side, arc length, lateral offset and height over the ground (P, 3), along the
    street, and their labels (P,)."""
    street = ground.path.to_street(barriers.means.detach().double().numpy())
    street[:, 2] = ground.over(street)
    own = (
        (street[:, 2] > LOW_M) & (street[:, 2] < OVER_M) & ((street[:, 1] > 0) == left) & (np.abs(street[:, 1]) < FAR_M)
    )
    order = np.flatnonzero(own)[np.argsort(street[own, 0], kind="stable")]
    return street[order], barriers.labels.numpy()[order].astype(np.int64)


def _offsets(place: Float64, s: Float64) -> Float64:
    """(A,) lateral offset of the barriers at arc lengths ``s`` (A,) increasing, NaN where none stands.

    Args:
        place: (P, 3) of :func:`_places`.
    """
    return offsets_along(place[:, 0], s, AROUND_M, lambda near: _offset(place[near]))


def _offset(place: Float64) -> float:
    """Offset of the barrier that most surfels lie on, NaN for none.

    Args:
        place: (P, 3) arc length, lateral offset and height of surfels.
    """
    every = place[place[:, 2] < HIGH_M, 1]
    while (low := place[:, 2] < HIGH_M).sum() >= LEAST:
        middle = float(np.median(place[low, 1]))
        own = np.abs(place[:, 1] - middle) < BESIDE_M
        both = own & low
        flat = both.sum() >= FLAT * (np.abs(every - middle) < BUSH_M).sum()
        if both.sum() >= LEAST and flat and 2 * both.sum() > own.sum() and np.ptp(place[both, 0]) > LONG_M:
            return middle
        if not own.any():  # the median lies between two
            break
        place = place[~own]
    return np.nan


def _spread(offset: Float64, texel: float) -> Float64:
    """(A,) by how much offsets (A,) differ within :data:`END_M` of each, metres."""
    size, known = 2 * round(END_M / texel) + 1, np.isfinite(offset)
    most, least = (np.where(known, offset, none) for none in (-np.inf, np.inf))
    return np.asarray(maximum_filter(most, size) - minimum_filter(least, size))


def _long(stands: Mask, length: int) -> Mask:
    """(A,) the runs of ``stands`` (A,) that have no less than ``length`` rows."""
    return binary_opening(np.pad(stands, length), np.ones(length, dtype=bool))[length:-length]


def _tops(chart: FacadeChart, stood: Mask) -> NDArray[np.int64]:
    """(A,) columns up to the tops of the barriers, 0 where none stands: in gates, and beyond them where nothing of one is seen.

    Args:
        stood: (A,) where surfels told of a barrier; only there its top may be seen, for farther on it may be a crown's.
    """
    heights = np.arange(chart.known.shape[1])
    span = max(1, round(SEEN_OVER_M * chart.per_m))
    beyond = np.pad(chart.passed | chart.open, ((0, 0), (0, span - 1)), mode="edge")
    clear = np.lib.stride_tricks.sliding_window_view(beyond, span, axis=1).all(axis=-1)
    over = np.where(clear.any(axis=1), clear.argmax(axis=1), len(heights))  # type: ignore[call-overload]
    below = chart.known & (heights < over[:, None])
    seen = np.where(below.any(axis=1) & (over < len(heights)), len(heights) - below[:, ::-1].argmax(axis=1), 0)
    lowest = GATE_M * chart.per_m
    told = np.flatnonzero((seen >= lowest) & stood & np.isfinite(chart.offset))
    if not len(told):
        return np.zeros(len(seen), dtype=np.int64)
    top = np.interp(
        np.arange(len(seen)), told, median_filter(seen[told], max(1, round(SMOOTH_M * chart.per_m)), mode="nearest")
    )
    top = np.minimum(np.round(top), over).astype(np.int64)
    stands = np.isfinite(chart.offset) & (top >= lowest)
    piece = np.cumsum(np.diff(stands, prepend=False))
    return np.where(stands & np.isin(piece, piece[told]), top, 0)
