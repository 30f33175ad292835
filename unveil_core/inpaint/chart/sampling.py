"""How a picture in chart coordinates is sampled: taps along a pixel's footprint on the ground, blur levels across it.

Footprints on the ground are long along the ray and narrow across it, so this is anisotropic filtering (McCormack et al., *Feline*,
1999), with blurs at full size instead of a pyramid: charts are small.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from unveil_core.base.kernels.compiled import njit
from unveil_core.base.parallel import EXACT, in_parallel
from unveil_core.base.types import Float32, Float64

__all__ = ["blur_levels", "sample_levels"]

TAPS = 7
"""Samples along a pixel's footprint, as in anisotropic texture filtering."""
LONGEST_TEXELS = 100.0
"""Longest footprint that is sampled, texels (4 m): the blur levels bridge the distance between its taps up to there."""
LEVELS = 4
"""Of blurs, the picture itself among them."""
PIXELS = 2048
"""That a thread takes at a time: some tenths of a millisecond of work."""


def blur_levels(picture: Float32) -> list[Float32]:
    """The picture and its blurs with doubling width, all at full size."""
    blurred = (cv2.GaussianBlur(picture, (0, 0), 0.5 * 2.0**k) for k in range(1, LEVELS))
    return [picture, *(b.reshape(picture.shape) for b in blurred)]  # of one channel OpenCV drops the axis


def sample_levels(levels: Sequence[Float32], place: Float64, footprint: Float64, across: Float64) -> Float32:
    """Filtered look-up.

    Args:
        levels: (A, B, C) each, a picture as :func:`blur_levels` gives it.
        place: (N, 2) row and column of pixel centres in the picture, from texel centres.
        footprint: (N, 2) extent of a pixel along its ray, as a vector; across: (N,) extent across that; texels.
    Returns:
        (N, C) float32.
    """
    level = np.clip(np.log2(np.maximum(across, 1.0)), 0, len(levels) - 1.001)
    lower = level.astype(np.int64)
    length = np.maximum(np.hypot(footprint[:, 0], footprint[:, 1]), 1e-12)
    spread = footprint * np.minimum(1.0, LONGEST_TEXELS / length)[:, None]
    taps = np.linspace(-0.5, 0.5, 2 * TAPS + 1)[1::2]
    result = np.zeros((len(place), levels[0].shape[2]), dtype=np.float32)
    blend = (level - lower).astype(np.float32)
    planes = tuple(np.ascontiguousarray(picture, dtype=np.float32) for picture in levels)
    in_parallel(_sample, len(place), PIXELS, planes, place, spread, lower, blend, taps, result)
    return result


@njit(**EXACT)
def _sample(first, stop, levels, place, spread, lower, blend, taps, result):  # type: ignore[no-untyped-def]
    rows, columns, channels = levels[0].shape
    share = np.float32(1.0 / len(taps))
    one = np.float32(1.0)
    for n in range(first, stop):
        for tap in taps:
            row = min(max(place[n, 0] + tap * spread[n, 0], 0.0), rows - 1.001)
            column = min(max(place[n, 1] + tap * spread[n, 1], 0.0), columns - 1.001)
            i, j = int(row), int(column)
            u, v = np.float32(row - i), np.float32(column - j)
            for k in range(2):
                picture = levels[lower[n] + k]
                weight = share * (blend[n] if k else one - blend[n])
                for c in range(channels):
                    upper = picture[i, j, c] * (one - v) + picture[i, j + 1, c] * v
                    below = picture[i + 1, j, c] * (one - v) + picture[i + 1, j + 1, c] * v
                    result[n, c] += (upper * (one - u) + below * u) * weight
