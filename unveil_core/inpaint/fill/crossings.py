"""Zebra crossings: bars along the street that repeat across it, of which some were hidden.

Bars are longer than any line across the street, and shorter than the stretch whose median is a lateral offset's colour: neither
holds them. They are all alike, lie at one distance from each other, and reach from one border of the carriageway to the other
unless they are seen to end. Lines along the street end before a crossing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from unveil_core.base.types import Float32, Mask

__all__ = ["continue_crossings"]

BIN_M = 0.25
"""Length along the street of the rows that bars are looked for in, metres: a fourteenth of a bar's."""
KNOWN_SHARE = 0.5
"""Share of a row at a lateral offset that must be seen for it to be judged."""
BAR_M2 = 0.1
"""Area of a bar's place that must be seen for it to be judged, square metres: of four crossings asphalt there is within 0.03 of its
median, and paint 0.13 brighter and more. A fifth of a bar, three times as much, made up bars beside one that was seen not to be."""
LANE_M = 2.6
"""Width of road beyond a line from which on another lane lies there, metres, and the line does not end the crossing: bays along the
street are 2 to 2.3 m wide, lanes of streets 2.75 m and more."""
CONTRAST = 0.1
"""Difference of luma, in [0, 1], from the lateral offset's median that makes a bar: as of other markings."""
WIDTH_M, PERIOD_M = (0.25, 0.9), (0.7, 1.6)
"""Widths of a bar, and distances from bar to bar, metres: 0.5 m and 1 m are usual, 0.3 to 0.7 m and 0.8 to 1.4 m occur."""
PERIOD_STEP_M, SLACK_M = 0.02, 0.1
"""Step in which distances are tried, and what a bar may be off its place, metres: half of the mean error of a bar's border that is
five pixels wide is less."""
LEAST_BARS = 3
"""Fewest bars that are seen beside each other: two lines are also the two borders of a lane."""
EDGE, LEAST_EDGES = 0.2, 4
"""Of a period, how far an edge may be off its place, and fewest edges: one more than what they tell, which is a place, a period
and a width."""
MOST_OFF = 0.15
"""Of a period, by which a bar that is seen in part can have misled the first fit: one of three, half seen, by a quarter of its
width."""
LENGTH_M = (2.0, 8.0)
"""Lengths of a crossing's bars, metres: 2.5 to 5 m are usual. Dashes of two lanes are no bars, for they are wider apart."""


@dataclass(frozen=True, eq=False)
class _Crossing:
    """Bars that were seen.

    Attributes:
        rows: of the chart; period, phase: distance between the bars, and the middle of one of them, texels.
        bars: (first, last) number of the outermost bars that were seen, counted from the one at ``phase``.
        lane: width of a lane, texels.
    """

    rows: slice
    period: float
    phase: float
    bars: tuple[int, int]
    lane: float

    def of(self, bar: int, plane: NDArray[Any], solid: Mask) -> NDArray[Any]:
        """A plane of the chart (A, B) under a bar, without the asphalt beside it; solid: (P,) bool, a bar within a period."""
        columns, part = self.columns(bar, plane.shape[1])
        return plane[self.rows, columns][:, solid[part]]

    def columns(self, bar: int, columns: int) -> tuple[slice, slice]:
        """Columns of the chart about a bar's middle, one period wide, and the part of such a period that they are."""
        first = round(self.phase + (bar - 0.5) * self.period)
        width = round(self.period)
        inside = slice(min(max(first, 0), columns), min(max(first + width, 0), columns))
        return inside, slice(inside.start - first, inside.stop - first)


