"""From where along the street each column of a facade's gap is best taken.

Columns that look alike above, below and beside the gap fit, and neighbours prefer the same shift, so that whole windows are copied:
the shift-map of Pritch, Kav-Venaki and Peleg (*Shift-map image editing*, 2009) along one axis, where dynamic programming finds the
best one. Where it is known what the house usually shows, the best choice may be to copy nothing.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.parallel import in_parallel
from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.geometry.cheapest_path import cheapest_path
from unveil_core.inpaint.facade.plaster import plaster_colors
from unveil_core.inpaint.facade.shift_kernels import compare_rows

__all__ = ["best_shifts"]

SEARCH_M, STEP_M = 25.0, 0.08
"""Distance along the street that a column may come from, and the grid of shifts, metres: several houses, and a tenth of a window's
width. Chosen on the two sample streets."""
CONTEXT_M, BESIDE_M = 1.6, 0.4
"""Heights above and below a gap, and lengths beside it, within which columns are compared, metres: to the sills and lintels of the
floor above. Chosen on the two sample streets."""
CLOSE_M, CLOSE_WEIGHT = 0.25, 6
"""Distance from the gap, metres, within which a difference counts this many times: there the filling must join. Chosen on the two
sample streets."""
TOGETHER_M = 0.16
"""Half length along the street over which columns are compared together, metres: a single column fits by chance."""
DIFFERENT = 0.5
"""Squared difference of colours, as shares of the plaster's, at which differences are clipped. Chosen on the two sample
streets."""
PLASTER_COST = 0.05
"""Weight of the difference between the plaster's colours: another house may have the same windows. Chosen on the two sample
streets."""
MISSING_COST, CHANGE_COST, DISTANCE_COST = 0.5, 0.8, 5e-5
"""Costs, in clipped squared differences, of a column that holds nothing for the gap, of another shift than the neighbour's, and of
each step of distance. With half of the first and a third of the second, stripes of windows were copied beside each other as a
comb, and most of what a lorry hides to the eaves was left open. Of changes from 0.6 to 2 tried on 29 facades of 18 streets,
0.6 and 0.8 come 0.3 dB nearer to the truth than 1.2, and 2 stays 0.4 dB farther off."""
USUAL_WORTH = 0.3
"""What a copy's texel is worth where it is known what the house usually shows at that height, as a share of any other's.
Taken, not tuned: well under a half, for the foot of a house is mostly plain; not 0, for a copy has sills and grain."""
LIT = 2.0
"""Brightness in the plaster's from which on in all colours a texel is a lit window, or the sky mirrored in one. By day less
than 0.5 % of a facade is as bright; a drawn street at dusk gains 3.1 dB, and streets by day stay the same to the last digit."""
ASKED, CLEAR = 0.3, 0.6
"""Share of a coarse texel from which on it is wanted, and from which on it counts as seen."""
SKY = np.float32(-2.0)
"""What stands for the sky among colours that are shares of the plaster's."""


