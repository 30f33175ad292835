"""Relighting: takes the shadows of removed objects away from ground that was seen.

Their ratios are of linear light, but means are of codes, as the ground is carried on: a shadow takes the same share of both, and
of bright and dark stones the mean of their light is no light that a mean of codes has.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from unveil_core.base.mechanisms import on
from unveil_core.base.srgb import UNCLIPPED, light_certainty, linear_light, log_slope, srgb_of_linear
from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import blurred, blurred_over, disc, grow, luminance, masked_blur, within
from unveil_core.inpaint.chart.lateral_profile import lateral_profile
from unveil_core.inpaint.chart.planted import MOVED_M
from unveil_core.inpaint.light.darkness import LEAST_LIGHT
from unveil_core.inpaint.light.shade import Light, Shade

__all__ = [
    "object_shadows",
    "prevailing_shade",
    "relighting_gain",
    "shadows_of_removed",
    "sky_gain",
    "still_dark",
    "under_an_even_sky",
]

SHADOW_RATIO = 0.65
"""Without a known sun: light of a texel, as a share of its offset's lit level, below which it lies in shadow. Chosen on the two
sample streets."""
MOST_NOISE = 3.3
"""Factor of a texel's noise, in codes, beyond which a shadow is not relit but invented: it holds no texture any more."""
STRIP_M, REACH_M = 20.0, 3.0
"""Length of the strips that are relit one after the other, metres, and how far a texel's gain looks: two blurs with 1 m around it
and what they are masked by, half a metre each."""
PENUMBRA_M = 0.2
"""Width on either side of a shadow's border within which sun and shade may be mixed, metres. The sun is half a degree wide: a
roof 20 m away along the light has a penumbra of 0.2 m."""
BORDER_WEIGHT = 0.02
"""Weight of the border of a shadow, its inside weighing 1, where the light in it is measured: it counts only where a shadow has no
inside."""
TOUCH_M = 0.4
"""Distance from an object within which a dark patch must come for its shadow, and within which darkness is contact darkening,
metres. Chosen on the two sample streets."""
UNEXPLAINED_M = 0.6
"""Distance from the cast shadows of what stays from which on they do not explain dark ground, metres: what a sun wrong by 3 degrees
moves the shadow of a roof 10 m up by."""
DEEPER = 0.39
"""Light of ground beside a removed object, as a share of that in shade, below which the object darkens it in the shade, too."""
CLEAR_M = 0.8
"""Distance from a removed object from which on what is seen tells how light it is there without the object, metres."""
MOST_OF_AGE = 2.4
"""Gain beyond which a dark patch is a shadow that some sun made: asphalt of two ages differs by 1.5 in sRGB at the most."""
MOST_GAIN = 50.0
"""Gain of a channel beyond which noise is made brighter. What holds a texture has a fourteenth of its light and more, and in the
light of the sky alone a quarter of that in red: with 20, asphalt beside a lorry came out teal."""
AROUND_M, LEAST_AROUND_M2, AS_LIGHT = 0.6, 0.03, 0.7
"""Width of what is seen around a dark patch that it is compared with, metres; the least area of that, square metres; and the share
of its light from which on the patch is no shadow of an object. Charts of eight streets without a sun that is known: 67 16.1 to 18.5
dB, 47 and 49 0.4 and 0.5 more, 0 0.1 less, the others the same; with 0.61 the same but 49 0.3 more, with 0.79 67 1.4 less."""
MIXED_M, BRIGHT = 0.3, 0.85
"""Distance from what nobody saw within which a texel mixes the ground with the object that hid it, metres: a pixel at 15 m; and the
share of its lit level below which it still does when it is relit. Cast shadows of eight streets: 0.6 dB more on 72 and on a sample
street, 0.3 on 50, -0.3 on a sample street without labels, the others the same; dark strokes where cars stood are gone."""
BIN_M, EVIDENT = 0.2, 0.5
"""Width of the rings around footprints that are compared, metres, and the share of what is dark around removed objects, up to
which planted ones may have the same around them, for it to be the objects' doing: with half, every second texel would be."""
ENDS = 0.5
"""Share of a dark place that must lie where shadows of removed objects may: of the shade of a tree or a house most lies
elsewhere."""
OBJECT_M = 1.5
"""Height of a removed object that an even sky is hidden by, metres: a car's."""
BESIDE = (-0.4, 0.5)
"""By which share ground beside a shadow's border is darker or brighter than it should be, at most."""
LEAST_BESIDE = 0.02
"""Share of what is around that tells it, at which half of it is believed."""
SMOOTH_M, SPECK_M = 0.06, 0.12
"""Blur of light before it is compared, and the radius of dark specks and lit gaps that do not count, metres: painted lines stray by
a few centimetres from their offset."""


