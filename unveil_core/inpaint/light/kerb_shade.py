"""Strips along the street with a light of their own: the face of a kerb that is turned from the sun has little to lose to another
shadow, and one turned to it much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from unveil_core.geometry.images import luminance, masked_blur
from unveil_core.inpaint.chart.rectify import Drift
from unveil_core.inpaint.light.shade import DARKEST, Shade

__all__ = ["shade_of_strips"]

IN_SUN_M, IN_SHADE_M = 0.16, 0.3
"""How far on either side of it there must be sun for a strip to stand in the sun, and shade to stand in the shade, metres."""
STRETCH_M, WINDOW_M = 1.5, 40.0
"""How much of an offset must be seen in the sun and in shade, and the length of street that it is taken for, metres."""
OTHER = 0.12
"""A ratio that differs by more is another one."""


def shade_of_strips(
    color: NDArray[np.float32], sharp: NDArray[np.bool_], shade: Shade, drift: Drift, *, texels_per_m: float
) -> Shade:
    """The shade (see :class:`Shade`) with a ratio (A, B, 3) for every place, and dark also where a strip is, that shadow changes
    little, between two sides in shadow.

    Args:
        color: (A, B, 3) of the chart; sharp: (A, B) texels that were seen well enough for a kerb to show.
    """
    share = masked_blur(shade.dark.astype(np.float32), sharp, 0.04 * texels_per_m)
    if sharp.shape[1] <= 2 * IN_SHADE_M * texels_per_m:
        return shade

    def between(state: NDArray[np.bool_], aside: int) -> NDArray[np.bool_]:
        result = np.zeros_like(state)
        result[:, aside:-aside] = state[:, 2 * aside :] & state[:, : -2 * aside]
        return result & sharp

    in_sun, in_shade = (
        between(sharp & state, round(metres * texels_per_m))
        for state, metres in ((share < 0.1, IN_SUN_M), (share > 0.9, IN_SHADE_M))
    )
    picture, sun = drift.straightened(color, in_sun)
    dark_picture, dark = drift.straightened(color, in_shade)
    usual = np.asarray(shade.ratio, dtype=np.float32)
    ratio = np.broadcast_to(usual, color.shape).copy()
    window = int(WINDOW_M * texels_per_m)
    for start in range(0, len(color), window):
        part = np.s_[max(0, start - window // 2) : start + window + window // 2]
        lit, unlit = (
            _medians(p[part], m[part], int(STRETCH_M * texels_per_m)) for p, m in ((picture, sun), (dark_picture, dark))
        )
        own = np.clip(unlit / np.maximum(lit, 0.02), DARKEST, 1.0)
        differs = np.abs(luminance(own) - luminance(usual)) > OTHER  # NaN does not
        ratio[start : start + window, differs] = own[differs]
    ratio = drift.bent(ratio)
    return replace(shade, ratio=ratio, dark=shade.dark | (in_shade & (luminance(ratio) > luminance(usual) + OTHER / 2)))


def _medians(picture: NDArray[np.float32], mask: NDArray[np.bool_], least: int) -> NDArray[np.float32]:
    """(B, 3) per column the median of what is in the mask (A, B), NaN where that is less than ``least``."""
    result = np.full(picture.shape[1:], np.nan, dtype=np.float32)
    for column in np.flatnonzero(mask.sum(axis=0) >= max(1, least)):
        result[column] = np.median(picture[mask[:, column], column], axis=0)
    return result
