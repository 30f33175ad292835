"""Relighting: takes the shadows of removed objects away from ground that was seen."""

from __future__ import annotations

import cv2
import numpy as np
from scipy import ndimage

from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import disc, grow, luminance, masked_blur
from unveil_core.inpaint.chart.lateral_profile import lateral_profile
from unveil_core.inpaint.light.shade import Light, Shade

__all__ = [
    "levelled_border",
    "object_shadows",
    "prevailing_shade",
    "relighting_gain",
    "shadows_of_removed",
    "sky_gain",
    "still_dark",
    "under_an_even_sky",
]

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
DEEPER = 0.65
"""Luma of ground beside a removed object, as a share of that in shade, below which the object darkens it in the shade, too."""
CLEAR_M = 0.8
"""Distance from a removed object from which on what is seen tells how light it is there without the object, metres."""
MOST_OF_AGE = 1.5
"""Gain beyond which a dark patch is a shadow that some sun made: asphalt of two ages differs by a third at the most."""
MOST_GAIN = 6.0
"""Gain of a channel beyond which noise is made brighter. What holds a texture has 0.3 of its luma and more, and in the light of the
sky alone half of that in red: with 4, asphalt beside a lorry came out teal."""
AROUND_M, LEAST_AROUND_M2, AS_LIGHT = 0.6, 0.03, 0.85
"""Width of what is seen around a dark patch that it is compared with, metres; the least area of that, square metres; and the share
of its luma from which on the patch is no shadow of an object. Charts of eight streets without a sun that is known: 67 16.1 to 18.5
dB, 47 and 49 0.4 and 0.5 more, 0 0.1 less, the others the same; with 0.8 the same to 0.1 but 49 0.3 more, with 0.9 67 1.4 less."""
MIXED_M, BRIGHT = 0.3, 0.93
"""Distance from what nobody saw within which a texel mixes the ground with the object that hid it, metres: a pixel at 15 m; and the
share of its lit level below which it still does when it is relit. Cast shadows of eight streets: 0.6 dB more on 72 and on a sample
street, 0.3 on 50, -0.3 on a sample street without labels, the others the same; dark strokes where cars stood are gone."""
OBJECT_M = 1.5
"""Height of a removed object that an even sky is hidden by, metres: a car's."""
SMOOTH_M, SPECK_M = 0.06, 0.12
"""Blur of luma before it is compared, and the radius of dark specks and lit gaps that do not count, metres: painted lines stray by
a few centimetres from their offset."""


def prevailing_shade(
    color: Float32, seen: Mask, footprint: Mask, *, shadow_ratio: float, window: int, hop: int, per_m: float
) -> Shade:
    """Shade without a known sun: dark is what is darker than its lateral offset mostly is, and its ratio is 1, because nothing says
    which shadows stay.

    Args:
        color: (A, B, 3) of the chart; seen: (A, B).
        footprint: (A, B) texels under removed objects: under a lorry all of an offset is dark for longer than the window.
        shadow_ratio: a texel darker than this share of its offset's lit level is dark.
        window, hop: of the lateral profile, texels; per_m: texels per metre.
    """
    clear = seen & ~grow(footprint, CLEAR_M * per_m)
    median, level = lateral_profile(color, clear, window=window, hop=hop)
    smooth = masked_blur(luminance(color), seen, SMOOTH_M * per_m)
    dark = seen & (smooth < shadow_ratio * level)
    # Paint that strays a few centimetres from its offset leaves thin dark lines, which are no shadows.
    opened = cv2.morphologyEx((dark | ~seen).astype(np.uint8), cv2.MORPH_OPEN, disc(SPECK_M * per_m))
    scaled = median * (level / np.maximum(luminance(median), 0.02))[..., None]
    return Shade(opened.astype(bool) & seen, np.ones(3, dtype=np.float32), scaled.astype(np.float32))


def object_shadows(dark: Mask, footprint: Mask, *, reach: int, touch: int) -> Mask:
    """Dark texels (A, B) that are connected with a removed object's footprint and lie within ``reach`` texels of it."""
    if not footprint.any():
        return np.zeros_like(dark)
    distance = cv2.distanceTransform((~footprint).astype(np.uint8), cv2.DIST_L2, 5)
    candidate = dark & (distance <= reach)
    count, component = cv2.connectedComponents((candidate | footprint).astype(np.uint8), connectivity=8)
    touching = np.zeros(count, dtype=bool)
    touching[np.unique(component[candidate & (distance <= touch)])] = True
    touching[0] = False
    return touching[component] & candidate