def prevailing_shade(color: Float32, seen: Mask, footprint: Mask, *, window: int, hop: int, per_m: float) -> Shade:
    """Shade without a known sun: dark is what is darker than its lateral offset mostly is, and its ratio is 1, because nothing says
    which shadows stay.

    Args:
        color: (A, B, 3) of the chart; seen: (A, B).
        footprint: (A, B) texels under removed objects: under a lorry all of an offset is dark for longer than the window.
        window, hop: of the lateral profile, texels; per_m: texels per metre.
    """
    clear = seen & ~grow(footprint, CLEAR_M * per_m)
    median, level = lateral_profile(linear_light(color), clear, window=window, hop=hop)
    smooth = _smooth(color, seen, SMOOTH_M * per_m)
    dark = seen & (smooth < SHADOW_RATIO * level)
    # Paint that strays a few centimetres from its offset leaves thin dark lines, which are no shadows.
    opened = cv2.morphologyEx((dark | ~seen).astype(np.uint8), cv2.MORPH_OPEN, disc(SPECK_M * per_m))
    scaled = median * (level / np.maximum(luminance(median), LEAST_LIGHT))[..., None]
    ones = np.ones(3, dtype=np.float32)
    return Shade(opened.astype(bool) & seen, ones, scaled.astype(np.float32))


def evident_reach(dark: Mask, seen: Mask, footprint: Mask, most_m: float, per_m: float) -> float:
    """How far from removed objects their shadows are in evidence, metres: as far as it is darker around them than around the same
    footprints planted where nothing stood, on the drive's own ground. 0 where it is nowhere so.

    Args:
        dark: (A, B) of the ``seen`` texels (A, B), those that are darker than their kind is.
        footprint: (A, B) texels under removed objects; most_m: no farther, metres; per_m: texels per metre.
    """
    if not footprint.any():
        return 0.0
    if not on("evident_reach"):
        return most_m
    bins = int(most_m / BIN_M)
    step = max(1, int(BIN_M * per_m / 2))
    dark, seen, footprint = (m[::step, ::step] for m in (dark, seen, footprint))
    per_m /= step

    def shares(stood: Mask, known: Mask) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        away = cv2.distanceTransform((~stood).astype(np.uint8), cv2.DIST_L2, 5)
        ring = (away / (BIN_M * per_m)).astype(np.int64)
        known = known & ~stood & (ring < bins)
        return np.bincount(ring[known & dark], minlength=bins), np.bincount(ring[known], minlength=bins)

    unaffected = seen & ~within(footprint, most_m * per_m)
    found = shares(footprint, seen)
    planted = np.zeros((2, bins), dtype=np.int64)
    for along, across in MOVED_M:
        moved = np.array([[1, 0, across * per_m], [0, 1, along * per_m]], dtype=np.float32)
        stood = cv2.warpAffine(footprint.astype(np.uint8), moved, footprint.shape[::-1], flags=cv2.INTER_NEAREST) > 0
        if stood.any():
            planted += shares(stood, unaffected)
    real, false = (d / np.maximum(k, 1) for d, k in (found, planted))
    evident = (real * EVIDENT > false) & (planted[1] > LEAST_AROUND_M2 * per_m**2)
    return BIN_M * float(bins if evident.all() else evident.argmin())


