"""Finds single thick lines straight across the street: stop lines, and nothing that is as bright and no line.

Lengths follow from how streets are painted; what else was tried, was tried on drawn charts (``tests/inpaint/fill``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label, map_coordinates

from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.inpaint.fill.strips import strip_means

__all__ = ["LEAST_CLEAR_M", "ThickLine", "thick_lines"]

BIN_M = 0.1
"""Width in t of the strips that lines are looked for in, metres: less than half of a gap between the dashes of a line to give way
at (0.25 m), so that one strip at least lies in the gap."""
KNOWN_SHARE = 0.6
"""Share of a strip's width, or of the middle of a line there, that must be seen to judge it: as of other transverse markings."""
CONTRAST, LEAST_LEVEL = 0.1, 0.15
"""Differences of luma, in [0, 1], from the street before and behind it: from which on something may be a line, as of other
markings, and that of one as a whole. Worn paint has about 0.2; a joint of concrete or lighter asphalt may have 0.1."""
LOOSE_M, THICKNESS_M = (0.2, 0.75), (0.27, 0.65)
"""Extent along the street of what may be a line, strip by strip, and of a line at half of its level, metres: 0.3 to 0.6 m are
usual; lines of bays (0.1 to 0.15 m) are thinner, and bars of crossings longer."""
MARGIN_M, BESIDE = 0.2, 1 / 3
"""Length before and behind a line that must be seen without paint, metres, and how bright it may be, as a share of the line's
level: at a step of brightness, or amid larger paint, it is brighter."""
WORN_M = 0.3
"""Width in t over which worn paint is a line, metres: wear is in spots of a centimetre to a decimetre, and a piece of a line that
is looked for at least three times as wide."""
LINK_M, STRAY_M, ON_LINE = 0.6, 0.08, 0.8
"""Distance across the street over which pieces of one line are joined, from the straight line that their middles may be, metres,
and share of them that must be as close: beside a bar (0.5 m) of a crossing right after it its edge is not seen; two texels."""
UNEVEN_M = 0.05
"""Standard deviation of the middles, and of the thickness along a line, metres. Of drawn ones with 0.03 of grain both are less than
0.02; arrowheads have 0.1 and more."""
SLOPE = 0.15
"""Rows per column that a line may be aslant: 8 degrees, more than a driver's path is off the lane's direction."""
INNER, PAINTED, WORN = 0.75, 0.4, 0.2
"""Share of a line's thickness, about its middle, that tells whether a strip shows it, and shares of the level above which it does,
by itself and beside one that does: of worn paint a third is left in spots, in a gap of 0.25 m seen from 10 m a sixth."""
LEAST_CLEAR_M = 0.8
"""Length of a line, metres, over which both of its edges must be seen: more than an arrowhead or a letter is wide."""
APART_M, ALONE = 1.6, 0.3
"""Distance, metres, at which no other line may lie beside more than this share of a line: the bars of a crossing of the street that
joins lie across this one, up to 1.6 m from each other."""
TINT = 0.35
"""Difference between channels of a line's brightness, as a share of it. White paint on grey asphalt has nearly none; a strip of sun
in what was taken for shade has more than 0.5, as the sun is that much yellower than the sky."""


