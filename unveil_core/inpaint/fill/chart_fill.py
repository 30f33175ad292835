"""Fills the chart: removes the shadows of removed objects from it, and invents what nobody saw.

The colour of a gap is the running median of its lateral offset, which continues paint, kerb and sidewalk; its texture comes from
the same offset elsewhere along the street, patch by patch; transverse markings are extended into it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.geometry.images import disc, grow, luminance, masked_blur, spread_from
from unveil_core.inpaint.chart.lateral_profile import lateral_profile, nearest_known
from unveil_core.inpaint.chart.street_chart import INVENTED, OBSERVED, OUTSIDE, RELIT, StreetChart
from unveil_core.inpaint.chart.street_parts import parts_between_corners
from unveil_core.inpaint.fill.crossings import continue_crossings
from unveil_core.inpaint.fill.quilting import quilt
from unveil_core.inpaint.fill.stop_lines import continue_stop_lines
from unveil_core.inpaint.fill.transverse_markings import continue_transverse_markings
from unveil_core.inpaint.light.darkness import in_the_dark, sunny_exceptions
from unveil_core.inpaint.light.kerb_shade import shade_of_kerbs
from unveil_core.inpaint.light.relight import (
    levelled_border,
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
    beside_lines,
    lines_along,
    read_shade,
    shade_where_unseen,
)

__all__ = ["SHADOW_REACH_M", "fill_chart"]

LONG_WINDOW_M, LONG_HOP_M = 20.0, 8.0
"""The same of the stretch that tells what is painted there: a zebra crossing is 4 m long, and a hole beside it as much again."""
OTHER_PAINT, ACROSS_M = 0.2, 0.4
"""Change of luma between the two stretches from which on they show different paint, and standard deviation across the street over
which all other change is taken for light or age, metres. On a street with a zebra crossing 3.1 dB of what is invented, on two
without +0.05 and -0.4 dB."""
WINDOW_M, HOP_M = 5.0, 4.0
"""Half length of the stretch whose median stands for a lateral offset, and the distance between such stretches, metres: longer
than a parked car, so that each holds open road; chosen on the two sample streets."""
SHADOW_RATIO = 0.82
"""Without a known sun: luma of a texel, as a share of its offset's lit level, below which it lies in shadow. Soft shadows under an
overcast sky take about a quarter of the light; chosen on the two sample streets."""
SHADOW_REACH_M = 2.0
"""Without a known sun: how far from its object a removed object's shadow may reach, metres. An even sky loses the share
(1 - d / sqrt(d^2 + h^2)) / 2 of its light at a distance d from a long wall of height h, so that the light falls to SHADOW_RATIO at
0.85 h: 1.9 m from a van, 1.3 m from a car."""
BLACK_RATIO = 0.3
"""Luma of a shadowed texel, as a share of its lit level, below which it holds no texture to relight and is invented: relighting
would multiply its noise by more than three."""
TEXTURE = 0.8
"""Share of the quilted detail that is added to the medians, 0 to 1: all of it shows the patches' seams. On five drawn streets 0.8
has 68 % of the true gradients where ground is invented and 0.6 has 64 %, for 0.02 dB."""
PATCH_M, SEARCH_M = 0.8, 30.0
"""Side of a texture patch, and how far along the street one may come from, metres. Chosen on the two sample streets."""
COVERED = 0.3
"""Share of a lateral offset, along the street, that has texture, known or quilted: with less it has none of its own."""
FOOT_M = 0.3
"""Width of the strip along both borders of the ground that medians are not read from, metres: at the foot of walls pixels mix, and
after rectification one offset is wall here and sidewalk there. Over twice that width the last inner value is repeated."""
SHARP_M = 10.0
"""Distance of the nearest view from which on the face of a kerb is no more than a pixel, metres, at 384 pixels across 70
degrees."""
STEEP, LINES_M = 0.4, 15.0
"""Change of the light across the border of a shadow next to which no markings are looked for, as a share of the sun's; and how far
from the nearest view they are: farther off a pixel is as long as a bay's line is thick, many times over, at 384 pixels across 70
degrees."""
MARK = 0.06
"""Difference of luma from the lateral offset's median, over a decimetre, from which on something is a marking or a stain, not
texture. Chosen on the two sample streets."""
OUTSTANDING, FAINTEST, ALIKE_M = 6.0, 0.02, 0.25
"""The same as a multiple of the median difference, four standard deviations; the least that is one; and how far across the street
that median is taken, metres."""
BORDER_M = 0.12
"""Width beyond the border of a shadow or an object that is neither, metres: the penumbra, and texels that mix the two."""
LOCAL_M, MOST_LOCAL, OTHER_TINT = (0.5, 1.0, 2.0), 0.3, 0.2
"""Standard deviations of the surroundings, metres, from narrow to broad, that tell how much brighter or darker than its lateral
offset the street is at a place; the change of luma from which on it is paint that does so, and that between channels. On a real
street with asphalt of two ages 1.0 dB of what is invented, on the two sample streets 0.05 and 0.2 dB; up to 4 m is no better."""
DRIVEN_M = 1.0
"""Distance from the path within which the ground is carriageway, metres: a car is twice as wide."""
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
    usual = seen & ~sunny_exceptions(chart, seen) if light is None else seen
    shade = _shade(chart, usual, footprint, light)
    shadow, hopeless = shadows_of_removed(
        chart.color, seen, shade, footprint, light, reach_m=shadow_reach_m, black_ratio=BLACK_RATIO, per_m=per_m
    )
    hole = inside & (~seen | hopeless)
    # The penumbra reaches a little beyond what counts as dark.
    wide = grow(shadow, BORDER_M * per_m)
    sound = usual & ~hole & ~wide & ~grow(footprint, BORDER_M * per_m)
    missing = _missing_light(light, shade.dark & ~shadow, sound, per_m=per_m)
    illumination: NDArray[Any] = 1 - missing[..., None] * (1 - shade.ratio)
    even = sound & ~grow((missing > 0.02) & (missing < 0.98), BORDER_M * per_m)
    # In full sun: what the medians and the texture are taken from.
    sunny = np.where(seen[..., None], chart.color / illumination, 0).astype(np.float32)
    median = _in_the_sun(sunny, even, inside, _profile(chart), per_m=per_m)
    target = median * illumination

    color, source, gain = chart.color.copy(), chart.source.copy(), chart.gain.copy()
    if shadow.any():
        relit = shadow & seen & ~hole
        gain = relighting_gain(chart.color, target, seen, shadow, wide, relit, shade.paint, per_m=per_m)
        dim = still_dark(chart.color * gain, target, relit, hole, per_m=per_m)
        if dim.any():
            hole, hopeless, relit = hole | dim, hopeless | dim, relit & ~dim
            gain = relighting_gain(chart.color, target, seen, shadow, wide, relit, shade.paint, per_m=per_m)
        if light is None:
            gain = under_an_even_sky(gain, shadow, footprint, per_m)
        gain[hole] = 1.0
        lifted = (gain.max(axis=2) > 1.0) & seen & ~hole
        color[lifted] = np.clip(color[lifted] * gain[lifted], 0, 1)
        source[relit] = RELIT
    progress(1, 2, "filling the street")
    # Between two cars there is little ground that no shadow touches, and much of the bay's line.
    steep = cv2.morphologyEx(missing, cv2.MORPH_GRADIENT, disc(BORDER_M * per_m)) > STEEP
    bare = seen & ~hole & ~steep & ~levelled_border(shadow, per_m) & (chart.nearest < LINES_M)
    marked = np.where(bare[..., None], color / illumination - median, 0).astype(np.float32)
    labels = _labels(chart, seen, hole)
    road = inside & (labels == _under_path(labels, inside, t))
    streets = parts_between_corners(chart.ground.path, s)
    markings = _markings(marked, bare, hole, labels, road, median, streets, per_m=per_m)
    invented = _invented(sunny - median, even, hole, markings, per_m=per_m)
    fill = (median + invented) * illumination
    color[hole] = np.clip(fill[hole], 0, 1)
    source[hole] = INVENTED
    # Beyond the street the chart repeats its profile, so that nothing black is blended in at its edge.
    beyond = ~inside & ~seen
    color[beyond] = target[beyond]
    source[beyond] = OUTSIDE
    progress(2, 2, "filling the street")
    replaced = hole & (hopeless | grow(footprint, CLOSE_M * per_m))
    return replace(chart, color=color, source=source, gain=gain, label=labels, replaced=replaced)


def _profile(chart: StreetChart) -> Profile:
    """Running medians of the lateral offsets of a chart, of each street between corners by itself.

    Paint, kerb and sidewalk are those of a long stretch: of a short one zebra bars that end in a hole would be lines along the
    street. How bright they are is that of a short one, all across: light and the asphalt's age change sooner.
    """
    per_m = 1.0 / chart.texel
    windows = [(int(w * per_m), max(1, int(h * per_m))) for w, h in ((LONG_WINDOW_M, LONG_HOP_M), (WINDOW_M, HOP_M))]
    streets = parts_between_corners(chart.ground.path, chart.coordinates()[0])

    def of_one(color: Float32, usable: Mask) -> Float32:
        long, short = (lateral_profile(color, usable, window=window, hop=hop)[0] for window, hop in windows)
        brighter = (short / np.maximum(long, 0.02) - 1).astype(np.float32)
        same = np.abs(luminance(brighter)) < OTHER_PAINT
        return (long * (1 + spread_from(brighter, same, [ACROSS_M * per_m]))).astype(np.float32)

    def profile(color: Float32, usable: Mask) -> Float32:
        result = of_one(color, usable)
        for part in streets if len(streets) > 1 else []:
            if usable[part].any():
                result[part] = of_one(color[part], usable[part])
        return result

    return profile


def _shade(chart: StreetChart, seen: Mask, footprint: Mask, light: Light | None) -> Shade:
    """Which texels of those that count as ``seen`` (A, B) lie in shadow, and what shadow takes."""
    per_m = 1.0 / chart.texel
    if light is None:
        window, hop = int(WINDOW_M * per_m), max(1, int(HOP_M * per_m))
        return prevailing_shade(
            chart.color, seen, footprint, shadow_ratio=SHADOW_RATIO, window=window, hop=hop, per_m=per_m
        )
    profile = _profile(chart)
    # Right beside an object it is dark whatever the sun does, which would pass for the colour of its offset.
    clear = ~grow(footprint, CONTACT_M * per_m)
    shade = read_shade(
        chart.color,
        seen,
        light.kept | light.gone,
        lambda c, usable: profile(c, usable & clear),
        texels_per_m=per_m,
        start=in_the_dark(chart, seen & clear),
    )
    sharp = seen & (chart.nearest < SHARP_M) & ~grow(footprint, CONTACT_M / 4 * per_m)
    return shade_of_kerbs(chart.color, sharp, shade, texels_per_m=per_m)


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


def _in_the_sun(sunny: Float32, even: Mask, inside: Mask, profile: Profile, *, per_m: float) -> Float32:
    """(A, B, 3) what the ground looks like in the sun, from what lies at its lateral offset.

    Args:
        sunny: (A, B, 3) as seen, shade taken away; even: (A, B) where that can be trusted; inside: (A, B) the ground.
    """
    read, kept = (
        cv2.erode(inside.astype(np.uint8), np.ones((1, 2 * int(m * per_m) + 1), np.uint8)).astype(bool)
        for m in (FOOT_M, 2 * FOOT_M)
    )
    median = np.minimum(_to_the_sides(profile(sunny, even & read), kept), 1.0)
    # Brightness varies along the street: more sky, a bright wall across, asphalt of two ages.
    local = (sunny / np.maximum(median, 0.02) - 1).astype(np.float32)
    # Not the bars of a crossing, nor those in the shade, which are as light as asphalt in the sun, and blue.
    same = even & (luminance(local) < MOST_LOCAL) & (np.ptp(local, axis=2) < OTHER_TINT)
    return median * (1 + spread_from(local, same, [m * per_m for m in LOCAL_M]))


def _markings(
    marked: Float32,
    bare: Mask,
    hole: Mask,
    labels: NDArray[np.int16],
    road: Mask,
    median: Float32,
    streets: Sequence[slice],
    *,
    per_m: float,
) -> tuple[Float32, Float32]:
    """Detail (A, B, 3) of the markings in the hole (A, B), and how much of it they are (A, B), 0 to 1.

    Args:
        marked: (A, B, 3) difference from the medians; bare: (A, B) where that can be trusted.
        labels: (A, B) of the ground; road: (A, B) the carriageway; median: (A, B, 3) of the lateral offsets.
        streets: rows before, between and after corners.
    """
    line = lines_along(median, per_m)
    paint = np.where(line[..., None], median - beside_lines(median, line, per_m), 0).astype(np.float32)
    lines, on_line = continue_transverse_markings(marked, bare, hole, texels_per_m=per_m, streets=streets)
    for other, on_other in (
        continue_stop_lines(marked, bare, hole, road, line, texels_per_m=per_m),
        continue_crossings(marked, bare, hole, labels, line, paint, texels_per_m=per_m),
    ):
        more = on_other > on_line
        lines, on_line = np.where(more[..., None], other, lines), np.where(more, on_other, on_line)
    return lines, on_line


def _invented(detail: Float32, even: Mask, hole: Mask, markings: tuple[Float32, Float32], *, per_m: float) -> Float32:
    """(A, B, 3) texture and markings for the hole (A, B).

    Args:
        detail: (A, B, 3) difference from the medians; even: (A, B) where that can be trusted.
        markings: see :func:`_markings`.
    """
    # Texture is fine and faint; transverse markings, and remains of shadows, are no texture to lay down elsewhere.
    broad = np.abs(luminance(masked_blur(detail, even, 0.1 * per_m)))
    faint = even & ~grow(broad > _usual(broad, even, per_m), 0.1 * per_m)
    quilted = quilt(detail, faint, hole, patch=max(6, int(PATCH_M * per_m)), search=int(SEARCH_M * per_m))
    quilted = _beside_what_is_known(quilted, np.where(faint[..., None], detail, 0), hole)
    lines, on_line = markings
    return lines + (1 - on_line[..., None]) * (TEXTURE * quilted)


def _usual(broad: Float32, even: Mask, per_m: float) -> Float32:
    """(B,) by how much the texture of each lateral offset may differ from its median, over a decimetre: paving has joints, and a
    worn line on smooth asphalt is fainter than they are.

    Args:
        broad: (A, B) absolute differences; even: (A, B) where they can be trusted.
    """
    reach, columns = round(ALIKE_M * per_m), broad.shape[1]
    middle = np.arange(0, columns, max(1, reach))
    typical = [broad[:, max(0, c - reach) : c + reach + 1][even[:, max(0, c - reach) : c + reach + 1]] for c in middle]
    spread = [float(np.median(part)) if len(part) else MARK for part in typical]
    return np.clip(OUTSTANDING * np.interp(np.arange(columns), middle, spread), FAINTEST, MARK).astype(np.float32)


def _beside_what_is_known(quilted: Float32, texture: Float32, wanted: Mask) -> Float32:
    """The quilted texture (A, B, 3), with texture at those lateral offsets, too, that nobody saw anywhere along the street, as the
    sidewalk behind a row of parked cars: that beside them, mirrored, so that no column repeats.

    Args:
        texture: (A, B, 3) that is known, 0 elsewhere; wanted: (A, B).
    """
    laid = quilted + np.where(quilted == 0, texture, 0)
    covered = np.count_nonzero(laid.any(axis=2), axis=0) > COVERED * len(laid)
    columns = np.arange(len(covered))
    if not covered.any() or covered.all():
        return quilted
    nearest = nearest_known(covered[:, None])[:, 0]
    mirrored = np.clip(2 * nearest - columns, 0, len(covered) - 1)
    source = np.where(covered[mirrored], mirrored, nearest)
    bare = wanted & ~covered[None]
    return np.where(bare[..., None], laid[:, source], quilted).astype(np.float32)


def _labels(chart: StreetChart, seen: Mask, hole: Mask) -> NDArray[np.int16]:
    """(A, B) the chart's labels; unknown ones in the hole become the commonest of their lateral offset."""
    labels = chart.label.copy()
    unknown = hole & (labels < 0)
    if unknown.any():
        labels[unknown] = _lateral_labels(chart.label, seen)[np.nonzero(unknown)[1]]
    return labels


