"""Transverse markings: bay lines and joints across the street, which a median per lateral offset does not hold.

A line seen at one lateral offset is continued at another if the street's other lines go on there as well. Where lines repeat at a
regular distance (parking bays), the row is completed. A stop line, of which there is one, is continued by ``stop_lines.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label

from unveil_core.base.types import Float32, Mask
from unveil_core.inpaint.fill.strips import strip_means

__all__ = ["continue_transverse_markings"]

BIN_M = 0.2
"""Width in t of the strips that lines are looked for in, metres: the width of a parking bay's corner mark. Chosen on the two
sample streets."""
KNOWN_SHARE = 0.6
"""Share of a strip's width in a row that must be seen for the row to be judged."""
CONTRAST = 0.1
"""Difference of luma, in [0, 1], from the street before and behind it that makes a line. Worn paint on asphalt has about twice as
much; chosen on the two sample streets."""
LONGEST_M = 0.5
"""Longest extent of a line along s, metres: a stop line's. The bars of a zebra crossing are longer and are not continued."""
ACROSS_M = 2.6
"""How far a line may be followed across the street, metres: a parallel bay is 2 to 2.5 m wide. Perpendicular bays (5 m) and whole
lanes (3.5 m) are not crossed."""
CONTINUATION_SHARE = 0.6
"""Share of the lines at one strip that must be seen at another for all of them to be continued there. Chosen on the two sample
streets."""
PERIODS_M = (2.0, 15.0)
"""Shortest and longest distance at which lines may repeat, metres: a perpendicular bay, and a parallel one for a lorry."""
PERIOD_TOLERANCE = 0.04
"""Relative difference within which one period is a multiple of another."""
LEAST_EVENTS = 3
"""Fewest lines that make a period."""
UNSEEN_LINE_PENALTY = 0.3
"""Taken from the score of a period for each line that it predicts in ground that nobody saw; each observed line on it adds 1.
Chosen on the two sample streets."""
MISSED_LINE_PENALTY = 2.0
"""Taken from the score for each line that it predicts in ground that was seen to have none. Chosen on the two sample streets."""
ENDED = 2
"""Lines of a row that must be seen to end for all to end there: one may be worn, or its place misread."""
SURE_SURPLUS = 2
"""Lines on a row beyond those that any lie on, from which on as many hidden ones are supposed as are seen."""
FARTHEST = 2.5
"""How far beyond the observed lines a row is completed, in periods. Chosen on the two sample streets."""

_Phases = tuple[float | None, ...]
"""For each street the place of one line, None where it has none."""


@dataclass(frozen=True, eq=False)
class _Strips:
    """Where lines were seen, on a grid that is coarse across the street.

    Attributes:
        marked, known: (A, S) bool per row and strip: a line, and enough seen to tell; width: of a strip, texels.
    """

    marked: Mask
    known: Mask
    width: int


def continue_transverse_markings(
    detail: Float32, known: Mask, wanted: Mask, *, texels_per_m: float, streets: Sequence[slice] = (slice(None),)
) -> tuple[Float32, Float32]:
    """Continue lines across the street into what nobody saw.

    Args:
        detail: (A, B, 3) of a rectified chart, the difference from the lateral offset's median.
        known: (A, B) where it was seen; wanted: (A, B) where it is asked for.
        streets: rows before, between and after corners: each street begins its bays anew.
    Returns:
        detail (A, B, 3) of the continued lines, and how much of it is line (A, B), 0 to 1, within ``wanted``.
    """
    result, share = np.zeros_like(detail), np.zeros(wanted.shape, dtype=np.float32)
    strips = _strips(detail.mean(axis=2), known, texels_per_m)
    if not strips.marked.any():
        return result, share
    goes_on = _goes_on(strips, round(ACROSS_M / BIN_M))
    marked = _followed(strips, goes_on)
    streets = [slice(*street.indices(len(detail))) for street in streets]
    marked |= _repeated(strips, marked, goes_on, streets, texels_per_m)
    added = marked & ~strips.known
    half = round(LONGEST_M / 2 * texels_per_m)
    sections = {k: _section(detail, known, strips, int(k), half) for k in np.flatnonzero(strips.marked.any(axis=0))}
    of_line = np.array([k for k, section in sections.items() if section is not None])
    if not len(of_line):
        return result, share
    for strip in np.flatnonzero(added.any(axis=0)):
        section = sections[of_line[np.abs(of_line - strip).argmin()]]
        assert section is not None
        line = section.mean(axis=1)
        solid = np.clip(line / line.max(), 0, 1)
        columns = slice(strip * strips.width, (strip + 1) * strips.width)
        for middle in _events(np.repeat(added[:, strip, None], 2, axis=1))[0]:
            first = round(middle) - half
            rows = slice(max(0, first), min(len(detail), first + len(section)))
            part = slice(rows.start - first, rows.stop - first)
            place = wanted[rows, columns] * solid[part, None]
            better = place > share[rows, columns]
            share[rows, columns] = np.where(better, place, share[rows, columns])
            result[rows, columns] = np.where(better[..., None], section[part, None], result[rows, columns])
    return result, share