def object_shadows(
    dark: Mask, zone: Mask, touched: Mask, explained: Mask, level: Float32, seen: Mask, *, per_m: float
) -> Mask:
    """(A, B) texels in the shadow of removed objects: dark places in the ``zone`` (A, B) that their shadows may reach, as far as it
    is seen that they end there. What goes on beyond it, or has no brighter ground around it, was dark without the objects.

    Args:
        dark: (A, B) seen texels that are darker than their kind is; touched: (A, B) where such a place must come.
        explained: (A, B) texels that something which stays keeps dark: there shadows run into one another.
        level: (A, B) light as a share of its lateral offset's; seen: (A, B) ground beside objects.
    """
    _, place = cv2.connectedComponents((dark & (zone | ~explained)).astype(np.uint8), connectivity=8)
    inside, size = (np.bincount(place[m], minlength=place.max() + 1) for m in (zone, np.ones_like(zone)))
    ended = (inside > ENDS * size)[place] & dark & zone
    _, patch = cv2.connectedComponents(ended.astype(np.uint8), connectivity=8)
    own: Mask = np.isin(patch, np.unique(patch[ended & touched])) & ended
    return own & _darker_than_beside(own, level, seen & ~explained, per_m) if on("ended_shadows") else own


def shadows_of_removed(
    color: Float32,
    seen: Mask,
    shade: Shade,
    footprint: Mask,
    light: Light | None,
    *,
    reach_m: float,
    per_m: float,
) -> tuple[Mask, Mask]:
    """Seen texels (A, B) in the shadow of removed objects, and those that are too dark or too near to them to be relit.

    Args:
        color: (A, B, 3) of the chart; seen: (A, B); shade: of what was seen.
        footprint: (A, B) texels under or inside removed objects.
        light: the shadows that the scene casts, None where that is not known.
        reach_m: how far from its object a shadow may lie where the light is not known, metres; 0 = shadows stay.
        per_m: texels per metre.
    """
    if reach_m <= 0:
        return np.zeros_like(seen), np.zeros_like(seen)
    lit = np.maximum(luminance(shade.lit), LEAST_LIGHT)
    smooth = _smooth(color, seen, SMOOTH_M * per_m)
    level = (smooth / lit).astype(np.float32)
    beside, nothing = seen & ~footprint, np.zeros_like(seen)
    touch = within(footprint, TOUCH_M * per_m)

    def around(dark: Mask, explained: Mask, most_m: float, level: Float32) -> Mask:
        """What they darken wherever the sun stands, and under an even sky."""
        zone = within(footprint, evident_reach(dark, seen & ~explained, footprint, most_m, per_m) * per_m)
        return object_shadows(dark, zone & ~explained, touch, explained, level, beside, per_m=per_m)

    if light is None:
        shadow = around(shade.dark, nothing, reach_m, level)
    else:
        # A dark texel belongs to the nearer of the two shadows; contact darkening is in neither.
        blur = 0.2 * per_m
        gone, kept = (cv2.GaussianBlur(m.astype(np.float32), (0, 0), blur) for m in (light.gone, light.kept))
        explained = grow(light.kept, UNEXPLAINED_M * per_m)
        theirs = ((gone > 0.05) & (gone > kept)) | (touch & (kept < 0.3))
        shadow = object_shadows(shade.dark, theirs, theirs, explained, level, beside, per_m=per_m)
        # In the shade of a house, too, it is darker right beside an object.
        in_shade = (smooth / np.maximum(luminance(shade.lit * shade.ratio), LEAST_LIGHT)).astype(np.float32)
        shadow = shadow | around(seen & (in_shade < DEEPER), nothing, reach_m, in_shade)
    # What is nearly black has nothing to relight; under a lorry, whose floor is high, there are lines to be seen.
    shadow = shadow | (footprint & shade.dark)
    noise = log_slope(srgb_of_linear(smooth)) / log_slope(srgb_of_linear(lit))
    hopeless = seen & shadow & (noise > MOST_NOISE)
    hopeless = cv2.morphologyEx(hopeless.astype(np.uint8), cv2.MORPH_CLOSE, disc(SPECK_M * per_m)).astype(bool) & seen
    # Its border is mixed with it.
    hopeless |= grow(hopeless, SPECK_M * per_m) & shadow & seen
    return shadow, hopeless