def _under_path(labels: NDArray[np.int16], inside: Mask, t: Float64) -> int:
    """The commonest label of the ground that was driven on; -1 where none is known."""
    driven = labels[:, np.abs(t) < DRIVEN_M][inside[:, np.abs(t) < DRIVEN_M]]
    kinds, counts = np.unique(driven[driven >= 0], return_counts=True)
    return int(kinds[counts.argmax()]) if len(kinds) else -1


def _to_the_sides(picture: Float32, amid: NDArray[np.bool_]) -> Float32:
    """A picture (A, B, 3) whose rows go on beyond their first and last texel of ``amid`` (A, B) as they are there."""
    columns = amid.shape[1]
    first, last = amid.argmax(axis=1), columns - 1 - amid[:, ::-1].argmax(axis=1)
    any_ = amid.any(axis=1)
    first, last = np.where(any_, first, 0), np.where(any_, last, columns - 1)
    take = np.clip(np.arange(columns)[None], first[:, None], last[:, None])
    return np.take_along_axis(picture, take[..., None], axis=1)


def _lateral_labels(label: NDArray[np.int16], seen: NDArray[np.bool_]) -> NDArray[np.int16]:
    """The commonest label per lateral offset (B,)."""
    kinds = [k for k in np.unique(label[seen]) if k >= 0]
    if not kinds:
        return np.full(label.shape[1], -1, dtype=np.int16)
    counts = np.stack([((label == k) & seen).sum(axis=0) for k in kinds])
    return np.asarray(kinds, dtype=np.int16)[counts.argmax(axis=0)]
