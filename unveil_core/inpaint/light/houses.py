"""Completes houses for the shadow map: as solid columns, because what cars or the image's border hide of a wall stops light too."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import grey_closing, grey_opening, label

from unveil_core.base.mechanisms import on
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.chart.street_chart import StreetChart
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels, concatenate

__all__ = ["as_high_as_beside", "flush_with_facades", "of_something_long", "solid_columns"]

COLUMN_M = 0.3
"""Side of the columns that solid things are filled in, metres: moves an outline's shadow by half of it. Chosen on the two sample
streets."""
BEYOND_M = 16.0
"""Length of the houses that are added beyond both ends of the drive, metres: beside the first camera nobody saw any, and their
shadows reach into the drive. Chosen on the two sample streets."""
LAST_M, OVERLAP_M = 3.3, 1.2
"""Length of the last house that gives the facade's offset for what is added, and by how much that overlaps it, metres. Chosen on
the two sample streets."""
GOES_ON_M = 3.0
"""Length by which the last observed house is extended unless the shadows say otherwise, metres. Chosen on parked_street."""
FOOT_M = 1.0
"""Height over the ground up to which columns keep their full thickness, metres: no light must come through at a wall's foot."""
NEXT_AFTER_M, NEXT_HIGH_M = tuple(np.arange(0.0, 9.1, 0.5)), (0.0, *np.arange(3.0, 15.1, 1.0))
"""Distances from the last observed house at which the next may begin, and heights that it may have, metres: up to a side street's
width, and from none to five floors."""
OVER_M = 0.4
"""Height over a column's top that must lie in some image for its top to be believed, metres."""
LEAST_M = 2.0
"""Shortest wall along the street, metres: shorter things that are labelled as houses are lamps and pillars."""
DENSE_M = 1.2
"""Length of facade within which its top is found at least once, metres; gaps and chimneys up to that length are filtered out."""
FACADE_M, EAVES_M = 3.0, 1.0
"""Half length of the stretch over which a facade is straight, and depth behind it within which a house is as high as its eaves,
metres. Chosen on the two sample streets."""
HOUSE_M, BESIDE_M = 2.0, 10.0
"""Least height of a house, and distance along the street over which a height is carried to where the image cuts it off, metres.
Chosen on the two sample streets."""
PART_OF_HEIGHT = 0.6
"""Share of the facade's height under which something stands before the house, as a fence does."""


def solid_columns(
    chart: StreetChart,
    surfels: Surfels,
    solid: Sequence[int],
    cameras: Sequence[Camera],
    judge: Callable[[Surfels], float | None] | None = None,
) -> Surfels:
    """Discs that fill the columns under the tops of solid things, and houses beyond both ends of the drive.

    Args:
        solid: labels of what is solid down to the ground.
        judge: how well the shadows of given discs agree with the observed ground, more is better; None where no ground is
            observed. It decides where the houses beyond the drive's ends begin and how high they are.
    """
    path, cell = chart.ground.path, COLUMN_M
    street = path.to_street(surfels.means.detach().double().numpy())[np.isin(surfels.labels.numpy(), list(solid))]
    foot = chart.ground.height_at(street[:, 0], street[:, 1])
    index = np.round(street[:, :2] / cell).astype(np.int64)
    columns, member = np.unique(index, axis=0, return_inverse=True)
    top = np.full(len(columns), -np.inf)
    np.maximum.at(top, member.ravel(), street[:, 2] - foot)
    long = of_something_long(columns)
    columns, top = columns[long], top[long]
    flush = ~_protruding(columns * cell, columns * cell, slack=1.5 * cell)  # type: ignore[arg-type]
    columns, top = columns[flush], top[flush]
    top = as_high_as_beside(chart, columns * cell, top, cameras)  # type: ignore[arg-type]
    parts, tops = [columns], [top]
    for end in _ends(columns, top, round(BEYOND_M / COLUMN_M)) if on("houses_beyond") else ():

        def score(after: float, high: float, end: _End = end) -> float:
            found = None if judge is None else judge(_discs(chart, *end.drawn_out(after, high), surfels.sh_degree))
            return 0.0 if found is None else found

        # By default the last house is extended a little, and the next one is as high as the others on this side.
        after, high = GOES_ON_M, end.typical
        if judge is not None:
            high = max((high, *NEXT_HIGH_M), key=lambda h: score(after, h))
            by_start = {o: score(o, high) for o in (after, *NEXT_AFTER_M)}
            best = max(by_start.values())
            # Of what explains the dark places equally well, that which darkens least: a house that begins as late as it may.
            if best > 0 or by_start[after] < best:
                after = max(o for o, found in by_start.items() if found == best)
        drawn, height = end.drawn_out(after, high)
        parts.append(drawn)
        tops.append(height)
    return _discs(chart, np.concatenate(parts), np.concatenate(tops), surfels.sh_degree)