def _darker_than_beside(patches: Mask, level: Float32, seen: Mask, per_m: float) -> Mask:
    """(A, B) patches (A, B) that are darker than what is seen around them: in the shade of houses all is dark, and what is seen
    between two cars is darker than its lateral offset is where the sun shines. Of what has nothing around it nobody can say.

    Args:
        level: (A, B) light as a share of its lateral offset's; seen: (A, B) ground beside objects.
    """
    reach = round(AROUND_M * per_m)
    beside = seen & ~grow(patches, PENUMBRA_M * per_m)
    _, patch = cv2.connectedComponents(patches.astype(np.uint8), connectivity=8)
    darker = np.zeros_like(patches)
    for number, place in enumerate(ndimage.find_objects(patch), start=1):
        near = tuple(slice(max(0, p.start - reach), p.stop + reach) for p in place)
        own = patch[near] == number
        around = grow(own, reach) & beside[near]
        if around.sum() >= LEAST_AROUND_M2 * per_m**2:
            darker[near] |= own & (np.median(level[near][own]) < AS_LIGHT * np.median(level[near][around]))
    return darker


def _smooth(color: Float32, mask: Mask, sigma: float) -> Float32:
    """(A, B) luminance of the mean colour (A, B, 3) around, of the texels of a mask (A, B)."""
    return luminance(linear_light(masked_blur(color, mask, sigma)))


def _over(color: Float32, weight: Float32, sigma: float) -> Float32:
    """(A, B, 3) linear light of the mean colour (A, B, 3) around, by the weights (A, B) of texels."""
    return linear_light(blurred_over(color * weight[..., None], blurred(weight, sigma), sigma))


def under_an_even_sky(gain: Float32, shadow: Mask, footprint: Mask, per_m: float) -> Float32:
    """The gain (A, B, 3) of the shadows (A, B), no more than what an even sky gives back, except where a shadow is so dark that
    some sun must have made it: asphalt of another age beside an object is darker, too, but all the way.

    Args:
        footprint: (A, B) texels under or inside removed objects; per_m: texels per metre.
    """
    count, patch = cv2.connectedComponents(shadow.astype(np.uint8), connectivity=8)
    sunny = np.asarray(ndimage.median(luminance(gain), patch, np.arange(count))) > MOST_OF_AGE
    of_sun = grow(sunny[patch] & shadow, PENUMBRA_M * per_m)
    limited: Float32 = np.where(of_sun[..., None], gain, np.minimum(gain, sky_gain(footprint, per_m)[..., None]))
    return limited


def sky_gain(footprint: Mask, per_m: float) -> Float32:
    """(A, B) most by which ground can get lighter when a removed object no longer hides the sky from it; inf under the object.

    An even sky loses the share (1 - d / sqrt(d^2 + h^2)) / 2 of its light at a distance d from a long wall of height h, the view
    factor of the wall; of a shorter thing less.

    Args:
        footprint: (A, B) texels under or inside removed objects; per_m: texels per metre.
    """
    distance = cv2.distanceTransform((~footprint).astype(np.uint8), cv2.DIST_L2, 5) / per_m
    lost = 0.5 * (1 - distance / np.hypot(distance, OBJECT_M))
    gain: Float32 = np.where(footprint, np.inf, 1 / (1 - lost)).astype(np.float32)
    return gain


def still_dark(relit: Float32, target: Float32, inside: Mask, hole: Mask, *, per_m: float) -> Mask:
    """(A, B) texels beside what nobody saw that are darker than the street when they are relit: they show some of the object's
    underside, which no light brings out.

    Args:
        relit, target: (A, B, 3) as relit, and as it should be.
        inside: (A, B) what was relit; hole: (A, B) what nobody saw.
    """
    level, wanted = (_smooth(picture, inside, SMOOTH_M * per_m) for picture in (relit, target))
    dark = inside & grow(hole, MIXED_M * per_m) & (level < BRIGHT * wanted)
    mixed: Mask = grow(dark, SMOOTH_M * per_m) & inside
    return mixed


