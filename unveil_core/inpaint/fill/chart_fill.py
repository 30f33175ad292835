"""Fills the chart: removes the shadows of removed objects from it, and invents what nobody saw.

What nobody saw is carried there from what was seen, lines along the street and all else by kriging; its texture comes from the
same lateral offset elsewhere along the street, patch by patch.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.mechanisms import on
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import grow
from unveil_core.inpaint.chart.street_chart import INVENTED, OBSERVED, OUTSIDE, RELIT, StreetChart
from unveil_core.inpaint.chart.street_parts import parts_between_corners
from unveil_core.inpaint.fill.carried import carried_surface
from unveil_core.inpaint.fill.texture import texture_for
from unveil_core.inpaint.light.darkness import sunny_exceptions
from unveil_core.inpaint.light.relight import (
    prevailing_shade,
    relighting_gain,
    shadows_of_removed,
    still_dark,
    under_an_even_sky,
)

__all__ = ["SHADOW_REACH_M", "fill_chart"]

WINDOW_M, HOP_M = 5.0, 4.0
"""Half length of the stretch whose median stands for a lateral offset, and the distance between such stretches, metres: longer
than a parked car, so that each holds open road; chosen on the two sample streets."""
SHADOW_REACH_M = 5.0
"""How far from its object a removed object's shadow may reach, metres: a car's, with the sun 17 degrees high. How far they do reach
is measured, see ``light.relight.evident_reach``."""
BORDER_M = 0.12
"""Width beyond the border of a shadow or an object that is neither, metres: the penumbra, and texels that mix the two."""
ASIDE_M = 0.4
"""Width beyond a removed object's shadow within which it may still be darker for it, metres: it tells nothing of the ground."""
CLOSE_M = 0.6
"""Distance from a removed object within which frames show the invented ground instead of their own pixels, metres: there they are
too mixed with the object to be read. Chosen on the two sample streets."""


def fill_chart(
    chart: StreetChart,
    footprint: Mask,
    casting: Mask | None = None,
    *,
    shadow_reach_m: float = SHADOW_REACH_M,
    progress: Progress = no_progress,
) -> StreetChart:
    """Relight what lay in the shadow of removed objects, and invent what nobody saw, in the light that prevails around it.

    Args:
        chart: as read.
        footprint: (A, B) texels under or inside removed objects; casting: (A, B) of those whose shadows go, None = all.
        shadow_reach_m: how far a removed object's shadow reaches; 0 = shadows stay.
    """
    per_m = 1.0 / chart.texel
    seen = chart.source == OBSERVED
    rows, columns = seen.shape
    s, t = chart.coordinates()
    inside = chart.ground.inside(np.repeat(s, columns), np.tile(t, rows)).reshape(rows, columns)
    usual = seen & ~sunny_exceptions(chart, seen) if on("sunny_exceptions") else seen
    window, hop = int(WINDOW_M * per_m), max(1, int(HOP_M * per_m))
    shade = prevailing_shade(chart.color, usual, footprint, window=window, hop=hop, per_m=per_m)
    casting = footprint if casting is None else casting
    shadow, hopeless = shadows_of_removed(
        chart.color, seen, shade, footprint, casting, reach_m=shadow_reach_m, per_m=per_m
    )
    hole = inside & (~seen | hopeless)
    # The penumbra reaches a little beyond what counts as dark.
    wide = grow(shadow, BORDER_M * per_m)
    sound = seen & ~hole & ~grow(shadow, ASIDE_M * per_m) & ~grow(footprint, BORDER_M * per_m)
    target, fine = _carried(chart, sound)

    color, source, gain = chart.color.copy(), chart.source.copy(), chart.gain.copy()
    if shadow.any():
        relit = shadow & seen & ~hole
        gain = relighting_gain(chart.color, target, seen, shadow, wide, relit, per_m=per_m)
        dim = still_dark(chart.color * gain, target, relit, hole, per_m=per_m)
        if on("still_dark") and dim.any():
            hole, hopeless, relit = hole | dim, hopeless | dim, relit & ~dim
            gain = relighting_gain(chart.color, target, seen, shadow, wide, relit, per_m=per_m)
        if on("even_sky"):
            gain = under_an_even_sky(gain, shadow, footprint, per_m)
        gain[hole] = 1.0
        lifted = (gain.max(axis=2) > 1.0) & seen & ~hole
        color[lifted] = np.clip(color[lifted] * gain[lifted], 0, 1)
        source[relit] = RELIT
    progress(1, 2, "filling the street")
    labels = _labels(chart, seen, hole)
    texture = texture_for(hole, fine, sound, chart.texel) if on("quilting") else np.zeros_like(target)
    color[hole] = np.clip(target[hole] + texture[hole], 0, 1)
    source[hole] = INVENTED
    # Beyond the street the chart goes on as it is carried, so that nothing black is blended in at its edge.
    beyond = ~inside & ~seen
    color[beyond] = target[beyond]
    source[beyond] = OUTSIDE
    progress(2, 2, "filling the street")
    replaced = hole & (hopeless | grow(footprint, CLOSE_M * per_m))
    return replace(chart, color=color, source=source, gain=gain, label=labels, replaced=replaced)


def _carried(chart: StreetChart, sound: Mask) -> tuple[Float32, Float32]:
    """(A, B, 3) the ground as it is carried to where nobody saw it, on each street between corners by itself, and (A, B, 3) where
    it is known what is finer than that: texture.

    Args:
        sound: (A, B) texels that show the ground as it will be.
    """
    seen = np.where((chart.source == OBSERVED)[..., None], chart.color, 0).astype(np.float32)
    ground, fine = np.zeros_like(seen), np.zeros_like(seen)
    for part in _streets(chart, sound):
        ground[part], fine[part] = carried_surface(seen[part], sound[part], chart.texel)
    return ground, fine


def _streets(chart: StreetChart, known: Mask) -> list[slice]:
    """The rows of all, then those of each street between corners of which something is ``known`` (A, B): in a corner the ground is
    that of all, before and after it each street has its own."""
    if not on("streets_apart"):
        return [slice(None)]
    streets = parts_between_corners(chart.ground.path, chart.coordinates()[0])
    return [slice(None), *(part for part in streets if len(streets) > 1 and known[part].any())]


def _labels(chart: StreetChart, seen: Mask, hole: Mask) -> NDArray[np.int16]:
    """(A, B) the chart's labels; unknown ones in the hole become the commonest of their lateral offset."""
    labels = chart.label.copy()
    unknown = hole & (labels < 0)
    if unknown.any():
        labels[unknown] = _lateral_labels(chart.label, seen)[np.nonzero(unknown)[1]]
    return labels


def _lateral_labels(label: NDArray[np.int16], seen: NDArray[np.bool_]) -> NDArray[np.int16]:
    """The commonest label per lateral offset (B,)."""
    kinds = [k for k in np.unique(label[seen]) if k >= 0]
    if not kinds:
        return np.full(label.shape[1], -1, dtype=np.int16)
    counts = np.stack([((label == k) & seen).sum(axis=0) for k in kinds])
    return np.asarray(kinds, dtype=np.int16)[counts.argmax(axis=0)]
