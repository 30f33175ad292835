"""Stop lines: one thick line straight across a lane, of which some was hidden.

It stands alone, so that no other line tells how far it goes. It goes on straight to the border of its lane, a line along the street
or the edge of the carriageway, where that is known, and is a lane's width from the line's other end at most. In doubt it stays as
it was seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from unveil_core.base.types import Float32, Mask
from unveil_core.inpaint.fill.lane_borders import lane_borders
from unveil_core.inpaint.fill.thick_lines import LEAST_CLEAR_M, ThickLine, thick_lines

__all__ = ["continue_stop_lines"]

LEAST_SEEN_M, LEAST_SHARE = 1.5, 0.5
"""Length of a line that must be seen, metres, or its share of the whole, whichever is less: dashes of lines to give way at, bars of
letters and arrowheads are 0.6 m long."""
LANE_M = (2.2, 4.0)
"""Widths of lanes, metres: 2.5 to 3.75 m are usual, and their borders are known to a decimetre or two."""
GAP_M = 0.5
"""How far before the border of its lane a line may end, metres: a gutter is 0.3 m wide."""
FAINT, EDGE_M = 0.15, 0.1
"""Share of its level below which the border of a line is none of it, and how far beyond half of its level that is, metres."""


def continue_stop_lines(
    detail: Float32, known: Mask, wanted: Mask, road: Mask, line: Mask, *, texels_per_m: float
) -> tuple[Float32, Float32]:
    """Continue single thick lines across the street, to the border of their lane, into what nobody saw.

    Args:
        detail: (A, B, 3) of a rectified chart, the difference from the lateral offset's median.
        known: (A, B) where it was seen; wanted: (A, B) where it is asked for.
        road: (A, B) the carriageway; line: (A, B) lines along the street.
    Returns:
        detail (A, B, 3) of the lines, and how much of it is line (A, B), 0 to 1, within ``wanted``.
    """
    result, share = np.zeros_like(detail), np.zeros(wanted.shape, dtype=np.float32)
    luma = detail.mean(axis=2)
    # Medians hold the paint of lines along the street already.
    for found in thick_lines(detail, known & ~line, texels_per_m=texels_per_m):
        row = round(float(found.row(found.clear).mean()))
        border = lane_borders(luma, known, road, line, row, texels_per_m=texels_per_m)
        lanes, _ = label(~border)
        for lane in np.unique(lanes[found.clear]):
            inside = np.flatnonzero(lanes == lane)
            extent = _extent(found, (int(inside[0]), int(inside[-1]) + 1), texels_per_m) if lane else None
            if extent is not None:
                edge = round(EDGE_M * texels_per_m)
                ends = np.flatnonzero((found.state < 0) | (lanes != lane))
                whole = found.clear[np.abs(found.clear[:, None] - ends).min(axis=1, initial=len(border)) > edge]
                if len(whole):
                    _lay(found, np.arange(*extent), whole, detail, known, wanted, result, share, edge)
    return result, share


def _extent(line: ThickLine, lane: tuple[int, int], per_m: float) -> tuple[int, int] | None:
    """First column of a line in a lane, and the one after its last; None where too little of it was seen.

    Args:
        lane: first column of it, and the one after its last.
    """
    state = line.state[slice(*lane)]
    own = line.clear[(line.clear >= lane[0]) & (line.clear < lane[1])]
    own = own[line.state[own] == 1]
    if not len(own):
        return None
    # Between the nearest places where no line was seen.
    start, none = int(own[len(own) // 2]), np.flatnonzero(state == -1) + lane[0]
    low, high = max([lane[0], *(none[none < start] + 1)]), min([lane[1], *none[none > start]])
    seen = low + np.flatnonzero(line.state[low:high] == 1)
    first, end = int(seen[0]), int(seen[-1]) + 1
    reaches = low - lane[0] <= GAP_M * per_m, lane[1] - high <= GAP_M * per_m
    width = (lane[1] if reaches[1] else high) - (lane[0] if reaches[0] else low)
    clear = ((own >= low) & (own < high)).sum()

    def told(length: int) -> bool:
        """Whether enough was seen to tell a line of that length, texels."""
        return len(seen) >= min(LEAST_SEEN_M * per_m, LEAST_SHARE * length) and length <= LANE_M[1] * per_m

    if width < LANE_M[0] * per_m or clear < LEAST_CLEAR_M * per_m or not told(end - first):
        return None
    right, left = reaches[0] and told(end - low), reaches[1] and told(high - first)
    if right and left and not told(high - low):
        return first, end
    return low if right else first, high if left else end


def _lay(
    line: ThickLine,
    columns: NDArray[np.int64],
    whole: NDArray[np.int64],
    detail: Float32,
    known: Mask,
    wanted: Mask,
    result: Float32,
    share: Float32,
    edge: int,
) -> None:
    """Write a line into ``result`` (A, B, 3) and ``share`` (A, B) at columns (N,): its profile, with the grain of what was seen of
    it, mirrored, so that it goes on where that ends.

    Args:
        whole: (M,) columns away from its ends where it was seen; edge: how far beyond half of its level a line may reach, texels.
    """
    half = len(line.profile) // 2
    offsets = np.arange(-half, half + 1)
    luma = line.profile.mean(axis=1)
    solid = np.clip(luma / line.level, 0, 1) * (luma > FAINT * line.level)
    solid *= np.abs(offsets) <= line.thickness / 2 + edge

    def at(rows: NDArray[np.int64], column: int) -> tuple[Float32, Float32]:
        """What the profile is at some rows of a column (R, 3), and how solid (R,)."""
        off = rows - line.row(np.array(column))
        planes = [np.interp(off, offsets, line.profile[:, k]) for k in range(3)]
        part = np.interp(off, offsets, solid, left=0, right=0)
        return np.stack(planes, axis=1).astype(np.float32), part.astype(np.float32)

    for column, source in zip(columns, _mirrored(columns, whole), strict=True):
        middle, own = (int(np.round(line.row(c))) for c in (column, source))
        part = offsets[(offsets + min(middle, own) >= 0) & (offsets + max(middle, own) < len(detail))]
        level, cover = at(middle + part, int(column))
        grain = detail[own + part, source] - at(own + part, int(source))[0]
        grain[~known[own + part, source]] = 0
        place = np.where(wanted[middle + part, column], cover, 0)
        rows = (middle + part)[place > share[middle + part, column]]
        kept = rows - middle - part[0]
        share[rows, column] = place[kept]
        result[rows, column] = level[kept] + place[kept, None] * grain[kept]


def _mirrored(columns: NDArray[np.int64], sources: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) which of the ``sources`` (M,), increasing, each column repeats: as far from the nearest of them as it is itself."""
    after = np.clip(np.searchsorted(sources, columns), 0, len(sources) - 1)
    before = np.maximum(after - 1, 0)
    back = np.abs(columns - sources[before]) < np.abs(columns - sources[after])
    nearest = np.where(back, before, after)
    away = columns - sources[nearest]
    turn = (nearest - np.sign(away) * np.maximum(np.abs(away) - 1, 0)) % (2 * len(sources))
    return np.asarray(sources[np.minimum(turn, 2 * len(sources) - 1 - turn)])