def levelled_border(shadow: Mask, per_m: float) -> Mask:
    """(A, B) the border of a shadow (A, B) that is taken away, within which every texel becomes as bright as its lateral offset,
    whatever is painted there; per_m: texels per metre."""
    if not on("levelled_border"):
        return np.zeros_like(shadow)
    border: Mask = cv2.morphologyEx(shadow.astype(np.uint8), cv2.MORPH_GRADIENT, disc(PENUMBRA_M * per_m)) > 0
    return border


def relighting_gain(
    color: Float32, target: Float32, seen: Mask, shadow: Mask, wide: Mask, relit: Mask, *, per_m: float
) -> Float32:
    """(A, B, 3) factor of linear light that takes ``shadow`` away: what the street should be by what it is, both smooth.

    Made in strips across the street, for a dozen planes of its size are needed on the way.

    Args:
        color, target: (A, B, 3) as seen, and as it should be.
        seen: (A, B); shadow: (A, B) that goes; wide: (A, B) with its penumbra; relit: (A, B) of it, seen and kept.
        per_m: texels per metre.
    """
    gain = np.ones_like(color)
    rows, strip, around = len(color), int(STRIP_M * per_m), int(np.ceil(REACH_M * per_m))
    for first in range(0, rows, strip):
        end = min(first + strip, rows)
        near = slice(max(first - around, 0), end + around)
        if shadow[near].any() or wide[near].any():
            planes = (plane[near] for plane in (color, target, seen, shadow, wide, relit))
            part = _gain_of_strip(*planes, per_m=per_m)  # type: ignore[arg-type]
            gain[first:end] = part[first - near.start :][: end - first]
    return gain


def _gain_of_strip(
    color: Float32, target: Float32, seen: Mask, shadow: Mask, wide: Mask, relit: Mask, *, per_m: float
) -> Float32:
    """:func:`relighting_gain` of some rows; right where ``REACH_M`` of rows lie around."""
    soft = cv2.GaussianBlur(wide.astype(np.float32), (0, 0), 0.03 * per_m)
    ring = disc(PENUMBRA_M * per_m)
    # The light that remains is measured inside the shadow; its border counts where there is no inside.
    inside = relit & cv2.erode((shadow | ~seen).astype(np.uint8), ring).astype(bool)
    # Noise by what is around: if dark stones weighed less than bright ones beside them, their mean would be brighter.
    around = masked_blur(color, seen, 0.25 * per_m)
    certain = light_certainty(np.where(color > UNCLIPPED, color, around)).min(axis=2)
    told = relit * np.where(inside, 1.0, BORDER_WEIGHT).astype(np.float32) * certain
    local, wanted = (_over(picture, told, 0.25 * per_m) for picture in (color, target))
    ratio = np.clip(wanted / np.maximum(local, 1e-6), 1.0, MOST_GAIN)
    full = np.where(soft[..., None] > 0.01, 1 + (ratio - 1) * soft[..., None], 1.0)
    # Along the border lies penumbra, in no fixed width: there each texel gets the share of it that makes it as bright as the
    # street is.
    around = cv2.dilate(shadow.astype(np.uint8), ring) > 0
    # As bright as right beside it, for the street is not the same all along: a difference of a few per cent is an outline.
    told = (seen & ~around) * certain
    is_there, should_be = (luminance(_over(picture, told, 0.25 * per_m)) for picture in (color, target))
    known = blurred(told, 0.25 * per_m)
    beside = known / (known + LEAST_BESIDE) * (is_there / np.maximum(should_be, LEAST_LIGHT) - 1)
    actual = np.maximum(linear_light(masked_blur(color, seen, 0.03 * per_m)), LEAST_LIGHT)
    # Each channel for itself: in a penumbra the sun's colour and the sky's mix.
    share = (linear_light(target) * (1 + np.clip(beside, *BESIDE))[..., None] / actual - 1) / np.maximum(
        ratio - 1, 0.02
    )
    mixed = 1 + (ratio - 1) * np.clip(share, 0, 1)
    border = levelled_border(shadow, per_m)
    inner = cv2.GaussianBlur(border.astype(np.float32), (0, 0), 0.03 * per_m)[..., None]
    gain: Float32 = (full * (1 - inner) + mixed * inner).astype(np.float32)
    return gain
