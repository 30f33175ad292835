"""Fills the gaps of a facade with other parts of it, shifted along the street.

Every column of a gap takes the column of the facade that looks alike above, below and beside the gap; neighbours prefer the same
shift, so that whole windows are copied: the shift-map of Pritch, Kav-Venaki and Peleg (*Shift-map image editing*, 2009) along
one axis, where dynamic programming finds the best one. Over short gaps that is bridged.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.parallel import in_parallel
from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.geometry.cheapest_path import cheapest_path
from unveil_core.geometry.images import masked_blur
from unveil_core.inpaint.facade.bridges import bridge_gaps
from unveil_core.inpaint.facade.shift_kernels import compare_rows
from unveil_core.inpaint.facade.usual import PLINTH_M, unlike_plaster, usual_colors

__all__ = ["FacadeFill", "fill_facade"]

SEARCH_M, STEP_M = 25.0, 0.08
"""Distance along the street that a column may come from, and the grid of shifts, metres: several houses, and a tenth of a window's
width. Chosen on the two sample streets."""
STRIP_M = 1.2
"""Shortest part along the street that is copied, metres: what is seen of a house between two cars, a lamp and its foot, would be
repeated as a comb."""
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
WALL_M, HUE, LEVEL = 1.0, 0.2, 0.4
"""Half length along the street over which the plaster's colour is read, metres, and standard deviations of hue and of brightness
(shares) within which something is plaster. Chosen on the two sample streets."""
PLASTER_M2 = 2.0
"""Area of a facade that tells the plaster's colour, square metres, where that much is known anywhere: the far edge of a house with
the sky beside it is a bright streak, and whole houses were brightened to it. From 2 to 4 on the result is the same."""
MISSING_COST, CHANGE_COST, DISTANCE_COST = 0.5, 0.8, 5e-5
"""Costs, in clipped squared differences, of a column that holds nothing for the gap, of another shift than the neighbour's, and of
each step of distance. With half of the first and a third of the second, stripes of windows were copied beside each other as a
comb, and most of what a lorry hides to the eaves was left open. Of changes from 0.6 to 2 tried on 29 facades of 18 streets,
0.6 and 0.8 come 0.3 dB nearer to the truth than 1.2, and 2 stays 0.4 dB farther off."""
USUAL_WORTH = 0.3
"""What a copy's texel is worth where it is known what the house usually shows at that height, as a share of any other's."""
SAME_RATIO = 0.05
"""Difference of a ratio from 1 up to which it is none."""
LIT = 2.0
"""Brightness in the plaster's from which on in all colours a texel is a lit window, or the sky mirrored in one."""
ASKED, CLEAR = 0.3, 0.6
"""Share of a coarse texel from which on it is wanted, and from which on it counts as seen."""
SKY = np.float32(-2.0)
"""What stands for the sky among colours that are shares of the plaster's."""
RATIO_LIMITS = (0.3, 3.0)
"""Limits of the ratio by which a copied column is darkened or brightened to the plaster here: beyond, it is another house."""
GRAIN_TEXELS, GRAIN_M2 = 1.5, 1.0
"""Standard deviation of the Gaussian around which a wall's grain is measured, texels, and the area of plaster that tells it, square
metres: bricks and joints in texels of 4 cm."""
ALIKE, LEAST_GRAIN, OWN_GRAIN = 0.6, 0.2, 0.7
"""Likeness from which on a texel shows plaster, by how much its grain is damped at most, and damped by how much it is no longer
that of the place that it was copied from."""


class FacadeFill(NamedTuple):
    """A facade without gaps.

    Attributes:
        color: (A, B, 3); filled: (A, B) texels that were filled; opened: (A, B) those that show the sky.
        copied: (A, B) texels of ``filled`` that were copied with their grain; shift: (A,) by how many rows; ratio: (A, 3) how much
            brighter.
    """

    color: Float32
    filled: Mask
    opened: Mask
    copied: Mask
    shift: NDArray[np.int64]
    ratio: Float32


def fill_facade(
    color: Float32, known: Mask, wanted: Mask, sky: Mask | None = None, *, texels_per_m: float
) -> FacadeFill:
    """Fill the ``wanted`` texels of a facade.

    Args:
        color: (A, B, 3), rows along the street; known: (A, B) texels of the facade that were seen; wanted: (A, B) to fill; sky:
            (A, B) texels through which the sky was seen.
    """
    fill = _copied(color, known, wanted, np.zeros_like(known) if sky is None else sky, texels_per_m)
    bridges, bridged = bridge_gaps(color, known, wanted, texels_per_m)
    return fill._replace(
        color=np.where(bridged[..., None], bridges, fill.color),
        filled=fill.filled | bridged,
        opened=fill.opened & ~bridged,
        copied=fill.copied & ~bridged,
    )


