"""How dark the ground is for what it is, before anything is known of the sun.

What it would look like in full light is taken from two sides: from the rest of its lateral offset, which tells paint and paving
apart, and from the ground around with its label, which still tells where a whole offset lies in shade all along.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.srgb import light_certainty, linear_light
from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import luminance
from unveil_core.inpaint.chart.lateral_profile import lateral_profile
from unveil_core.inpaint.chart.street_chart import StreetChart

__all__ = [
    "LEAST_LIGHT",
    "blueness",
    "in_the_dark",
    "level_by_label",
    "level_by_offset",
    "log_light",
    "sunny_exceptions",
]

OFFSET_M = 12.0
"""Half length of the stretch whose bright texels give the sunlit level of a lateral offset, metres: longer than the shadow of a
house along the street. Chosen on the two sample streets."""
LABEL_M, LABEL_HOP_M = 20.0, 4.0
"""Half length of the stretch, and step, for that of a label: shade that covers an offset for longer leaves others in the sun."""
LABEL_QUANTILE = 0.8
"""Of a label's luminance that stands for its sunlit level: a street whose houses shade four fifths of it is told right."""
BLUER, LEAST_SHARE = 0.33, 0.05
"""Logarithm of the ratio of blue to red by which shade is bluer than what the sun shines on, and the least share of a label's
ground that either of them must be: asphalt of two ages has the same colour."""
MUCH_BLUER = 0.55
"""The same logarithm by which most of a label's ground must be bluer than its few sunny places. On nineteen sunny drawn streets
shade is bluer by 0.7 to 1.5; on three with little shade and two overcast ones nothing stands out so."""
LEAST_TEXELS = 500
"""Fewest texels of a label in such a stretch, of every fifth row."""
ROW_STEP = 5
DARK = 0.46
"""Share of the light of its label's level below which ground starts out as dark: half way, in logarithms, to the fifth of it that
shade leaves."""
LEAST_LIGHT = 0.0015
"""Light that less counts as: five levels of 255, below which there is more noise than light."""


def level_by_offset(chart: StreetChart, seen: Mask) -> Float32:
    """(A, B) luminance of each lateral offset in full light."""
    per_m = 1.0 / chart.texel
    return lateral_profile(
        linear_light(chart.color), seen, window=int(OFFSET_M * per_m), hop=int(OFFSET_M / 3 * per_m)
    )[1]


def level_by_label(chart: StreetChart, seen: Mask) -> Float32:
    """(A, B) luminance in full light of the ground with the texel's label around it; NaN where too little of it was seen."""
    luma, rows = luminance(linear_light(chart.color)), len(seen)
    reach, hop = int(LABEL_M / chart.texel), int(LABEL_HOP_M / chart.texel)
    centres = np.arange(0, rows + hop, hop)
    level = np.full(seen.shape, np.nan, dtype=np.float32)
    for label in np.unique(chart.label[seen]):
        own = seen & (chart.label == label)
        found = np.full(len(centres), np.nan)
        for k, centre in enumerate(centres):
            part = slice(max(0, centre - reach), min(rows, centre + reach + 1), ROW_STEP)
            values = luma[part][own[part]]
            if len(values) > LEAST_TEXELS:
                found[k] = np.quantile(values, LABEL_QUANTILE)
        known = np.isfinite(found)
        if known.any():
            # A street may lie in shade for longer than a stretch: then another part of it tells what the sun makes of it.
            found = np.fmax(found, _in_the_sun(chart.color[::ROW_STEP][own[::ROW_STEP]]))
            along = np.interp(np.arange(rows), centres[known], found[known]).astype(np.float32)
            level = np.where(own, along[:, None], level)
    return level


def _in_the_sun(color: Float32) -> float:
    """Luminance of what the sun shines on of ground (N, 3) of one label; NaN where not all tells of light and shade, two kinds of
    which the darker one is much darker and bluer, for only the sky lights it (the border between them by Otsu, *A threshold
    selection method from gray-level histograms*, 1979)."""
    color = color[light_certainty(color).min(axis=1) > 0]
    if len(color) < LEAST_TEXELS:
        return np.nan
    log = log_light(color)
    steps = cv2.normalize(log, None, 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
    bright = cv2.threshold(steps, 0, 1, cv2.THRESH_OTSU)[1].ravel() > 0
    if min(bright.mean(), 1 - bright.mean()) < LEAST_SHARE:
        return np.nan
    blue = blueness(color)
    fall, tint = (float(np.median(v[~bright]) - np.median(v[bright])) for v in (log, blue))
    return float(np.exp(np.median(log[bright]))) if fall < np.log(DARK) and tint > BLUER else np.nan


def in_the_dark(chart: StreetChart, seen: Mask) -> Mask:
    """(A, B) seen texels that are dark for their label."""
    with np.errstate(invalid="ignore"):
        return seen & (luminance(linear_light(chart.color)) < DARK * level_by_label(chart, seen))


def sunny_exceptions(chart: StreetChart, seen: Mask) -> Mask:
    """(A, B) seen texels on which the sun shines though most of the ground with their label lies in shade: much brighter, and less
    blue."""
    log, blue = log_light(chart.color), blueness(chart.color)
    sunny = np.zeros_like(seen)
    for label in np.unique(chart.label[seen]):
        own = seen & (chart.label == label)
        usual, usual_blue = (float(np.median(plane[own])) for plane in (log, blue))
        sunny |= own & (log > usual - np.log(DARK)) & (blue < usual_blue - MUCH_BLUER)
    return sunny


def blueness(color: Float32) -> Float32:
    """Logarithm of blue over red light, (…) of colours (…, 3): what only the sky lights is bluer, whatever its brightness
    (Finlayson et al., *On the removal of shadows from images*, 2006)."""
    light = np.maximum(linear_light(color[..., ::2]), LEAST_LIGHT)
    return np.asarray(np.log(light[..., 1] / light[..., 0]), dtype=np.float32)


def log_light(color: Float32) -> Float32:
    """(…) logarithm of the luminance of colours (…, 3)."""
    return np.asarray(np.log(np.maximum(luminance(linear_light(color)), LEAST_LIGHT)), dtype=np.float32)


def coarse(plane: NDArray[np.floating], seen: Mask, step: int) -> tuple[Float32, Mask]:
    """Means of a plane (A, B) over ``step`` by ``step`` texels, of those that were seen, and whether half of them were."""
    weight = cv2.blur(seen.astype(np.float32), (step, step))
    mean = cv2.blur(np.where(seen, plane, 0).astype(np.float32), (step, step)) / np.maximum(weight, 1e-6)
    cells = np.s_[step // 2 :: step, step // 2 :: step]
    return mean[cells].astype(np.float32), weight[cells] > 0.5