def shadows_of_removed(
    color: Float32,
    seen: Mask,
    shade: Shade,
    footprint: Mask,
    light: Light | None,
    *,
    reach_m: float,
    black_ratio: float,
    per_m: float,
) -> tuple[Mask, Mask]:
    """Seen texels (A, B) in the shadow of removed objects, and those that are too dark or too near to them to be relit.

    Args:
        color: (A, B, 3) of the chart; seen: (A, B); shade: of what was seen.
        footprint: (A, B) texels under or inside removed objects.
        light: the shadows that the scene casts, None where that is not known.
        reach_m: how far from its object a shadow may lie where the light is not known, metres; 0 = shadows stay.
        black_ratio: a shadowed texel darker than this share of its lit level holds no texture to relight.
        per_m: texels per metre.
    """
    if reach_m <= 0:
        return np.zeros_like(seen), np.zeros_like(seen)
    touch, luma = int(TOUCH_M * per_m), luminance(color)
    near = object_shadows(shade.dark, footprint, reach=int(reach_m * per_m), touch=touch)
    if light is None:
        shadow = near & ~_as_light_as_beside(near, luma, seen & ~footprint, per_m)
    else:
        # A dark texel belongs to the nearer of the two shadows; contact darkening is in neither.
        blur = 0.2 * per_m
        gone, kept = (cv2.GaussianBlur(m.astype(np.float32), (0, 0), blur) for m in (light.gone, light.kept))
        contact = near & grow(footprint, touch)
        theirs = ((gone > 0.05) & (gone > kept)) | (contact & (kept < 0.3))
        if light.beyond is not None:
            # A lorry that is never passed is longer than what was seen of it; what the scene explains stays.
            theirs |= light.beyond & ~grow(light.kept, UNEXPLAINED_M * per_m)
        shadow = shade.dark & theirs
    smooth = masked_blur(luma, seen, SMOOTH_M * per_m)
    if light is not None:
        # In the shade of a house, too, it is darker right beside an object.
        deep = seen & (smooth < DEEPER * luminance(shade.lit * shade.ratio))
        shadow = shadow | object_shadows(deep, footprint, reach=int(reach_m * per_m), touch=touch)
    # What is nearly black has nothing to relight; under a lorry, whose floor is high, there are lines to be seen.
    shadow = shadow | (footprint & shade.dark)
    hopeless = seen & shadow & (smooth < black_ratio * luminance(shade.lit))
    hopeless = cv2.morphologyEx(hopeless.astype(np.uint8), cv2.MORPH_CLOSE, disc(SPECK_M * per_m)).astype(bool) & seen
    # Its border is mixed with it.
    hopeless |= grow(hopeless, SPECK_M * per_m) & shadow & seen
    return shadow, hopeless


def _as_light_as_beside(patches: Mask, luma: Float32, seen: Mask, per_m: float) -> Mask:
    """(A, B) patches (A, B) that are about as light as what is seen around them: in the shade of houses all is dark, and what is
    seen between two cars is darker than its lateral offset is where the sun shines.

    Args:
        luma: (A, B) of the chart; seen: (A, B) ground beside objects.
    """
    reach = round(AROUND_M * per_m)
    beside = seen & ~grow(patches, PENUMBRA_M * per_m)
    _, patch = cv2.connectedComponents(patches.astype(np.uint8), connectivity=8)
    alike = np.zeros_like(patches)
    for number, place in enumerate(ndimage.find_objects(patch), start=1):
        near = tuple(slice(max(0, p.start - reach), p.stop + reach) for p in place)
        own = patch[near] == number
        around = grow(own, reach) & beside[near]
        if around.sum() >= LEAST_AROUND_M2 * per_m**2:
            alike[near] |= own & (np.median(luma[near][own]) > AS_LIGHT * np.median(luma[near][around]))
    return alike


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
    level, wanted = (masked_blur(luminance(picture), inside, SMOOTH_M * per_m) for picture in (relit, target))
    dark = inside & grow(hole, MIXED_M * per_m) & (level < BRIGHT * wanted)
    mixed: Mask = grow(dark, SMOOTH_M * per_m) & inside
    return mixed


