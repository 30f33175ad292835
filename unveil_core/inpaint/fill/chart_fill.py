"""Fills the chart: removes the shadows of removed objects from it, and invents what nobody saw.

What nobody saw is carried there from what was seen, lines along the street and all else by kriging; its texture comes from the
same lateral offset elsewhere along the street, patch by patch.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.mechanisms import on
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.srgb import relight
from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import grow
from unveil_core.inpaint.chart.lateral_profile import lateral_profile
from unveil_core.inpaint.chart.street_chart import INVENTED, OBSERVED, OUTSIDE, RELIT, StreetChart
from unveil_core.inpaint.chart.street_parts import parts_between_corners
from unveil_core.inpaint.fill.carried import carried_surface
from unveil_core.inpaint.fill.texture import texture_for
from unveil_core.inpaint.light.darkness import in_the_dark, sunny_exceptions
from unveil_core.inpaint.light.relight import (
    prevailing_shade,
    relighting_gain,
    shadows_of_removed,
    still_dark,
    under_an_even_sky,
)
from unveil_core.inpaint.light.shade import (
    CONTACT_M,
    Light,
    Profile,
    Shade,
    read_shade,
    shade_where_unseen,
)

__all__ = ["SHADOW_REACH_M", "fill_chart"]

WINDOW_M, HOP_M = 5.0, 4.0
"""Half length of the stretch whose median stands for a lateral offset, and the distance between such stretches, metres: longer
than a parked car, so that each holds open road; chosen on the two sample streets."""
LONG_WINDOW_M, LONG_HOP_M = 20.0, 8.0
"""The same where the sun is known: it tells what is painted there, and a zebra crossing is 4 m long."""
SHADOW_REACH_M = 2.0
"""Without a known sun: how far from its object a removed object's shadow may reach, metres. An even sky loses the share
(1 - d / sqrt(d^2 + h^2)) / 2 of its light at a distance d from a long wall of height h: 2 m from a van a sixth, hardly seen."""
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
    *,
    light: Light | None = None,
    shadow_reach_m: float = SHADOW_REACH_M,
    progress: Progress = no_progress,
) -> StreetChart:
    """Relight what lay in the shadow of removed objects, and invent what nobody saw.

    Args:
        chart: as read.
        footprint: (A, B) texels under or inside removed objects.
        light: the sun and its shadows; None where it does not shine or is not known. Then dark texels near the objects are their
            shadow, and what is invented has the shade that prevails around it.
        shadow_reach_m: how far a removed object's shadow reaches where the light is not known, metres; 0 = shadows stay.
    """
    per_m = 1.0 / chart.texel
    seen = chart.source == OBSERVED
    rows, columns = seen.shape
    s, t = chart.coordinates()
    inside = chart.ground.inside(np.repeat(s, columns), np.tile(t, rows)).reshape(rows, columns)
    # Without a known sun all has the light that prevails.
    usual = seen & ~sunny_exceptions(chart, seen) if light is None and on("sunny_exceptions") else seen
    shade = _shade(chart, usual, footprint, light)
    shadow, hopeless = shadows_of_removed(
        chart.color, seen, shade, footprint, light, reach_m=shadow_reach_m, per_m=per_m
    )
    hole = inside & (~seen | hopeless)
    # The penumbra reaches a little beyond what counts as dark.
    wide = grow(shadow, BORDER_M * per_m)
    sound = seen & ~hole & ~grow(shadow, ASIDE_M * per_m) & ~grow(footprint, BORDER_M * per_m)
    missing = _missing_light(light, shade.dark & ~shadow, sound, per_m=per_m)
    illumination: NDArray[Any] = 1 - missing[..., None] * (1 - shade.ratio)
    even = sound & ~grow((missing > 0.02) & (missing < 0.98), BORDER_M * per_m)
    # In full sun, as codes, whose noise is about the same in all: what the ground and its texture are carried from.
    sunny = np.where(seen[..., None], relight(chart.color, 1 / illumination), 0).astype(np.float32)
    ground, fine = _carried(chart, sunny, even)
    target = relight(ground, illumination)

    color, source, gain = chart.color.copy(), chart.source.copy(), chart.gain.copy()
    if shadow.any():
        relit = shadow & seen & ~hole
        gain = relighting_gain(chart.color, target, seen, shadow, wide, relit, per_m=per_m)
        dim = still_dark(relight(chart.color, gain), target, relit, hole, per_m=per_m)
        if on("still_dark") and dim.any():
            hole, hopeless, relit = hole | dim, hopeless | dim, relit & ~dim
            gain = relighting_gain(chart.color, target, seen, shadow, wide, relit, per_m=per_m)
        if light is None and on("even_sky"):
            gain = under_an_even_sky(gain, shadow, footprint, per_m)
        gain[hole] = 1.0
        lifted = (gain.max(axis=2) > 1.0) & seen & ~hole
        color[lifted] = relight(color[lifted], gain[lifted])
        source[relit] = RELIT
    progress(1, 2, "filling the street")
    labels = _labels(chart, seen, hole)
    texture = texture_for(hole, fine, even, chart.texel) if on("quilting") else 0
    fill = relight((ground + texture)[hole], illumination[hole])
    color[hole] = np.clip(fill, 0, max(1.0, float(color[seen].max(initial=0.0))))
    source[hole] = INVENTED
    # Beyond the street the chart goes on as it is carried, so that nothing black is blended in at its edge.
    beyond = ~inside & ~seen
    color[beyond] = target[beyond]
    source[beyond] = OUTSIDE
    progress(2, 2, "filling the street")
    replaced = hole & (hopeless | grow(footprint, CLOSE_M * per_m))
    return replace(chart, color=color, source=source, gain=gain, label=labels, replaced=replaced)


def _carried(chart: StreetChart, sunny: Float32, even: Mask) -> tuple[Float32, Float32]:
    """(A, B, 3) the ground in full light as it is carried to where nobody saw it, on each street between corners by itself, and
    (A, B, 3) where it is known what is finer than that: texture.

    Args:
        sunny: (A, B, 3) as seen, shade taken away; even: (A, B) where that can be trusted.
    """
    ground, fine = np.zeros_like(sunny), np.zeros_like(sunny)
    for part in _streets(chart, even):
        ground[part], fine[part] = carried_surface(sunny[part], even[part], chart.texel)
    return ground, fine


def _streets(chart: StreetChart, known: Mask) -> list[slice]:
    """The rows of all, then those of each street between corners of which something is ``known`` (A, B): in a corner the ground is
    that of all, before and after it each street has its own."""
    if not on("streets_apart"):
        return [slice(None)]
    streets = parts_between_corners(chart.ground.path, chart.coordinates()[0])
    return [slice(None), *(part for part in streets if len(streets) > 1 and known[part].any())]


def _profile(chart: StreetChart) -> Profile:
    """Running medians of the lateral offsets of a chart, of each street between corners by itself."""
    per_m = 1.0 / chart.texel
    window, hop = int(LONG_WINDOW_M * per_m), max(1, int(LONG_HOP_M * per_m))

    def profile(color: Float32, usable: Mask) -> Float32:
        result = np.empty_like(color)
        for part in _streets(chart, usable):
            result[part] = lateral_profile(color[part], usable[part], window=window, hop=hop)[0]
        return result

    return profile


def _shade(chart: StreetChart, seen: Mask, footprint: Mask, light: Light | None) -> Shade:
    """Which texels of those that count as ``seen`` (A, B) lie in shadow, and what shadow takes."""
    per_m = 1.0 / chart.texel
    if light is None:
        window, hop = int(WINDOW_M * per_m), max(1, int(HOP_M * per_m))
        return prevailing_shade(chart.color, seen, footprint, window=window, hop=hop, per_m=per_m)
    profile = _profile(chart)
    # Right beside an object it is dark whatever the sun does, which would pass for the colour of its offset.
    clear = ~grow(footprint, CONTACT_M * per_m)
    return read_shade(
        chart.color,
        seen,
        light.kept | light.gone,
        lambda c, usable: profile(c, usable & clear),
        texels_per_m=per_m,
        start=in_the_dark(chart, seen & clear),
    )


def _missing_light(light: Light | None, remaining: Mask, sound: Mask, *, per_m: float) -> Float32:
    """(A, B) how much of the sun's light the empty street lacks, 0 to 1.

    Args:
        remaining: (A, B) seen texels in the shadows that stay; sound: (A, B) texels that show the ground as it will be.
    """
    missing = np.zeros(sound.shape, dtype=np.float32)
    if light is not None:
        missing = shade_where_unseen(light, sound, remaining, texels_per_m=per_m)
        missing[sound] = cv2.GaussianBlur(remaining.astype(np.float32), (0, 0), 0.03 * per_m)[sound]
    return missing


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
