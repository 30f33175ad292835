"""The chart's ground in the light of one photograph, as the ground around a hole shows it.

Exposure, haze, reflections of what stands beside the street: what the light by view leaves is smooth in a picture, and is carried
from the ring of seen ground into the hole, as in seamless cloning (Farbman et al., *Coordinates for instant image cloning*,
SIGGRAPH 2009); here as a factor of linear light, so that shade stays shade.
"""

from __future__ import annotations

import numpy as np

from unveil_core.base.srgb import light_certainty
from unveil_core.base.types import Float32, Levels, Mask
from unveil_core.geometry.fields.pull_push import pull_push
from unveil_core.geometry.fields.robust import held_near_median
from unveil_core.geometry.images import area_px, scale_from_384
from unveil_core.inpaint.light.view_light import light_of, lit

__all__ = ["in_local_light"]

LEAST_RING_PX = 30
"""Fewest pixels of the ring for a comparison, at 384x256."""
SMOOTH_PX = 4.0
"""Length over which the factor is averaged, pixels at 384, rounded to a power of two. From 2 to 16 the holes of two real drives
are the same within 0.05 dB."""
LEAST_SPREAD = 0.05
"""Least standard deviation of differences on the ring, logarithm: the grain of asphalt."""


def in_local_light(photograph: Levels, chart: Float32, known: Mask, plain: Mask) -> Float32:
    """Colours of the chart as this photograph would show them.

    Args:
        photograph: (H, W, 3); chart: (H, W, 3), white 1, sampled from the chart where ``known`` (H, W).
        plain: (H, W) pixels of which both show the same ground in the same light.
    Returns:
        (H, W, 3), likewise; the chart's own where the ring is too small to tell.
    """
    plain = plain & known
    weight = np.zeros(plain.shape, np.float32)
    weight[plain] = light_certainty(np.stack([photograph[plain] / np.float32(255), chart[plain]])).min(axis=(0, 2))
    plain = weight > 0
    if plain.sum() < area_px(plain.shape, LEAST_RING_PX):
        return chart
    left = light_of(photograph[plain]) - light_of(255 * chart[plain])
    factor = np.zeros_like(chart)
    factor[plain] = held_near_median(left, left, LEAST_SPREAD)
    levels = max(0, round(float(np.log2(SMOOTH_PX * scale_from_384(plain.shape[1])))))
    factor = pull_push(factor, weight / weight.max(), levels)
    result = chart.copy()
    result[known] = lit(np.maximum(chart[known], 0), factor[known])
    return result
