"""What nobody saw of a wall: carried over like the ground, with detail of other parts laid on that."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unveil_core.base.types import Float32, Mask
from unveil_core.inpaint.fill.carried import carried_surface
from unveil_core.inpaint.fill.quilting import quilt
from unveil_core.inpaint.fill.texture import SHARE

__all__ = ["WallFill", "fill_wall"]

PATCH_M, SEARCH_M = 1.2, 25.0
"""Side of a patch of detail, and how far along the street one may come from, metres: a window's width, and some houses."""


class WallFill(NamedTuple):
    """A wall without gaps.

    Attributes:
        color: (A, B, 3); filled: (A, B) texels that were filled; opened: (A, B) those through which the sky shows.
    """

    color: Float32
    filled: Mask
    opened: Mask


def fill_wall(color: Float32, known: Mask, wanted: Mask, sky: Mask | None = None, *, texel: float) -> WallFill:
    """Fill the ``wanted`` texels of a wall.

    Args:
        color: (A, B, 3), rows along the street, columns upwards; known: (A, B) texels of the wall that were seen; wanted: (A, B) to
            fill; sky: (A, B) texels through which the sky was seen.
        texel: side of a texel, metres.
    """
    nothing = np.zeros_like(wanted)
    if not (wanted.any() and known.any()):
        return WallFill(color.copy(), nothing, nothing)
    opened = nothing if sky is None or not sky.any() else wanted & _over_the_eaves(known, wanted, sky)
    filled = wanted & ~opened
    surface, fine = carried_surface(color, known, texel)
    # From above: what hides a wall stands at its foot, and what lies over it tells where its windows are.
    fine, seen, hole = (np.ascontiguousarray(fine[:, ::-1]), *(m[:, ::-1].copy() for m in (known, filled)))
    detail = quilt(fine, seen, hole, patch=round(PATCH_M / texel), search=round(SEARCH_M / texel))[:, ::-1]
    made = np.clip(surface + np.float32(SHARE) * detail, 0, max(1.0, float(surface.max())))
    return WallFill(np.where(filled[..., None], made, color), filled, opened)


def _over_the_eaves(known: Mask, wanted: Mask, sky: Mask) -> Mask:
    """(A, B) what lies as high as the sky that a row shows, or over the eaves, which go on along the street between rows that show
    them."""
    rows, heights = np.arange(len(known)), np.arange(known.shape[1])
    lowest = np.where(sky.any(axis=1), sky.argmax(axis=1), len(heights))
    under = heights < lowest[:, None]
    top = np.where(known & under, heights, -1).max(axis=1)
    hidden = (wanted & under & (heights > top[:, None])).any(axis=1)
    told = np.flatnonzero((top >= 0) & (lowest < len(heights)) & ~hidden)
    eaves = np.interp(rows, told, lowest[told]) if len(told) else np.full(len(rows), len(heights))
    over: Mask = heights >= np.minimum(eaves, lowest)[:, None]
    return over