def best_shifts(
    facade: tuple[Float32, Mask], usual: tuple[Float32, Mask], wanted: Mask, sky: Mask, *, texels_per_m: float
) -> tuple[NDArray[np.int64], Mask]:
    """(A,) by how many rows each row is copied from another, 0 for one that is best left to what the house usually shows, and
    whether it is.

    Args:
        facade, usual: colours (A, B, 3), and where they are known (A, B), of the facade and of what it usually shows.
        wanted: (A, B) to fill; sky: (A, B) texels through which the sky was seen.
    """
    factor = max(1, round(STEP_M * texels_per_m))
    asked, through = _share(wanted, factor) > ASKED, _share(sky, factor) > CLEAR
    shift, possible = _shifts(_coarse(*facade, factor), _coarse(*usual, factor), asked, through, texels_per_m / factor)
    coarse = np.minimum(np.arange(len(wanted)) // factor, len(shift) - 1)
    return shift[coarse] * factor, possible[coarse]


def _share(mask: Mask, factor: int) -> Float32:
    """Of a mask (A, B), how much of each texel it fills, ``factor`` texels to one."""
    size = (-(-mask.shape[1] // factor), -(-mask.shape[0] // factor))
    return np.asarray(cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA))


def _coarse(color: Float32, known: Mask, factor: int) -> tuple[Float32, Mask]:
    """Colours (A, B, 3), ``factor`` texels to one, and where enough of them is known."""
    share = _share(known, factor)
    mean = cv2.resize(
        np.where(known[..., None], color, 0).astype(np.float32), share.shape[::-1], interpolation=cv2.INTER_AREA
    )
    return np.asarray(mean / np.maximum(share, 1e-6)[..., None], dtype=np.float32), share > CLEAR


def _shifts(
    facade: tuple[Float32, Mask], usual: tuple[Float32, Mask], asked: Mask, sky: Mask, per_m: float
) -> tuple[NDArray[np.int64], Mask]:
    """(A,) the shift of each row, 0 for one that is best left to what the house usually shows, and whether there is one.

    Args:
        facade, usual: colours (A, B, 3), and where they are known (A, B), of the facade and of what it usually shows.
        asked: (A, B) what is wanted; sky: (A, B) where the sky is seen.
    """
    (color, walls), (typical, told) = facade, usual
    known = walls | sky
    wanted = asked & ~known
    rows = len(known)
    reach = min(int(SEARCH_M * per_m), rows - 1)
    shifts = np.array([d for d in range(-reach, reach + 1) if d != 0], dtype=np.int64)
    gap = wanted.any(axis=1)
    if not gap.any() or not len(shifts):
        return np.zeros(rows, dtype=np.int64), np.zeros(rows, dtype=bool)
    near = np.ones((2 * int(BESIDE_M * per_m) + 1, 2 * int(CONTEXT_M * per_m) + 1), np.uint8)
    gaps = wanted.astype(np.uint8)
    close = np.ones((2 * int(CLOSE_M * per_m) + 1,) * 2, np.uint8)
    # What adjoins the gap must continue in it; what is farther off says which part of the facade it is.
    context = known * (cv2.dilate(gaps, near) + (CLOSE_WEIGHT - 1) * cv2.dilate(gaps, close)).astype(np.float32)
    along = 2 * int(TOGETHER_M * per_m) + 1

    wall = plaster_colors(color, walls, per_m)
    # Relative to the plaster: in the shade of the street all differences are small. The sky is like nothing but the sky.
    level = np.maximum(wall.mean(axis=1), 0.02)
    color, typical = np.where(sky[..., None], SKY, color / level[:, None, None]), typical / level[:, None, None]
    wall = wall / level[:, None]
    # Beside the gap, too, for some rows are compared together.
    at = np.flatnonzero(cv2.dilate(gap.astype(np.uint8), np.ones((along, 1), np.uint8))[:, 0])
    total, count, lacks, wall_gap = np.zeros((4, len(at), len(shifts) + 1), dtype=np.float32)
    # Where a lit window is not seen, none is made up: beside the street at dusk it is as bright as the sky.
    held = known & ~(color.min(axis=2) > LIT)
    worth = np.where(wanted, np.where(told, USUAL_WORTH, 1), 0).astype(np.float32)
    given = (at, shifts, color, wall, context, known, held, worth, DIFFERENT, total, count, lacks, wall_gap)
    in_parallel(compare_rows, len(at), 8, *given)
    # The last choice is to copy nothing.
    both = context[at] * told[at]
    apart = np.minimum(np.square(color[at] - typical[at]).sum(axis=2), DIFFERENT)
    total[:, -1], count[:, -1], lacks[:, -1] = (both * apart).sum(axis=1), both.sum(axis=1), worth[at].sum(axis=1)
    shifts = np.append(shifts, 0)
    needed = context.sum(axis=1)[at, None]
    total, count, needed = (_together(values, rows, at, along) for values in (total, count, needed))
    missing = np.maximum(wanted.sum(axis=1)[at], 1)[:, None]
    # What cannot be compared counts as rather different.
    mean = (total + 0.5 * DIFFERENT * np.maximum(needed - count, 0)) / np.maximum(needed, 1e-6)
    mean += PLASTER_COST * wall_gap + MISSING_COST * lacks / missing + DISTANCE_COST * np.abs(shifts)
    cost = np.zeros((rows, len(shifts)), dtype=np.float32)
    cost[at] = mean
    shift = np.zeros(rows, dtype=np.int64)
    possible = np.zeros(rows, dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], gap.astype(np.int8), [0]])))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        way = _steadiest(cost[first:last])
        shift[first:last] = shifts[way]
        possible[first:last] = True
    return shift, possible


def _together(values: Float32, rows: int, at: NDArray[np.int64], along: int) -> Float32:
    """(R, D) values of the rows ``at`` as means over ``along`` rows; those of other rows are 0."""
    every = np.zeros((rows, values.shape[1]), dtype=np.float32)
    every[at] = values
    return np.asarray(cv2.blur(every, (1, along)))[at]


def _steadiest(cost: Float32) -> NDArray[np.int64]:
    """(A,) columns of the cheapest path through ``cost`` (A, D), every change of the choice costing the same."""
    choices = np.arange(cost.shape[1])

    def step(total: Float64) -> tuple[NDArray[np.int64], Float64]:
        best = int(total.argmin())
        stay = total <= total[best] + CHANGE_COST
        return np.where(stay, choices, best), np.where(stay, total, total[best] + CHANGE_COST)

    return cheapest_path(cost, step)
