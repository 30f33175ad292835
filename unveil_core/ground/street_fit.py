"""The ground of a street, fitted to points on it: a base along the path, a cross profile, and a smooth remainder."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_filter1d, maximum_filter1d, median_filter, minimum_filter1d

from unveil_core.base.mechanisms import on
from unveil_core.base.types import Float64
from unveil_core.geometry.cell_medians import cell_medians, groups
from unveil_core.ground.one_place import limited_to_own
from unveil_core.ground.path import StreetPath
from unveil_core.ground.plain_fit import NOISY_M, height_noise, plain_heights
from unveil_core.ground.street import Ground

__all__ = ["WALL_FOOT_M", "WALL_TOP_M", "fit_street_heights"]

S_CELL_M, T_CELL_M = 1.0, 0.05
"""Cells along the street, where little changes, and across it, where a kerb is a step: ten centimetres put it 2 or 3 pixels off
in a picture from 6 m away."""
WIDEST_M = 25.0
"""Farther aside nothing is ground of this street."""
BASE_M = 2.5
"""Points so near the path tell its height: the lane that the car itself drove on."""
HOP_M, HALF_M, FEWEST_OF_CELL = 8.0, 12.0, 4
"""Distance between stretches of which each has a cross profile of its own, and their half length, longer than two parked cars, both
in metres; and the points that tell of one of its cells. With one profile for all, kerbs were wrong by 5 cm beyond a corner, and
lines read from 10 m away bent half a metre beside them: a drawn street with a corner gains 0.3 dB and finds 73 % of its lines
instead of 68 %, another 58 % instead of 53 %. On straight streets it is the same to a millimetre, and so are 8 or 5 m."""
COARSE = 10
"""Cells across of the remainder, in cells of the cross profile: half a metre."""
THICK_CELLS, APART_M = 13, 0.25
"""What stands out of the cross profile over fewer cells than half of so many, by more metres, is no ground: more than a kerb."""
THIN_CELLS = 5
"""What stands out of heights across the street over fewer cells than half of so many is an error of the cell's."""
SMOOTH_CELLS, LEAST_STEP_M = 4, 0.05
"""Standard deviation of a cross profile's smoothing, in cells, and what it must rise within three of these, metres, for a step to
be left as it is: a lowered kerb's 3 cm is smoothed. On five drawn streets heights spread by 0.1 to 0.2 cm less than without."""
FEW, MOST_FEW = 0.1, 8
"""A cell of the cross profile tells nothing if it has fewer points than this share of what is usual, or than the second number, if
that is less: under parked cars a few surfels of their sides are named for the ground."""
STEADY_M = 0.4
"""What departs from base and profile by more is no ground."""
APART_CELLS, FEWEST_APART = 3, 12
"""Ground beyond so many cells along the street without any is taken for ground if it has at least so many points. At the foot of a
wall across the street a few points lie behind and below it, where no frame looks: they would lead the street on, and down."""
WALL_FOOT_M, WALL_TOP_M = 0.4, 6.0
"""Heights over the ground between which a point on a facade, wall or fence tells where the street ends."""
FEWEST_OF_WALLS, UNDER_WALL = 50, 1.04
"""Points of walls without which they tell nothing; and how far the ground goes on, under a wall, as a share of its offset: 0.3 m in
a street, where it shows in the wall's lowest 6 cm if nothing of that was seen."""
LOW_M, UNDER_CELLS, ROUND_M = 1.0, 2, 0.3
"""What could be removed tells by its parts up to this height that ground is under it, so many cells before and behind as well, and
so far around it, metres: frames show the sides of a car, and no more of its ends than of what stands behind."""
STEP_M, STEP_CELLS = 1.0, 8
"""Difference of the cross profile over so many cells that is a wall, metres: beyond, the street is at an end, or specks of wrong
labels tell of crowns and roofs."""


