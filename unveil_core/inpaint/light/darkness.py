"""Ground that is much brighter than most of its kind, because the sun comes through there."""

from __future__ import annotations

import numpy as np

from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import luminance
from unveil_core.inpaint.chart.street_chart import StreetChart

__all__ = ["sunny_exceptions"]

MUCH_BLUER = 0.25
"""Logarithm of the ratio of blue to red by which most of a label's ground must be bluer than its few sunny places. On nineteen
sunny drawn streets shade is bluer by 0.3 to 0.7; on three with little shade and two overcast ones nothing stands out so."""
DARK = 0.7
"""Share of the level in the sun below which ground is dark: half way, in logarithms, to the half that shade leaves."""


def sunny_exceptions(chart: StreetChart, seen: Mask) -> Mask:
    """(A, B) seen texels on which the sun shines though most of the ground with their label lies in shade: much brighter, and less
    blue."""
    log = np.log(np.maximum(luminance(chart.color), 0.02))
    blue = _blueness(chart.color)
    sunny = np.zeros_like(seen)
    for label in np.unique(chart.label[seen]):
        own = seen & (chart.label == label)
        usual, usual_blue = (float(np.median(plane[own])) for plane in (log, blue))
        sunny |= own & (log > usual - np.log(DARK)) & (blue < usual_blue - MUCH_BLUER)
    return sunny


def _blueness(color: Float32) -> Float32:
    """Logarithm of blue over red, (…) of colours (…, 3): what only the sky lights is bluer, whatever its brightness (Finlayson et
    al., *On the removal of shadows from images*, 2006)."""
    return np.asarray(np.log(np.maximum(color[..., 2], 0.02) / np.maximum(color[..., 0], 0.02)), dtype=np.float32)