def continue_crossings(
    detail: Float32,
    known: Mask,
    wanted: Mask,
    kind: NDArray[np.int16],
    line: Mask,
    paint: Float32 | None = None,
    *,
    texels_per_m: float,
) -> tuple[Float32, Float32]:
    """Continue the bars of crossings into what nobody saw.

    Args:
        detail: (A, B, 3) of a rectified chart, the difference from the lateral offset's median.
        known: (A, B) where it was seen; wanted: (A, B) where it is asked for.
        kind: (A, B) class of the ground: bars lie where it is what it is under those that were seen.
        line: (A, B) lines along the street: beyond the outermost of them there are no bars.
        paint: (A, B, 3) how much brighter these are than the ground beside them: between bars there are none; None = they stay.
    Returns:
        detail (A, B, 3) of the bars, and how much of it is crossing (A, B), 0 to 1, within ``wanted``.
    """
    result, share = np.zeros_like(detail), np.zeros(wanted.shape, dtype=np.float32)
    luma = detail.mean(axis=2)
    for crossing in _crossings(luma, known, texels_per_m):
        section = _section(detail, known, crossing)
        if section is None:
            continue
        level = section.mean(axis=1)
        solid = np.clip(level / level.max(), 0, 1) * (level > CONTRAST / 2)
        for bar in _all_bars(luma, known, kind, line, crossing, solid > 0.5, BAR_M2 * texels_per_m**2):
            columns, part = crossing.columns(bar, known.shape[1])
            place = np.s_[crossing.rows, columns]
            share[place] = wanted[place] * solid[part]
            result[place] = np.where(share[place][..., None] > 0, section[part], 0)
            if paint is not None:
                between = wanted[place] & line[place] & (solid[part] == 0)
                share[place] = np.where(between, 1, share[place])
                result[place] = np.where(between[..., None], -paint[place], result[place])
    return result, share


def _crossings(luma: Float32, known: Mask, per_m: float) -> list[_Crossing]:
    size = max(1, round(BIN_M * per_m))
    count = len(luma) // size
    seen = known[: count * size].reshape(count, size, -1)
    value, many = _mean(luma[: count * size].reshape(seen.shape), seen, axis=1)
    sure = many >= KNOWN_SHARE * size
    bright = sure & (value > CONTRAST)
    fits = [_fit(bright[row], sure[row], per_m) if bright[row].any() else None for row in range(count)]
    found, row = [], 0
    while row < count:
        first, end = row, row + 1
        if fits[first] is not None:
            while end < count and _same(fits[end - 1], fits[end]):
                end += 1
            if LENGTH_M[0] <= (end - first) * size / per_m <= LENGTH_M[1]:
                own = [f for f in fits[first:end] if f is not None]
                found.append(_crossing(luma, known, own, first * size, size, LANE_M * per_m))
        row = end
    return found