def fit_street_heights(
    path: StreetPath,
    points: Float64,
    *,
    walls: Float64 | None = None,
    standing: Float64 | None = None,
    sure: Float64 | None = None,
) -> Ground:
    """Height field and lateral limits from ground points.

    The height is a base along the path, plus a cross profile, plus a smooth remainder where points say so. The profile is one for
    the whole street, which continues kerbs under parked cars, and changes along it where a stretch shows another: at a corner
    the kerbs of two streets meet. Of noisy points there is only a parabola across the street.

    Args:
        points: (P, 3) world points on the ground; sure: (Q, 3) measured ones, which count where the others are noisy.
        walls: (W, 3) world points on what ends the street at its sides (facades, fences); None = the ground ends where
            nobody saw any.
        standing: (O, 3) world points on what stands on the ground and could be removed: it goes on under them, whether any was
            seen there or not; None = nothing is known to.
    """
    street = path.to_street(points)
    objects = np.zeros((0, 3)) if standing is None else path.to_street(standing)
    objects = objects[np.abs(objects[:, 1]) < WIDEST_M]
    aside = [float(np.percentile(np.abs(part[:, 1]), 99.5)) for part in (street, objects) if len(part)]
    reach = min(WIDEST_M, max(aside) + T_CELL_M)
    street = street[np.abs(street[:, 1]) <= reach]
    s_low, s_high = _supported(street[:, 0], S_CELL_M)
    street = street[(street[:, 0] >= s_low) & (street[:, 0] <= s_high)]
    rows = max(2, int(np.ceil((s_high - s_low) / S_CELL_M)) + 1)
    columns = max(3, int(np.ceil(2 * reach / T_CELL_M)) + 1)
    a = np.clip(np.round((street[:, 0] - s_low) / S_CELL_M).astype(int), 0, rows - 1)
    b = np.clip(np.round((street[:, 1] + reach) / T_CELL_M).astype(int), 0, columns - 1)

    middle = np.abs(street[:, 1]) < BASE_M
    base = _running_median(a[middle], street[middle, 2], rows)
    base = gaussian_filter1d(base, 1.5, mode="nearest")
    rest = street[:, 2] - base[a]
    profile = _cross_profile(b, rest, columns)
    low, high = _up_to_steps(profile, columns // 2)
    profile = profile[np.clip(np.arange(columns), low, high)]
    inside = (b >= low) & (b <= high)
    street, a, b = street[inside], a[inside], b[inside]
    rest = rest[inside]
    profiles = np.repeat(profile[None], rows, axis=0)
    if on("changing_profile"):
        profiles = profile + _changes_along(a, b, rest - profile[b], rows, columns)
    rest = rest - profiles[a, b]
    # The remainder on coarser cells (1 m x 0.5 m), smoothed with its own support.
    cells = -(-columns // COARSE)
    steady = np.abs(rest) < STEADY_M
    total, weight = np.zeros((rows, cells)), np.zeros((rows, cells))
    np.add.at(total, (a[steady], b[steady] // COARSE), rest[steady])
    np.add.at(weight, (a[steady], b[steady] // COARSE), 1.0)
    smooth = gaussian_filter(total, 1.2) / (gaussian_filter(weight, 1.2) + 0.3)
    centres = (np.arange(columns) - (COARSE - 1) / 2) / COARSE
    remainder = np.stack([np.interp(centres, np.arange(cells), row) for row in smooth])
    height = base[:, None] + profiles + remainder
    if on("plain_ground") and height_noise(street) > NOISY_M:
        measured = np.zeros((0, 3)) if sure is None else path.to_street(sure)
        along, across = s_low + S_CELL_M * np.arange(rows), T_CELL_M * np.arange(columns) - reach
        height = plain_heights(street, measured, along, across, base)  # type: ignore[arg-type]

    left, right = _limits(street, a, rows, reach)
    if len(objects) and on("ground_under_objects"):
        left, right = _under(objects, s_low, base, left, right)
    if walls is not None and len(walls) > FEWEST_OF_WALLS and on("ground_to_walls"):
        side = path.to_street(walls)
        over = side[:, 2] - base[np.clip(np.round((side[:, 0] - s_low) / S_CELL_M).astype(int), 0, rows - 1)]
        upright = (over > WALL_FOOT_M) & (over < WALL_TOP_M) & (np.abs(side[:, 1]) < WIDEST_M)
        left = _wall_limit(side[upright & (side[:, 1] > 0)], s_low, left)
        right = -_wall_limit(side[upright & (side[:, 1] < 0)] * (1, -1, 1), s_low, -right)
    right, left = limited_to_own(path, s_low + S_CELL_M * np.arange(rows), right, left)  # type: ignore[arg-type]
    return Ground(path, float(s_low), -reach, S_CELL_M, T_CELL_M, height, left, right)


def _cross_profile(b: NDArray[np.int64], rest: Float64, columns: int) -> Float64:
    """(columns,) height of each lateral offset over the base; b: (P,) cells of the points, rest: (P,) their heights over it."""
    # A garden wall along the street has more wrong labels than there is ground at its foot, but is thin.
    counts = np.bincount(b)
    fewest = int(np.clip(FEW * np.median(counts[counts > 0]), 1, MOST_FEW)) if len(b) else 1
    around = median_filter(_running_median(b, rest, columns, fewest), THICK_CELLS, mode="nearest")
    near = np.abs(rest - around[b]) < APART_M
    if not near.any():
        return around
    return _but_for_steps(_running_median(b[near], rest[near], columns, fewest))


def _but_for_steps(profile: Float64) -> Float64:
    """A cross profile (columns,), smooth but for its steps: medians of cells are right to a centimetre or two, and by these lines
    across the street, read from 10 m away, had teeth. What is thin goes first."""
    profile = median_filter(profile, THIN_CELLS, mode="nearest")
    reach = 2 * round(3 * SMOOTH_CELLS / 2) + 1
    step = maximum_filter1d(profile, reach) - minimum_filter1d(profile, reach)
    smooth: Float64 = np.where(step < LEAST_STEP_M, gaussian_filter1d(profile, SMOOTH_CELLS, mode="nearest"), profile)
    return smooth


def _changes_along(a: NDArray[np.int64], b: NDArray[np.int64], apart: Float64, rows: int, columns: int) -> Float64:
    """(rows, columns) by how much the cross profile of each row differs from that of the whole street.

    Args:
        a, b: (P,) cells of the points; apart: (P,) their heights over the whole street's profile.
    """
    hop, half = HOP_M / S_CELL_M, HALF_M / S_CELL_M
    stops = np.arange(0.0, rows + hop, hop)
    changes = np.zeros((len(stops), columns))
    steady = np.flatnonzero(np.abs(apart) < STEADY_M)
    along = steady[np.argsort(a[steady], kind="stable")]
    first, last = np.searchsorted(a[along], stops - half, "right"), np.searchsorted(a[along], stops + half, "left")
    for k in range(len(stops)):
        near = along[first[k] : last[k]]
        # Under parked cars the street's own step goes on, moved by what lies beside them.
        change = _running_median(b[near], apart[near], columns, FEWEST_OF_CELL)
        changes[k] = _but_for_steps(change)
    at = np.arange(rows) / hop
    i = np.minimum(at.astype(int), len(stops) - 2)
    u = (at - i)[:, None]
    return np.asarray(changes[i] * (1 - u) + changes[i + 1] * u)


def _up_to_steps(profile: Float64, middle: int) -> tuple[int, int]:
    """First and last cell around the ``middle`` one between which the cross profile has no step as high as a wall."""
    step = np.abs(profile[STEP_CELLS:] - profile[:-STEP_CELLS]) > STEP_M
    before, after = np.flatnonzero(step[: max(0, middle - STEP_CELLS)]), np.flatnonzero(step[middle:])
    low = int(before[-1]) + STEP_CELLS if len(before) else 0
    return low, middle + int(after[0]) if len(after) else len(profile) - 1


def _supported(s: Float64, cell: float) -> tuple[float, float]:
    """First and last arc length with at least three points in a cell, but for few points far from all others."""
    low = float(s.min())
    counts = np.bincount(((s - low) / cell).astype(int))
    full = np.flatnonzero(counts >= 3)
    if not len(full):
        return low, float(s.max())
    runs = np.split(full, np.flatnonzero(np.diff(full) > APART_CELLS) + 1)
    full = np.concatenate([run for run in runs if counts[run].sum() >= FEWEST_APART] or runs)
    return low + cell * float(full[0]), low + cell * float(full[-1] + 1)


def _under(objects: Float64, s_low: float, base: Float64, left: Float64, right: Float64) -> tuple[Float64, Float64]:
    """Limits of the ground, (A,) each, that hold the lower parts of what stands on it, too, (O, 3) street coordinates; base: (A,)
    heights of the lane."""
    row = np.round((objects[:, 0] - s_low) / S_CELL_M).astype(int)
    within = (row >= 0) & (row < len(base))
    objects, row = objects[within], row[within]
    over = objects[:, 2] - base[row]
    low_parts = (over > 0) & (over < LOW_M)
    objects, row = objects[low_parts], row[low_parts]
    left, right = left.copy(), right.copy()
    order = np.argsort(row, kind="stable")
    for k, part in zip(*groups(row[order], objects[order, 1]), strict=True):
        if len(part) >= FEWEST_APART:
            low, high = np.percentile(part, [2, 98])
            first, last = max(0, k - UNDER_CELLS), k + UNDER_CELLS + 1
            left[first:last] = np.maximum(left[first:last], high + ROUND_M)
            right[first:last] = np.minimum(right[first:last], low - ROUND_M)
    return left, right


def _limits(street: Float64, a: NDArray[np.int64], rows: int, reach: float) -> tuple[Float64, Float64]:
    """Largest and smallest lateral offset with ground, per row; as wide behind parked rows as before and after them."""
    left, right = np.full(rows, np.nan), np.full(rows, np.nan)
    order = np.argsort(a, kind="stable")
    for row, part in zip(*groups(a[order], street[order, 1]), strict=True):
        if len(part) >= 12:
            right[row], left[row] = np.percentile(part, [1, 99])
    known = np.isfinite(left)
    if not known.any():
        return np.full(rows, reach), np.full(rows, -reach)
    index = np.arange(rows)
    left, right = np.interp(index, index[known], left[known]), np.interp(index, index[known], right[known])
    left = gaussian_filter1d(minimum_filter1d(maximum_filter1d(left, 13), 7), 1.0)
    right = gaussian_filter1d(maximum_filter1d(minimum_filter1d(right, 13), 7), 1.0)
    return left, right


def _wall_limit(side: Float64, s_low: float, fallback: Float64) -> Float64:
    """Lateral offset (positive) of the walls' foot per row, from a sliding stretch; the fallback where there is none."""
    rows = len(fallback)
    limit = np.full(rows, np.nan)
    row = np.round((side[:, 0] - s_low) / S_CELL_M).astype(int)
    order = np.argsort(row, kind="stable")
    row, offset = row[order], side[order, 1]
    index = np.arange(rows)
    first, last = np.searchsorted(row, index - 3, "left"), np.searchsorted(row, index + 3, "right")
    for r in np.flatnonzero(last - first >= 15):
        # Under the wall, not only up to it: between ground that ends too early and a wall a camera would see the sky.
        limit[r] = max(fallback[r], UNDER_WALL * float(np.median(offset[first[r] : last[r]])))
    known = np.flatnonzero(np.isfinite(limit))
    if not len(known):
        return fallback
    # Where no wall was seen the street is as wide as at the nearest place where one was.
    after = np.searchsorted(known, index).clip(max=len(known) - 1)
    before = (after - 1).clip(min=0)
    nearest = np.where(np.abs(index - known[before]) <= np.abs(known[after] - index), known[before], known[after])
    limit = limit[nearest]
    return median_filter(np.maximum(limit, fallback), 5, mode="nearest")


def _running_median(index: NDArray[np.int64], values: Float64, count: int, fewest: int = 1) -> Float64:
    """Median per bin (count,), those of fewer values and gaps interpolated; 0 where no bin has enough."""
    bins, medians = cell_medians(index, values, fewest=fewest)
    return np.interp(np.arange(count), bins, medians) if len(bins) else np.zeros(count)