def _section(detail: Float32, known: Mask, strips: _Strips, strip: int, half: int) -> Float32 | None:
    """(2 half + 1, 3) what the lines that were seen at a strip look like along the street, about their middles; None where
    none was seen whole."""
    columns = slice(strip * strips.width, (strip + 1) * strips.width)
    seen = []
    for middle in np.round(_events(np.repeat(strips.marked[:, strip, None], 2, axis=1))[0]).astype(int):
        rows = slice(middle - half, middle + half + 1)
        if rows.start < 0 or rows.stop > len(detail):
            continue
        many = known[rows, columns].sum(axis=1)
        if many.min() >= 0.5 * strips.width:
            part = np.where(known[rows, columns, None], detail[rows, columns], 0)
            seen.append(part.sum(axis=1) / many[:, None])
    if not seen:
        return None
    section = np.median(seen, axis=0).astype(np.float32)
    return section if float(section.mean(axis=1).max()) > 0 else None


def _strips(luma: Float32, known: Mask, texels_per_m: float) -> _Strips:
    width = max(1, round(BIN_M * texels_per_m))
    value, many = strip_means(luma, known, width)
    sure = many > KNOWN_SHARE * width
    value = np.where(sure, value, 0).astype(np.float32)
    # A line stands out from what lies before and behind it.
    longest = 2 * (round(LONGEST_M * texels_per_m) // 2) + 1
    floor = cv2.morphologyEx(value, cv2.MORPH_OPEN, np.ones((longest, 1), np.uint8))
    return _Strips((value - floor > CONTRAST) & sure, sure, width)


def _goes_on(strips: _Strips, reach: int) -> NDArray[np.float64]:
    """(S, S) of the marked rows of the first strip, the share that is marked in the second too; 0 where that is not known."""
    rows, count = strips.marked.shape
    # A line may be a texel aslant.
    loose = cv2.dilate(strips.marked.astype(np.uint8), np.ones((5, 1), np.uint8)).astype(bool)
    share = np.zeros((count, count))
    for a in range(count):
        for b in range(max(0, a - reach), min(count, a + reach + 1)):
            both = strips.marked[:, a] & strips.known[:, b]
            # Two lines' worth of rows at the least.
            if both.sum() >= 5 and label(both)[1] >= 2:
                share[a, b] = loose[both, b].mean()
    np.fill_diagonal(share, 0)
    return share


def _followed(strips: _Strips, goes_on: NDArray[np.float64]) -> Mask:
    """Marks (A, S), those at unknown places included that lie in the row of a seen mark which goes on there."""
    marked = strips.marked.copy()
    for b in range(marked.shape[1]):
        sources = np.flatnonzero(goes_on[:, b] > CONTINUATION_SHARE)
        # The nearest strip that is known decides.
        open_ = ~strips.known[:, b]
        for a in sources[np.argsort(np.abs(sources - b))]:
            marked[open_ & strips.marked[:, a], b] = True
            open_ &= ~strips.known[:, a]
    return marked


def _repeated(
    strips: _Strips, marked: Mask, goes_on: NDArray[np.float64], streets: Sequence[slice], texels_per_m: float
) -> Mask:
    """Marks (A, S) that stand where lines at regular distances would stand and nobody saw."""
    result = np.zeros_like(marked)
    kinds = [_kind(strips, marked, members) for members in _groups(strips, goes_on)]
    unseen = [~strips.known[:, k.members].all(axis=1) for k in kinds]
    periods = [_period(k.at, gap, streets, texels_per_m) for k, gap in zip(kinds, unseen, strict=True)]  # type: ignore[arg-type]
    rows_of = [
        _shared(kind, gap, streets, found, periods)  # type: ignore[arg-type]
        for kind, gap, found in zip(kinds, unseen, periods, strict=True)  # type: ignore[arg-type]
    ]
    for kind, (period, phases) in zip(kinds, rows_of, strict=True):
        if period <= 0:
            continue
        alike = [
            k for k, (other, _) in zip(kinds, rows_of, strict=True) if abs(other - period) < PERIOD_TOLERANCE * period
        ]
        members = _as_wide(kind, max(alike, key=lambda k: len(k.members)), strips)
        usual = strips.marked[:, members].any(axis=0)
        places = [
            (at, kind.at[_within(kind.at, street)])
            for street, phase in zip(streets, phases, strict=True)
            if phase is not None
            for at in np.arange(street.start + (phase - street.start) % period, street.stop, period)
        ]
        for at, events in places:
            near = np.abs(events - at)
            if near.min() > FARTHEST * period:
                continue
            hit = bool((near < 0.15 * period).any())
            middle = events[near.argmin()] if hit else at
            first = round(middle - (kind.thickness - 1) / 2)
            rows = slice(max(0, first), first + kind.thickness)
            # Where part of the row was seen and shows no line, there is none.
            seen = strips.known[rows][:, members][:, usual]
            if hit or seen.mean() < 0.25:
                result[rows, members[0] : members[-1] + 1] = True
    return result


def _shared(
    kind: _Kind, gap: Mask, streets: Sequence[slice], found: tuple[float, _Phases], periods: list[tuple[float, _Phases]]
) -> tuple[float, _Phases]:
    """Period and phases of a kind of line, and of a finer row of another kind if it fits that: both sides of a street are divided
    alike; one that hides more of its lines may seem divided more coarsely."""
    period, phases = found
    for other, _ in periods:
        finer = other > 0 and (period == 0 or _times(period, other) >= 2)
        fit = _fit(kind.at, gap, streets, other) if finer else None
        if fit is not None and len(kind.at) >= 2:
            period, phases = fit[:2]
    return period, phases


def _as_wide(kind: _Kind, widest: _Kind, strips: _Strips) -> NDArray[np.int64]:
    """The strips of a kind of line, and more of them on the side away from the ``widest`` of its rows, up to that one's number,
    where its lines were not seen to end: bays across the street are about as deep as those on this side."""
    outwards = int(np.sign(kind.members.mean() - widest.members.mean()))
    members, rows = kind.members, np.clip(np.round(kind.at).astype(int), 0, len(strips.known) - 1)
    # A line may be a texel aslant, and lie where the seen begins.
    around = np.ones((5, 1), np.uint8)
    empty = cv2.erode((strips.known & ~strips.marked).astype(np.uint8), around).astype(bool)
    while outwards and len(members) < len(widest.members):
        strip = int(members[0 if outwards < 0 else -1]) + outwards
        if not 0 <= strip < strips.known.shape[1]:
            break
        if empty[rows, strip].sum() >= ENDED:
            break
        members = np.sort(np.append(members, strip))
    return members


def _times(long: float, short: float) -> int:
    """How many times one distance goes into another, 0 if it does not."""
    times = round(long / short)
    return times if abs(long - times * short) < PERIOD_TOLERANCE * long else 0


@dataclass(frozen=True, eq=False)
class _Kind:
    """Lines that lie at the same strips.

    Attributes:
        members: (M,) strips; at: (E,) middle rows of the lines; thickness: of one, rows.
    """

    members: NDArray[np.int64]
    at: NDArray[np.float64]
    thickness: int


def _groups(strips: _Strips, goes_on: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """Runs of strips over which lines go on."""
    linked = (goes_on > CONTINUATION_SHARE) | (goes_on.T > CONTINUATION_SHARE)
    ungrouped = set(np.flatnonzero(strips.marked.any(axis=0)).tolist())
    groups = []
    while ungrouped:
        group = {min(ungrouped)}
        while True:
            more = {int(b) for a in group for b in np.flatnonzero(linked[a])} | group
            if more == group:
                break
            group = more
        ungrouped -= group
        if len(group) >= 3:
            groups.append(np.arange(min(group), max(group) + 1))
    return groups


def _kind(strips: _Strips, marked: Mask, members: NDArray[np.int64]) -> _Kind:
    """The lines at some strips, and the strips beside these over which all of them go on that can be seen there."""
    at, thickness = _events(marked[:, members])
    rows = np.clip(np.round(at).astype(int), 0, len(marked) - 1)
    count = marked.shape[1]
    for step in (-1, 1):
        strip = int(members[0 if step < 0 else -1]) + step
        while 0 <= strip < count:
            seen = rows[strips.known[rows, strip]]
            if not len(seen) or strips.marked[seen, strip].mean() <= CONTINUATION_SHARE:
                break
            members = np.sort(np.append(members, strip))
            strip += step
    return _Kind(members, at, thickness)


def _events(marked: Mask) -> tuple[NDArray[np.float64], int]:
    """Middle rows of the lines at some strips (A, M), and how thick they are."""
    crowd = marked.sum(axis=1) >= 2
    parts, count = label(crowd)
    middles = np.array([np.flatnonzero(parts == k).mean() for k in range(1, count + 1)])
    return middles, max(1, round(float(crowd.sum()) / max(count, 1)))


def _period(
    events: NDArray[np.float64], unseen: Mask, streets: Sequence[slice], texels_per_m: float
) -> tuple[float, _Phases]:
    """Distance at which events (E,), in rows, repeat, and the place of one of them for each street; 0 where they do not.

    Args:
        unseen: (A,) rows of which something was not seen.
    """
    none: _Phases = tuple(None for _ in streets)
    if len(events) < LEAST_EVENTS:
        return 0.0, none
    best, found = 0.0, (0.0, none)
    for period in np.arange(PERIODS_M[0] * texels_per_m, PERIODS_M[1] * texels_per_m, 0.5):
        fit = _fit(events, unseen, streets, float(period))
        if fit is not None and fit[2] > best:
            best, found = fit[2], fit[:2]
    return found


def _fit(
    events: NDArray[np.float64], unseen: Mask, streets: Sequence[slice], period: float
) -> tuple[float, _Phases, float] | None:
    """How well events (E,) repeat at a period: the period, the place of one of them for each street, and a score; None where they
    do not."""
    rows = [_row(own, unseen, period) if len(own := events[_within(events, street)]) else None for street in streets]
    # One line alone lies on any row.
    told = [row for row in rows if row is not None and row.events > 1]
    lines, hits, hidden, missed = (
        sum(getattr(row, name) for row in told) for name in ("events", "hits", "hidden", "missed")
    )
    # Each street has a place to choose, and all together a distance: the rest is no chance.
    surplus = hits - len(told) - 1
    regular = hits >= min(LEAST_EVENTS, lines) and hits >= 0.7 * lines and missed <= hits / 4
    regular &= hits > hidden or (hits == hidden and surplus >= SURE_SURPLUS)
    if not told or not regular:
        return None
    phases = tuple(None if row is None else row.phase for row in rows)
    return period, phases, sum(row.score for row in told)


class _Row(NamedTuple):
    """Lines of one street on a row: the place of one, and a score; how many there are, are on it, and would be on it but are in
    unseen ground or missed in seen."""

    phase: float
    score: float
    events: int
    hits: int
    hidden: int
    missed: int


def _row(events: NDArray[np.float64], unseen: Mask, period: float) -> _Row:
    """The row of a period that suits the events (E,) best."""
    slack = 0.02 * period + 2
    rows = []
    for phase in events:
        turn = (events - phase) / period
        off = np.abs(turn - np.round(turn)) * period
        hits = int((off < slack).sum())
        places = np.arange(phase - period * np.round((phase - events.min()) / period), events.max() + slack, period)
        empty = [p for p in places if np.abs(events - p).min() >= slack]
        hidden = sum(1 for p in empty if unseen[min(len(unseen) - 1, max(0, round(p)))])
        missed = len(empty) - hidden
        # Of two distances that explain the same lines the one that supposes fewer others is meant.
        score = (
            hits
            - MISSED_LINE_PENALTY * missed
            - UNSEEN_LINE_PENALTY * hidden
            - (len(events) - hits)
            - 0.1 * float(off[off < slack].mean())
        )
        rows.append(_Row(float(phase), score, len(events), hits, hidden, missed))
    return max(rows, key=lambda row: row.score)


def _within(events: NDArray[np.float64], street: slice) -> Mask:
    """(E,) which events lie on a street's rows."""
    return np.asarray((events >= street.start) & (events < street.stop))
