"""Fills the gaps of a facade with other parts of it, shifted along the street.

Every column of a gap takes the column of the facade that looks alike above, below and beside the gap, in this house's plaster; what
no column holds is what the house usually shows there. Over short gaps that is bridged.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import masked_blur
from unveil_core.inpaint.facade.bridges import bridge_gaps
from unveil_core.inpaint.facade.column_shifts import best_shifts
from unveil_core.inpaint.facade.plaster import WALL_M, likeness, plaster_colors, unlike_plaster
from unveil_core.inpaint.facade.usual import PLINTH_M, usual_colors

__all__ = ["FacadeFill", "fill_facade"]

STRIP_M = 1.2
"""Shortest part along the street that is copied, metres: what is seen of a house between two cars, a lamp and its foot, would be
repeated as a comb."""
SAME_RATIO = 0.05
"""Difference of a ratio from 1 up to which it is none."""
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
    result, filled, opened = color.copy(), np.zeros_like(wanted), np.zeros_like(wanted)
    taken, ratios = np.zeros(len(color), np.int64), np.ones((len(color), 3), np.float32)
    rows = np.flatnonzero(wanted.any(axis=1))
    if not len(rows):
        return FacadeFill(result, filled, opened, filled, taken, ratios)
    strip = np.ones((2 * round(STRIP_M / 2 * texels_per_m) + 1, 1), np.uint8)
    known = cv2.morphologyEx(known.astype(np.uint8), cv2.MORPH_OPEN, strip).astype(bool)
    wall = plaster_colors(color, known, texels_per_m)
    usual, told = usual_colors(color, known, wall, texels_per_m)
    shift, possible = best_shifts((color, known), (usual, told), wanted, sky, texels_per_m=texels_per_m)
    source = rows + shift[rows]
    usable = possible[rows] & (source >= 0) & (source < len(color))
    rows, source = rows[usable], source[usable]
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
    plaster = np.where(plinth[..., None], np.float32(0), likeness(color[source], wall[source][:, None]))
    grain = _grain(color, known, wall, texels_per_m)
    # Bricks of another house are no texture of plaster.
    damped = np.nan_to_num(np.clip(grain[rows] / np.maximum(grain[source], 1e-3), LEAST_GRAIN, 1), nan=1.0)
    kept = 1 - (1 - damped)[:, None, None] * plaster
    copies = wall[rows, None] ** (1 - kept) * (color[source] * ratios[rows, None] ** plaster) ** kept
    return copies, kept[..., 0]  # type: ignore[return-value]


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
    plaster = known & (likeness(color, wall[:, None])[..., 0] > ALIKE)
    level = np.log(np.maximum(color.mean(axis=-1), 0.02))
    around = masked_blur(level.astype(np.float32), plaster, GRAIN_TEXELS)
    squares = np.where(plaster, (level - around) ** 2, 0).sum(axis=1)
    length = np.ones(2 * max(1, int(WALL_M * texels_per_m)) + 1)
    total, count = (np.convolve(v, length, "same") for v in (squares, plaster.sum(axis=1)))
    enough = count >= GRAIN_M2 * texels_per_m**2
    return np.where(enough, np.sqrt(total / np.maximum(count, 1)), np.nan).astype(np.float32)