def levelled_border(shadow: Mask, per_m: float) -> Mask:
    """(A, B) the border of a shadow (A, B) that is taken away, within which every texel becomes as bright as its lateral offset,
    whatever is painted there; per_m: texels per metre."""
    border: Mask = cv2.morphologyEx(shadow.astype(np.uint8), cv2.MORPH_GRADIENT, disc(PENUMBRA_M * per_m)) > 0
    return border


def relighting_gain(
    color: Float32,
    target: Float32,
    seen: Mask,
    shadow: Mask,
    wide: Mask,
    relit: Mask,
    paint: Mask | None = None,
    *,
    per_m: float,
) -> Float32:
    """(A, B, 3) factor that takes ``shadow`` away: what the street should be by what it is, both smooth.

    Made in strips across the street, for a dozen planes of its size are needed on the way.

    Args:
        color, target: (A, B, 3) as seen, and as it should be.
        seen: (A, B); shadow: (A, B) that goes; wide: (A, B) with its penumbra; relit: (A, B) of it, seen and kept.
        paint: (A, B) shaded texels that are brighter than the ground of their offset, as bars of a crossing are.
        per_m: texels per metre.
    """
    gain = np.ones_like(color)
    rows, strip, around = len(color), int(STRIP_M * per_m), int(np.ceil(REACH_M * per_m))
    for first in range(0, rows, strip):
        end = min(first + strip, rows)
        near = slice(max(first - around, 0), end + around)
        if shadow[near].any() or wide[near].any():
            part = _gain_of_strip(
                color[near],
                target[near],
                seen[near],
                shadow[near],
                wide[near],
                relit[near],
                None if paint is None else paint[near],
                per_m=per_m,
            )
            gain[first:end] = part[first - near.start :][: end - first]
    return gain


def _gain_of_strip(
    color: Float32,
    target: Float32,
    seen: Mask,
    shadow: Mask,
    wide: Mask,
    relit: Mask,
    paint: Mask | None,
    *,
    per_m: float,
) -> Float32:
    """:func:`relighting_gain` of some rows; right where ``REACH_M`` of rows lie around."""
    soft = cv2.GaussianBlur(wide.astype(np.float32), (0, 0), 0.03 * per_m)
    ring = disc(PENUMBRA_M * per_m)
    # Paint that is not on the offset's profile says nothing of the light; it gets what the ground beside it gets.
    unlike = np.zeros_like(relit) if paint is None else relit & grow(paint, SMOOTH_M * per_m)
    relit = relit & ~unlike
    # The light that remains is measured inside the shadow; its border counts where there is no inside.
    inside = relit & cv2.erode((shadow | ~seen).astype(np.uint8), ring).astype(bool)
    weight = np.where(inside, 1.0, BORDER_WEIGHT).astype(np.float32)[..., None]
    local = masked_blur(color * weight, relit, 0.25 * per_m)
    wanted = masked_blur(target * weight, relit, 0.25 * per_m)
    ratio = np.clip(wanted / np.maximum(local, 1e-6), 1.0, MOST_GAIN)
    full = np.where(soft[..., None] > 0.01, 1 + (ratio - 1) * soft[..., None], 1.0)
    # Along the border lies penumbra, in no fixed width: there each texel gets the share of it that makes it as bright as the
    # street is.
    around = cv2.dilate(shadow.astype(np.uint8), ring) > 0
    # As bright as right beside it, for the street is not the same all along: a difference of a few per cent is an outline.
    level = luminance(target)
    beside = masked_blur(luminance(color) / np.maximum(level, 0.02) - 1, seen & ~around, 0.25 * per_m, prior=0.02)  # type: ignore[arg-type]
    actual = np.maximum(masked_blur(color, seen, 0.03 * per_m), 0.02)
    # Each channel for itself: in a penumbra the sun's colour and the sky's mix.
    share = (target * (1 + np.clip(beside, -0.2, 0.2))[..., None] / actual - 1) / np.maximum(ratio - 1, 0.02)
    mixed = 1 + (ratio - 1) * np.clip(share, 0, 1)
    border = levelled_border(shadow, per_m)
    inner = cv2.GaussianBlur(border.astype(np.float32), (0, 0), 0.03 * per_m)[..., None]
    gain: Float32 = (full * (1 - inner) + mixed * inner).astype(np.float32)
    if unlike.any():
        gain[unlike] = masked_blur(gain, relit, 0.25 * per_m)[unlike]
    return gain
