"""The shade of kerb faces: shadow takes little from a face that is turned away from the sun, and much from one turned to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from unveil_core.geometry.images import luminance, masked_blur
from unveil_core.inpaint.light.shade import Shade

__all__ = ["shade_of_kerbs"]

IN_SUN_M, IN_SHADE_M = 0.16, 0.3
"""Distances on both sides of an offset at which the road must lie in the sun for the offset to count as sunlit, and in shadow to
count as shaded, metres: just wider than a kerb's face in the chart, and than a penumbra. Chosen on the two sample streets."""
STRETCH_M, WINDOW_M = 1.5, 40.0
"""Length of an offset that must be seen sunlit and shaded for its ratio to be read, and length of street that one ratio is read
for, metres. Chosen on the two sample streets."""
MIN_RATIO_DIFFERENCE = 0.12
"""Difference of luma between the shade ratio of an offset and the road's from which on the offset keeps its own, unitless. Chosen
on the two sample streets."""
UNPAINTED = 0.25
"""Quantile of an offset's colours that stands for it: a face looks the same all along, while bars of a crossing that fill half of
what is seen of the shade passed for a face that shadow changes little, and were lines of light along the street."""
DARKEST_FACE = 0.15
"""Least share of a kerb's colour that remains in shadow: its face may look at the sun, and gets half of the sky."""
SUNLIT_SHARE, SHADED_SHARE = 0.1, 0.9
"""Shares of dark texels around a place under which it lies in the sun, and over which in shadow."""


def shade_of_kerbs(color: NDArray[np.float32], sharp: NDArray[np.bool_], shade: Shade, *, texels_per_m: float) -> Shade:
    """The shade with a ratio (A, B, 3) for every texel, and dark also where a kerb that shadow changes little lies in shadow.

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
        for state, metres in ((share < SUNLIT_SHARE, IN_SUN_M), (share > SHADED_SHARE, IN_SHADE_M))
    )
    usual = np.asarray(shade.ratio, dtype=np.float32)
    ratio = np.broadcast_to(usual, color.shape).copy()
    window = int(WINDOW_M * texels_per_m)
    for start in range(0, len(color), window):
        part = np.s_[max(0, start - window // 2) : start + window + window // 2]
        lit, unlit = (_plain(color[part], state[part], int(STRETCH_M * texels_per_m)) for state in (in_sun, in_shade))
        found = np.clip(unlit / np.maximum(lit, 0.02), DARKEST_FACE, 1.0)
        # NaN does not differ
        differs = np.abs(luminance(found) - luminance(usual)) > MIN_RATIO_DIFFERENCE  # type: ignore[arg-type]
        ratio[start : start + window, differs] = found[differs]
    spared = in_shade & (luminance(ratio) > luminance(usual) + MIN_RATIO_DIFFERENCE / 2)
    return replace(shade, ratio=ratio, dark=shade.dark | spared)


def _plain(picture: NDArray[np.float32], mask: NDArray[np.bool_], least: int) -> NDArray[np.float32]:
    """(B, 3) per column what is in the mask (A, B) looks like but for paint, NaN where that is less than ``least``."""
    result = np.full(picture.shape[1:], np.nan, dtype=np.float32)
    for column in np.flatnonzero(mask.sum(axis=0) >= max(1, least)):
        result[column] = np.quantile(picture[mask[:, column], column], UNPAINTED, axis=0)
    return result