@dataclass(frozen=True, eq=False)
class _Strips:
    """A chart on a grid that is coarse across the street.

    Attributes:
        detail, known: (A, B, 3) and (A, B) of the chart; per_m: texels.
        value, sure: (A, S) mean luma of a strip's width in a row, and whether enough of it was seen; width: of a strip, texels.
    """

    detail: Float32
    known: Mask
    per_m: float
    value: Float32
    sure: Mask
    width: int

    def middle(self, strips: NDArray[Any]) -> Float64:
        """Columns of the middles of strips."""
        return np.asarray((strips + 0.5) * self.width - 0.5, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class ThickLine:
    """A straight line across the street.

    Attributes:
        slope, offset: its middle is row ``offset + slope * column``.
        clear: (N,) columns where both of its edges were seen, increasing.
        state: (B,) per column 1 where its middle was seen, -1 where none was seen there, 0 where that is not known.
        profile: (2 H + 1, 3) detail along the street about its middle; thickness: texels; level: of its luma.
    """

    slope: float
    offset: float
    clear: NDArray[np.int64]
    state: NDArray[np.int8]
    profile: Float32
    thickness: float
    level: float

    def row(self, columns: NDArray[Any]) -> Float64:
        """Rows of its middle."""
        return np.asarray(self.offset + self.slope * columns, dtype=np.float64)


def thick_lines(detail: Float32, known: Mask, *, texels_per_m: float) -> list[ThickLine]:
    """The thick lines of a chart.

    Args:
        detail: (A, B, 3) difference from the lateral offset's median; known: (A, B) where it can be trusted.
    """
    strips = _strips(detail, known, texels_per_m)
    # Worn paint is a line only over some width, one beside bars only between them.
    marks = np.concatenate([_marks(strips), _marks(_smoothed(strips))])
    found = []
    for members in _pieces(marks, strips):
        fit = _straight(marks[members], strips)
        if fit is not None and _alone(fit, np.delete(marks, members, axis=0), strips):
            line = _line(*fit, strips)
            found += [] if line is None else [line]
    return found


def _strips(detail: Float32, known: Mask, per_m: float) -> _Strips:
    width = max(1, round(BIN_M * per_m))
    value, many = strip_means(detail.mean(axis=2), known, width)
    return _Strips(detail, known, per_m, value.astype(np.float32), many >= KNOWN_SHARE * width, width)


def _smoothed(strips: _Strips) -> _Strips:
    size = (2 * round(WORN_M * strips.per_m / strips.width / 2) + 1, 1)
    many = cv2.blur(strips.sure.astype(np.float32), size)
    value = cv2.blur(strips.value * strips.sure, size) / np.maximum(many, 1e-3)
    return replace(strips, value=value)


def _marks(strips: _Strips) -> Float64:
    """(N, 3) strip, middle row and thickness of what is as long along the street as a line, with no paint before and behind it."""
    bright = strips.sure & (strips.value > CONTRAST)
    edges = np.diff(np.pad(bright, ((1, 1), (0, 0))).astype(np.int8), axis=0).T
    strip, first = np.nonzero(edges == 1)
    end = np.nonzero(edges == -1)[1]
    margin = max(1, round(MARGIN_M * strips.per_m))
    whole = (first >= margin) & (end + margin <= len(bright))
    whole &= (end - first >= LOOSE_M[0] * strips.per_m) & (end - first <= LOOSE_M[1] * strips.per_m)
    strip, first, end = strip[whole], first[whole], end[whole]
    bare = np.pad(np.cumsum(strips.sure & ~bright, axis=0), ((1, 0), (0, 0)))
    sides = (bare[first, strip] - bare[first - margin, strip]) + (bare[end + margin, strip] - bare[end, strip])  # type: ignore[var-annotated]
    return np.stack([strip, (first + end - 1) / 2, end - first], axis=1)[sides == 2 * margin].astype(np.float64)


def _pieces(marks: Float64, strips: _Strips) -> list[NDArray[np.int64]]:
    """Numbers of the marks (N, 3) that lie beside each other, where these are enough for a line."""
    if not len(marks):
        return []
    place = np.zeros(strips.value.shape, dtype=np.uint8)
    strip, row = marks[:, 0].astype(int), np.round(marks[:, 1]).astype(int)
    place[row, strip] = 1
    place = cv2.dilate(place, np.ones((2 * round(STRAY_M * strips.per_m) + 1, 1), np.uint8))
    reach = 2 * round(LINK_M * strips.per_m / strips.width / 2) + 1
    parts, _ = label(cv2.morphologyEx(place, cv2.MORPH_CLOSE, np.ones((1, reach), np.uint8)))
    part = parts[row, strip]
    large = np.flatnonzero(np.bincount(part) * strips.width >= LEAST_CLEAR_M * strips.per_m)
    return [np.flatnonzero(part == k) for k in large]


def _straight(marks: Float64, strips: _Strips) -> tuple[float, float, NDArray[np.int64]] | None:
    """Slope and offset of the line that marks (N, 3) lie on, and their strips; None where they are too few, or not on one."""
    least, most = LEAST_CLEAR_M * strips.per_m / strips.width, STRAY_M * strips.per_m
    if not len(marks):
        return None
    place = np.stack([strips.middle(marks[:, 0]), np.ones(len(marks))], axis=1)
    close = np.ones(len(marks), dtype=bool)
    for _ in range(2):
        fit = np.linalg.lstsq(place[close], marks[close, 1], rcond=None)[0]
        off = marks[:, 1] - place @ fit
        close = np.abs(off) < most
        if len(np.unique(marks[close, 0])) < least or close.mean() < ON_LINE:
            return None
    uneven = max(float(off[close].std()), float(marks[close, 2].std()))
    if abs(fit[0]) > SLOPE or uneven > UNEVEN_M * strips.per_m:
        return None
    return float(fit[0]), float(fit[1]), np.unique(marks[close, 0]).astype(np.int64)


def _alone(fit: tuple[float, float, NDArray[np.int64]], others: Float64, strips: _Strips) -> bool:
    """Whether none of the other marks (N, 3) lies before or behind a line."""
    slope, offset, own = fit
    off = np.abs(others[:, 1] - offset - slope * strips.middle(others[:, 0]))
    return bool(np.isin(own, others[off < APART_M * strips.per_m, 0]).mean() < ALONE)


def _line(slope: float, offset: float, own: NDArray[np.int64], strips: _Strips) -> ThickLine | None:
    """What lies on a straight line; None where that is no paint.

    Args:
        own: (N,) strips where both edges are seen.
    """
    half = round((LOOSE_M[1] / 2 + MARGIN_M / 2) * strips.per_m)
    columns = np.arange(strips.value.shape[1] * strips.width)
    rows = np.arange(-half, half + 1)[:, None] + offset + slope * columns
    at = np.stack([rows, np.broadcast_to(columns.astype(np.float64), rows.shape)])
    planes = [map_coordinates(strips.detail[..., k], at, order=1, mode="nearest") for k in range(3)]
    around = np.stack(planes, axis=2).astype(np.float32)
    # Between two rows both must be known.
    seen = np.asarray(map_coordinates(strips.known.astype(np.float32), at, order=1, mode="constant") > 0.99)

    clear = (own[:, None] * strips.width + np.arange(strips.width)).ravel()
    often = seen[:, clear].mean(axis=1) > 0.5
    profile = np.zeros((len(rows), 3), dtype=np.float32)
    profile[often] = np.nanmedian(np.where(seen[:, clear, None], around[:, clear], np.nan)[often], axis=1)
    luma = profile.mean(axis=1)
    if luma[half] <= 0 or not often[half]:
        return None
    plateau = luma > 0.7 * luma.max()
    level = float(np.median(luma[plateau]))
    thickness = _thickness(luma)
    margin, border = max(1, round(MARGIN_M / 2 * strips.per_m)), round(thickness / 2) + 2
    beside = max(luma[half - border - margin : half - border].mean(), luma[half + border + 1 :][:margin].mean())
    tint = float(np.ptp(np.median(profile[plateau], axis=0)))
    if level < LEAST_LEVEL or beside > BESIDE * level or tint > TINT * level:
        return None
    if not THICKNESS_M[0] <= thickness / strips.per_m <= THICKNESS_M[1]:
        return None
    most = int(INNER * thickness / 2)
    inner = slice(half - most, half + most + 1)
    painted = np.repeat(_painted(around[inner].mean(axis=2), seen[inner], level, strips.width), strips.width)
    state = np.zeros(strips.known.shape[1], dtype=np.int8)
    state[: len(painted)] = painted
    return ThickLine(slope, offset, clear, state, profile, thickness, level)


def _thickness(luma: Float32) -> float:
    """Length over which a profile (2 H + 1,) is over half of its maximum, about its middle; 0 where that is less."""
    over = luma - luma.max() / 2
    middle = len(over) // 2
    total = 0.0
    for side in (over[middle:], over[middle::-1]):
        out = np.flatnonzero(side <= 0)
        if not len(out) or out[0] == 0:
            return 0.0
        at = int(out[0])
        total += at - float(side[at] / (side[at] - side[at - 1]))
    return total


def _painted(luma: Float32, seen: Mask, level: float, width: int) -> NDArray[np.int8]:
    """(S,) per strip of that width whether the middle of a line, (R, S * width), shows it: 1 or -1, 0 where that is not known."""
    there = seen.reshape(len(seen), -1, width)
    many = there.sum(axis=(0, 2))
    value = np.where(there, luma.reshape(there.shape), 0).sum(axis=(0, 2)) / np.maximum(many, 1)
    sure = many >= KNOWN_SHARE * there.shape[0] * width
    painted = sure & (value > PAINTED * level)
    painted |= sure & (value > WORN * level) & np.convolve(painted, np.ones(3), "same").astype(bool)
    return np.where(sure, np.where(painted, 1, -1), 0).astype(np.int8)