def _mean(luma: Float32, known: Mask, axis: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Mean of what is known of a plane along an axis, 0 where nothing is, and how much that is."""
    count = known.sum(axis=axis)
    return np.where(known, luma, 0).sum(axis=axis) / np.maximum(count, 1), count


def _fit(bright: Mask, sure: Mask, per_m: float) -> tuple[float, float, int, int] | None:
    """Period and phase of the bars of a row (B,), texels, and the numbers of the outermost; None where there are too few."""
    parts, count = label(bright)
    if count < LEAST_BARS:
        return None
    spans = [np.flatnonzero(parts == k)[[0, -1]] for k in range(1, count + 1)]
    middles = np.array([s.mean() for s in spans if WIDTH_M[0] * per_m <= s[1] - s[0] + 1 <= WIDTH_M[1] * per_m])
    if len(middles) < LEAST_BARS:
        return None
    best: tuple[float, float, int, int] | None = None
    most = (LEAST_BARS - 1, 0.0)
    for period in np.arange(PERIOD_M[0], PERIOD_M[1], PERIOD_STEP_M) * per_m:
        for phase in middles:
            turn = (middles - phase) / period
            number = np.round(turn).astype(int)
            off = np.abs(turn - number) * period
            hit = off < SLACK_M * per_m
            low, high = number[hit].min(), number[hit].max()
            places = np.clip(np.round(phase + np.arange(low, high + 1) * period).astype(int), 0, len(bright) - 1)
            # Asphalt that was seen where a bar should be, and bars where it should not, speak against it.
            missed = int((sure[places] & ~bright[places]).sum())
            between = np.round(phase + (np.arange(low, high) + 0.5) * period).astype(int)
            wrong = int(bright[between].sum())
            score = (int(hit.sum()) - 2 * (missed + wrong), -float(off[hit].mean()))
            if score > most:
                most, best = score, (float(period), float(phase), int(low), int(high))
    return best


def _same(one: tuple[float, float, int, int] | None, other: tuple[float, float, int, int] | None) -> bool:
    """Whether two rows show the bars of one crossing."""
    if one is None or other is None:
        return False
    turn = (other[1] - one[1]) / one[0]
    return abs(other[0] - one[0]) < 0.1 * one[0] and abs(turn - round(turn)) < 0.2


def _crossing(
    luma: Float32, known: Mask, fits: list[tuple[float, float, int, int]], first: int, size: int, lane: float
) -> _Crossing:
    """The crossing that rows of bins show, its ends to the texel."""
    period = float(np.median([f[0] for f in fits]))
    anchor = fits[len(fits) // 2][1]
    turns = [(f[1] - anchor) / period for f in fits]
    phase = anchor + period * float(np.median([t - round(t) for t in turns]))
    bars = [(round((f[1] - phase) / period) + f[2], round((f[1] - phase) / period) + f[3]) for f in fits]
    low, high = min(b[0] for b in bars), max(b[1] for b in bars)
    rows = slice(max(first - size, 0), min(first + (len(fits) + 1) * size, len(luma)))
    middle = np.round(phase + np.arange(low, high + 1) * period).astype(int)
    columns = np.unique(np.clip(middle[:, None] + np.arange(-2, 3), 0, luma.shape[1] - 1))
    level, _ = _mean(luma[rows][:, columns], known[rows][:, columns], axis=1)
    inside = np.flatnonzero(level > 0.5 * np.median(level[size:-size]))
    rows = slice(rows.start + int(inside[0]), rows.start + int(inside[-1]) + 1)
    period, phase = _by_edges(luma[rows], known[rows], period, phase, (low, high))
    return _Crossing(rows, period, phase, (low, high), lane)


def _by_edges(luma: Float32, known: Mask, period: float, phase: float, bars: tuple[int, int]) -> tuple[float, float]:
    """Period and phase by all edges of bars that were seen: the middle of what is seen of a bar is not that of the bar.

    Args:
        luma, known: (R, B) rows of the crossing; period, phase: to a few per cent, texels.
        bars: (first, last) number of those that were seen.
    Returns:
        as given, where too few edges were seen.
    """
    value, count = _mean(luma, known, axis=0)
    sure = count >= KNOWN_SHARE * len(known)
    bright = sure & (value > CONTRAST)
    if not bright.any():
        return period, phase
    level = float(np.median(value[bright])) / 2
    over = value > level
    before = np.flatnonzero(sure[:-1] & sure[1:] & (over[:-1] != over[1:]))
    at = before + (level - value[before]) / (value[before + 1] - value[before])
    side = np.where(over[before], 1.0, -1.0)  # of the bar, on which the edge lies
    turn = (at - phase) / period - side / 4  # a bar is half a period wide, more or less
    number = np.round(turn)
    own = (np.abs(turn - number) < EDGE) & (number >= bars[0]) & (number <= bars[1])
    if own.sum() < LEAST_EDGES or np.ptp(number[own]) < LEAST_BARS - 2:
        return period, phase
    terms = np.stack([np.ones(own.sum()), number[own], side[own]], axis=1)
    first, apart, _ = np.linalg.lstsq(terms, at[own], rcond=None)[0]
    if abs(apart - period) > MOST_OFF * period:
        return period, phase
    return float(apart), float(first)


def _section(detail: Float32, known: Mask, crossing: _Crossing) -> Float32 | None:
    """(P, 3) one bar and the asphalt beside it across the street, of those that were seen; None where none was seen whole."""
    seen = []
    for bar in range(crossing.bars[0], crossing.bars[1] + 1):
        columns, part = crossing.columns(bar, known.shape[1])
        there = known[crossing.rows, columns]
        if part.start == 0 and part.stop == round(crossing.period) and there.mean(axis=0).min() >= KNOWN_SHARE:
            total = np.where(there[..., None], detail[crossing.rows, columns], 0).sum(axis=0)
            seen.append(total / there.sum(axis=0)[:, None])
    section = np.median(seen, axis=0).astype(np.float32) if seen else None
    return section if section is not None and float(section.mean(axis=1).max()) > CONTRAST else None


def _all_bars(
    luma: Float32,
    known: Mask,
    kind: NDArray[np.int16],
    line: Mask,
    crossing: _Crossing,
    solid: Mask,
    least: float,
) -> list[int]:
    """Numbers of the bars that there are: from those that were seen on to both sides, up to where one was seen to be missing, or
    the crossing ends. No more are made up on a side than were seen.

    Args:
        least: texels of a bar's place that must be seen to judge it.
    """
    first, last = crossing.bars
    under = [crossing.of(bar, kind, solid)[crossing.of(bar, known, solid)] for bar in range(first, last + 1)]
    classes, counts = np.unique(np.concatenate(under), return_counts=True)
    road = (kind[crossing.rows] == classes[counts.argmax()]).mean(axis=0) > 0.5

    def there(bar: int) -> bool | None:
        """Whether there is a bar; None where that cannot be seen."""
        seen, value = crossing.of(bar, known, solid), crossing.of(bar, luma, solid)
        on_road = crossing.of(bar, np.broadcast_to(road, known.shape), solid)
        if seen.shape[1] < solid.sum() or on_road.mean() < 0.5:
            return False
        return bool(value[seen].mean() > CONTRAST) if seen.sum() >= least else None

    sure = [bar for bar in range(first, last + 1) if there(bar)]
    if not sure:
        return []
    first, last = sure[0], sure[-1]  # one row may have taken something else for a bar
    marked = line[crossing.rows].mean(axis=0) > 0.5
    bars = list(range(first, last + 1))
    for bar, opposite, step in ((first, last, -1), (last, first, 1)):
        ended = there(opposite - step) is False
        end = _end(crossing, bar, opposite if ended else None, step, road, marked)
        for more in range(bar + step, bar + step * (last - first + 2), step):
            outside = (crossing.phase + more * crossing.period - end) * step > 0
            if outside or there(more) is False:
                break
            bars.append(more)
    return bars


def _end(crossing: _Crossing, bar: int, opposite: int | None, step: int, road: Mask, line: Mask) -> float:
    """Column beyond which no bar's middle lies on a side of a crossing.

    Where the other side is seen to end, this one ends as far from a line in the middle, or without one from the border of the road:
    often only one side has bays. It never goes beyond the outermost line that has no lane beyond it.

    Args:
        bar: the outermost that was seen on this side; opposite: on the other one, None where that is not seen to end.
        step: direction of this side, -1 or 1; road, line: (B,) bool.
    """
    at, columns = crossing.phase + bar * crossing.period, np.arange(len(road))
    beside = np.flatnonzero(~road & ((columns - at) * step > 0))
    kerb = float(beside[np.abs(beside - at).argmin()] if len(beside) else (0 if step < 0 else len(road)))
    # A kerb may be as bright as a line.
    lines = columns[line & ((kerb - columns) * step > crossing.period / 2)]
    outer = lines[((lines - at) * step > 0) & ((kerb - lines) * step < crossing.lane)]
    quarter = step * crossing.period / 4  # half of a bar
    ends = [(float(outer[np.abs(outer - at).argmax()]) if len(outer) else kerb) - quarter]
    if opposite is not None:
        other = crossing.phase + opposite * crossing.period
        beyond = np.flatnonzero(~road & ((columns - other) * step < 0))
        inner = lines[(lines - other) * step > 0]
        inner = inner[((inner - at) * step < 0) | ((kerb - inner) * step >= crossing.lane)]
        if len(inner):
            ends.append(float(2 * inner[np.abs(inner - other).argmax()] - other) + quarter)
        elif len(beyond):
            ends.append(kerb - step * float(np.abs(beyond - other).min()) + quarter)
    return min(ends, key=lambda end: (end - at) * step)