def _discs(chart: StreetChart, columns: NDArray[np.int64], top: NDArray[np.float64], sh_degree: int) -> Surfels:
    """Discs that fill columns (C, 2) up to their tops (C,)."""
    path, cell = chart.ground.path, COLUMN_M
    levels = np.arange(1, int(np.ceil(top.max(initial=0.0) / cell)) + 1) * cell
    which, level = np.nonzero(levels[None] < top[:, None])
    at = columns[which] * cell
    # A column is as thick as its discs: its face, not its middle, is the facade. At the foot no light must come through.
    at[:, 1] += np.where(levels[level] > FOOT_M, np.sign(at[:, 1]) * cell / 2, 0.0)
    height = chart.ground.height_at(at[:, 0], at[:, 1]) + levels[level]  # type: ignore[arg-type]
    points = path.to_world(np.stack([at[:, 0], at[:, 1], height], axis=1))
    # Lying and standing: from any side one of the two is broad.
    up = np.repeat(path.axes[2:3], len(points), axis=0)
    across = path.to_world(np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    side = np.repeat(np.diff(across, axis=0), len(points), axis=0)
    parts = [
        surfels_from_points(
            points,
            np.zeros((len(points), 3), np.uint8),
            np.zeros(len(points), np.int64),
            normal,
            np.full(len(points), cell),
            sh_degree=sh_degree,
            opacity=0.95,
            scale_factor=0.5,
        )
        for normal in (up, side)
    ]
    return concatenate(parts)


def flush_with_facades(chart: StreetChart, surfels: Surfels, solid: Sequence[int]) -> NDArray[np.bool_]:
    """(N,) bool, False for surfels of houses that float in front of their facade: reconstruction draws hidden parts of a wall out
    towards the cameras, and high up that casts a shadow far over the street."""
    street = chart.ground.path.to_street(surfels.means.detach().double().numpy())[:, :2]
    houses = np.flatnonzero(np.isin(surfels.labels.numpy(), list(solid)))
    columns = np.unique(np.round(street[houses] / COLUMN_M).astype(np.int64), axis=0)
    columns = columns[of_something_long(columns)] * COLUMN_M  # type: ignore[assignment]
    result = np.ones(len(street), dtype=bool)
    result[houses] = ~_protruding(street[houses], columns, slack=COLUMN_M)  # type: ignore[arg-type]
    return result


def _protruding(points: NDArray[np.float64], houses: NDArray[np.float64], *, slack: float) -> NDArray[np.bool_]:
    """(P,) bool, which points (P, 2), street coordinates, protrude from the facades by more than ``slack`` metres.

    Args:
        houses: (C, 2) columns of houses.
    """
    result = np.zeros(len(points), dtype=bool)
    for left in (False, True):
        side = houses[(houses[:, 1] > 0) == left]
        index = np.flatnonzero((points[:, 1] > 0) == left)
        if not len(side) or not len(index):
            continue
        first = side[:, 0].min()
        row = np.round((side[:, 0] - first) / COLUMN_M).astype(np.int64)
        facade = _facade_offset(side, row)
        at = np.round((points[index, 0] - first) / COLUMN_M).astype(np.int64)
        beside = (at >= 0) & (at < len(facade))
        result[index[beside]] = np.abs(points[index[beside], 1]) < facade[at[beside]] - slack
    return result


def _facade_offset(columns: NDArray[np.float64], row: NDArray[np.int64]) -> NDArray[np.float64]:
    """(R,) distance of one side's facade from the path per row, the median of the rows around; inf where there is none.

    Args:
        columns: (C, 2) street coordinates, row: (C,) of each.
    """
    nearest = np.full(row.max() + 1, np.inf)
    np.minimum.at(nearest, row, np.abs(columns[:, 1]))
    known = np.flatnonzero(np.isfinite(nearest))
    half = round(FACADE_M / COLUMN_M)
    facade = np.full(len(nearest), np.inf)
    for r in range(len(nearest)):
        around = known[np.abs(known - r) <= half]
        if len(around):
            facade[r] = np.median(nearest[around])
    return facade


def _in_sight(points: NDArray[np.float64], cameras: Sequence[Camera]) -> NDArray[np.bool_]:
    """(P,) bool, whether a point (P, 3) lies in some camera's image, occlusion aside."""
    seen = np.zeros(len(points), dtype=bool)
    for camera in cameras:
        left = np.flatnonzero(~seen)
        if not len(left):
            break
        seen[left[camera.shown(points[left])[0]]] = True
    return seen


def of_something_long(columns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(C,) whether columns (C, 2) belong to something as long as a house: lamps are sometimes labelled as one."""
    if not len(columns):
        return np.zeros(0, dtype=bool)
    index = columns - columns.min(axis=0)
    plane = np.zeros(index.max(axis=0) + 1, dtype=bool)
    plane[index[:, 0], index[:, 1]] = True
    parts, count = label(plane, np.ones((3, 3)))
    part = parts[index[:, 0], index[:, 1]]
    first, last = np.full(count + 1, np.iinfo(np.int64).max), np.full(count + 1, -1)
    np.minimum.at(first, part, index[:, 0])
    np.maximum.at(last, part, index[:, 0])
    return np.asarray((last - first)[part] * COLUMN_M >= LEAST_M)


def as_high_as_beside(
    chart: StreetChart, at: NDArray[np.float64], top: NDArray[np.float64], cameras: Sequence[Camera]
) -> NDArray[np.float64]:
    """Tops (C,) of columns at street coordinates (C, 2); where the images' border cuts a house off, its height is taken from
    farther along."""
    result, ground = top.copy(), chart.ground
    for left in (False, True):
        side = np.flatnonzero((at[:, 1] > 0) == left)
        if not len(side):
            continue
        row = np.round((at[side, 0] - at[side, 0].min()) / COLUMN_M).astype(np.int64)
        ridge = np.full(row.max() + 1, -np.inf)
        # Roofs rise behind the facade.
        outer = np.abs(at[side, 1]) < _facade_offset(at[side], row)[row] + EAVES_M
        np.maximum.at(ridge, row[outer], top[side[outer]])
        highest = np.zeros(len(ridge), dtype=np.int64)
        reaches = outer & (top[side] >= ridge[row])
        highest[row[reaches]] = side[reaches]
        # The facade is not equally dense everywhere, and chimneys are no ridge.
        size = 2 * round(DENSE_M / COLUMN_M) + 1
        ridge = grey_opening(grey_closing(np.maximum(ridge, 0.0), size), size)
        house = np.flatnonzero(ridge > HOUSE_M)
        s, t = at[highest[house]].T
        over = np.stack([s, t, ground.height_at(s, t) + ridge[house] + OVER_M], axis=1)
        ends = _in_sight(ground.path.to_world(over), cameras)
        known, cut = house[ends], house[~ends]
        if not len(known) or not len(cut):
            continue
        gap = np.abs(cut[:, None] - known[None])
        raised = np.zeros(len(ridge))
        raised[cut] = np.where(gap.min(axis=1) * COLUMN_M < BESIDE_M, ridge[known][gap.argmin(axis=1)], 0.0)
        # What is much lower than the facade stands before the house.
        facade = outer & (top[side] > PART_OF_HEIGHT * ridge[row])
        result[side] = np.where(facade, np.maximum(top[side], raised[row]), top[side])
    return result


@dataclass(frozen=True, eq=False)
class _End:
    """Where the houses of one side end as far as they were seen: the first camera did not see the house beside it.

    Attributes:
        offsets: (L,) lateral indices of the last columns; last: their height.
        rows: (R,) indices along the street that the houses may go on over, from the last that were seen.
        step: (R,) how many rows each lies beyond these.
        typical: height of the houses on this side.
    """

    offsets: NDArray[np.int64]
    last: float
    rows: NDArray[np.int64]
    step: NDArray[np.int64]
    typical: float

    def drawn_out(self, after: float, high: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Columns (C, 2) and their tops (C,), if the last house goes on for ``after`` metres and the next is so high."""
        columns = np.stack([np.repeat(self.rows, len(self.offsets)), np.tile(self.offsets, len(self.rows))], axis=1)
        return columns, np.repeat(np.where(self.step < round(after / COLUMN_M), self.last, high), len(self.offsets))


def _ends(columns: NDArray[np.int64], top: NDArray[np.float64], beyond: int) -> list[_End]:
    """Both ends of the houses on both sides, for columns (C, 2) with their tops (C,)."""
    ends = []
    for left in (False, True):
        side = (columns[:, 1] > 0) == left
        if not side.any():
            continue
        along = columns[side, 0]
        ridge = np.full(np.ptp(along) + 1, -np.inf)
        np.maximum.at(ridge, along - along.min(), top[side])
        typical = float(np.median(ridge[np.isfinite(ridge)]))
        for end, sign in ((along.min(), -1), (along.max(), 1)):
            last = side & (np.abs(columns[:, 0] - end) < round(LAST_M / COLUMN_M))
            step = np.arange(-round(OVERLAP_M / COLUMN_M), beyond + 1)
            ends.append(_End(np.unique(columns[last, 1]), float(top[last].max()), end + sign * step, step, typical))
    return ends