def _copied(color: Float32, known: Mask, wanted: Mask, sky: Mask, texels_per_m: float) -> FacadeFill:
    """Fill a facade with other parts of itself, see :func:`fill_facade`."""
    strip = np.ones((2 * round(STRIP_M / 2 * texels_per_m) + 1, 1), np.uint8)
    known = cv2.morphologyEx(known.astype(np.uint8), cv2.MORPH_OPEN, strip).astype(bool)
    factor = max(1, round(STEP_M * texels_per_m))
    wall = _plaster(color, known, texels_per_m)
    usual, told = usual_colors(color, known, wall, texels_per_m)
    coarse = _coarse(color, known, factor), _coarse(usual, told, factor)
    asked, through = _share(wanted, factor) > ASKED, _share(sky, factor) > CLEAR
    shift, possible = _shifts(*coarse, asked, through, texels_per_m / factor)
    result, filled, opened = color.copy(), np.zeros_like(wanted), np.zeros_like(wanted)
    rows = np.flatnonzero(wanted.any(axis=1))
    source = rows + shift[np.minimum(rows // factor, len(shift) - 1)] * factor
    usable = possible[np.minimum(rows // factor, len(shift) - 1)] & (source >= 0) & (source < len(color))
    rows, source = rows[usable], source[usable]
    taken, ratios = np.zeros(len(color), np.int64), np.ones((len(color), 3), np.float32)
    if not len(rows):
        return FacadeFill(result, filled, opened, filled, taken, ratios)
    taken[rows] = source - rows
    ratios[rows] = np.clip(_ratios(color, known, rows, source, wall, texels_per_m), *RATIO_LIMITS)
    take = wanted[rows] & known[source]
    plinth = _plinth(usual, told, wall, texels_per_m)
    copies, kept = _in_this_plaster(color, known, rows, source, wall, ratios, plinth[source], texels_per_m)
    copied = np.zeros_like(wanted)
    # Grain is laid down later, in one ratio for a row.
    other = plinth[source] & (np.abs(ratios[rows] - 1).max(axis=1) > SAME_RATIO)[:, None]
    copied[rows] = take & (kept > OWN_GRAIN) & ~other
    result[rows] = np.where(take[..., None], np.clip(copies, 0, 1), result[rows])
    filled[rows], opened[rows] = take, wanted[rows] & sky[source]
    # Below all that is known of it a house is what it usually is, or plaster: what is copied there from around in the images draws
    # windows down to the ground.
    below = wanted & ~filled & ~opened & (_under(known | filled) | plinth)
    result[below] = np.where(told[..., None], usual, wall[:, None])[below]
    return FacadeFill(result, filled | below, opened, copied, taken, ratios)


def _plinth(usual: Float32, told: Mask, wall: Float32, texels_per_m: float) -> Mask:
    """(A, B) where a house is low and not of its plaster's colour, as far as it is ``told`` what it ``usual``ly shows."""
    other = unlike_plaster(usual, wall[:, None])
    # From the ground up: higher, only what lies under a window may be seen.
    plinth: Mask = told & np.logical_and.accumulate(other | ~told, axis=1)
    plinth[:, round(PLINTH_M * texels_per_m) :] = False
    return plinth


def _in_this_plaster(
    color: Float32,
    known: Mask,
    rows: NDArray[np.int64],
    source: NDArray[np.int64],
    wall: Float32,
    ratios: Float32,
    plinth: Mask,
    texels_per_m: float,
) -> tuple[Float32, Float32]:
    """What ``rows`` (R,) get from their ``source`` (R,) in their own plaster (R, B, 3), and how much grain is kept (R, B).

    Args:
        plinth: (R, B) what of the source is no plaster, however alike.
    """
    # Windows and doors do not take the colour of the plaster around them.
    plaster = np.where(plinth[..., None], np.float32(0), _likeness(color[source], wall[source][:, None]))
    grain = _grain(color, known, wall, texels_per_m)
    # Bricks of another house are no texture of plaster.
    damped = np.nan_to_num(np.clip(grain[rows] / np.maximum(grain[source], 1e-3), LEAST_GRAIN, 1), nan=1.0)
    kept = 1 - (1 - damped)[:, None, None] * plaster
    copies = wall[rows, None] ** (1 - kept) * (color[source] * ratios[rows, None] ** plaster) ** kept
    return copies, kept[..., 0]


def _under(known: Mask) -> Mask:
    """(A, B) texels under the lowest known one of their row."""
    return (np.cumsum(known, axis=1) == 0) & known.any(axis=1, keepdims=True)


def _ratios(
    color: Float32, known: Mask, rows: NDArray[np.int64], source: NDArray[np.int64], wall: Float32, texels_per_m: float
) -> Float32:
    """(R, 3) by how much brighter than its ``source`` each of the ``rows`` (R,) is, one value for all that come from one place.

    Compared at the heights that are known of both: behind a lorry only the windows of the upper floor are, and are no plaster.
    Where too few are, the colours ``wall`` (A, 3) of the plaster are compared. One value for a piece is safer than one a row: of
    rows of which little is known the plaster's colour may be that of a window.
    """
    ratio = wall[rows] / np.maximum(wall[source], 1e-3)
    half, shift = max(1, int(WALL_M * texels_per_m)), source - rows
    breaks = np.flatnonzero((np.diff(shift) != 0) | (np.diff(rows) != 1)) + 1
    for first, last in zip([0, *breaks], [*breaks, len(rows)], strict=True):
        d = int(shift[first])
        low, high = max(0, -d, rows[first] - half), min(len(color), len(color) - d, rows[last - 1] + 1 + half)
        here, there = np.s_[low:high], np.s_[low + d : high + d]
        both = known[here] & known[there]
        if both.sum() >= half * half:
            # Of the ratios the middle one: most texels are the same of both, and some a window here and plaster there.
            ratio[first:last] = np.median(color[here][both] / np.maximum(color[there][both], 1e-3), axis=0)
    return np.asarray(ratio, dtype=np.float32)


def _grain(color: Float32, known: Mask, wall: Float32, texels_per_m: float) -> Float32:
    """(A,) standard deviation of the plaster's brightness around its mean nearby, as a share of it; NaN where too little shows."""
    plaster = known & (_likeness(color, wall[:, None])[..., 0] > ALIKE)
    level = np.log(np.maximum(color.mean(axis=-1), 0.02))
    around = masked_blur(level.astype(np.float32), plaster, GRAIN_TEXELS)
    squares = np.where(plaster, (level - around) ** 2, 0).sum(axis=1)
    length = np.ones(2 * max(1, int(WALL_M * texels_per_m)) + 1)
    total, count = (np.convolve(v, length, "same") for v in (squares, plaster.sum(axis=1)))
    enough = count >= GRAIN_M2 * texels_per_m**2
    return np.where(enough, np.sqrt(total / np.maximum(count, 1)), np.nan).astype(np.float32)


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

    wall = _plaster(color, walls, per_m)
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


def _likeness(color: Float32, plaster: Float32) -> Float32:
    """(…, 1) from 0 to 1, how far a colour (…, 3) is the plaster's, in its hue first: plaster in the shade of a sill is plaster."""
    level, usual = (np.maximum(c.mean(axis=-1, keepdims=True), 0.02) for c in (color, plaster))
    hue = ((color / level - plaster / usual) ** 2).sum(axis=-1, keepdims=True)
    return np.asarray(np.exp(-hue / (2 * HUE**2) - (level / usual - 1) ** 2 / (2 * LEVEL**2)), dtype=np.float32)


def _plaster(color: Float32, known: Mask, texels_per_m: float) -> Float32:
    """(A, 3) the colour that most of the facade has, by place along the street."""
    half = max(1, int(WALL_M * texels_per_m))
    hop = max(1, half // 4)
    centres = np.arange(0, len(color) + hop, hop)
    parts = [np.s_[max(0, centre - half) : centre + half + 1 : 2, ::2] for centre in centres]
    area = 4 / texels_per_m**2 * np.array([known[part].sum() for part in parts])
    enough = (area > 0) & (area >= min(PLASTER_M2, area.max() / 2))
    wall = np.full((len(centres), 3), np.nan)
    for k in np.flatnonzero(enough):
        wall[k] = np.median(color[parts[k]][known[parts[k]]], axis=0)
    at = np.flatnonzero(np.isfinite(wall[:, 0]))
    if not len(at):
        return np.full((len(color), 3), 0.5, dtype=np.float32)
    # Not interpolated: from house to house it changes at once.
    nearest = np.abs(np.arange(len(color))[:, None] - centres[at][None]).argmin(axis=1)
    return wall[at][nearest].astype(np.float32)
