"""Shadow and sun on the chart: what the ground would look like in full sun, and where the sun does not reach it.

The light of a texel is taken as that of its lateral offset in full sun, times a ratio where it lies in shadow: an intrinsic
decomposition in linear light with two states of illumination (Barrow and Tenenbaum, *Recovering intrinsic scene characteristics
from images*, 1978).
Which texels lie in shadow is read from the picture; the shadows that the scene casts say which object each belongs to, and what
the light is like where nobody saw the ground.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.mechanisms import on
from unveil_core.base.srgb import light_certainty, linear_light, srgb_of_linear
from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import disc, luminance, masked_blur
from unveil_core.inpaint.light.sun import Sun

__all__ = ["CONTACT_M", "Light", "Profile", "Shade", "read_shade", "shade_where_unseen"]

Profile = Callable[[Float32, Mask], Float32]
"""From a plane (A, B, 3) and the texels that count, the median of their lateral offset (A, B, 3)."""

DARKEST = 1 / 7
"""Least share of the light that remains in shadow: of that on the ground a clear sky gives a seventh and more."""
BRIGHTEST = 0.8
"""Greatest share of the light that remains in shadow: above it, 0.9 of an sRGB code, a shadow is not seen."""
USUAL = 0.2
"""Share of the light that remains in shadow where nothing tells: half of an sRGB code."""
LEAST_LIGHT = 0.0008
"""Light that less counts as in a logarithm: two and a half levels of 255, where a few texels are averaged."""
ROUNDS = 3
"""Times that ratio, colours in the sun and shadows are found in turn. Chosen on the two sample streets."""
SMOOTH_M = 0.06
"""Blur of colours before they are compared, metres: the grain of asphalt, not the width of a line."""
PENUMBRA_M = 0.15
"""Distance from a shadow's border within which the ratio is not read, metres."""
SPECK_M = 0.12
"""Radius of dark specks that are no shadows, metres: paint that strays a few centimetres from its offset leaves thin dark
lines."""
LEAST_TEXELS = 20
"""Texels that an offset must show in the sun and in shadow, each, for its ratio to count."""
CONTACT_M = 0.5
"""Width of the ground around an object that it darkens wherever the sun stands (contact shadow), metres. Chosen on the two sample
streets."""
SHIFT_M, SHIFT_STEP_M, WINDOW_M = 0.9, 0.15, 1.2
"""How far a cast shadow may be moved to agree with what is seen, in which steps, and standard deviation of the surroundings that
decide, metres: a direction wrong by 5 degrees moves the shadow of a roof 10 m up by 0.9 m. Chosen on the two sample streets."""
SHIFT_COST = 0.02
"""Share of the surroundings that a full shift must set right to be made. Chosen on the two sample streets."""
SEEN_SHARE, SHADED_SHARE = 0.05, 0.2
"""Of a cast shadow, the share that must be seen for it to be judged, and the share of that in shade below which it is not there: a
few surfels that float where an object went cast a shadow, too. Charts of 26 drawn streets, of earlier states of the scene, gain
0.1 dB on the mean, 34 and 35 0.7 and 0.4, 45 and 53 lose 0.2; five other pairs are no better. Whole runs of four differ by
less than 0.1 dB. Dark blobs on a real road without labels go."""
FAR_M, NEAR_M = (8.0, 0.5), (2.0, 0.5)
"""Standard deviations along s and t within which observed shade corrects the shade that the scene casts, first and then, metres.
The shade of a row of houses ends along the street: where its border is seen beside a lorry, it also lies behind it, though the sun
or a house that the images cut off is wrong. The second is chosen on the two sample streets, the first on fourteen drawn ones."""
FAR_PRIOR, PRIOR = 0.06, 0.12
"""Weights of the cast shade in these corrections, as the share of the surroundings that is observed against it: many texels
together overrule it, a few in a gap between two cars do not. The second is chosen on the two sample streets, the first as above."""


@dataclass(frozen=True, eq=False)
class Light:
    """The shadows that the scene casts on the chart.

    Attributes:
        sun: where the sun stands.
        kept, gone: (A, B) bool, texels in the shadow of what stays, and of what is removed.
    """

    sun: Sun
    kept: Mask
    gone: Mask


@dataclass(frozen=True, eq=False)
class Shade:
    """Which texels of the chart lie in shadow, and how much light is left there.

    Attributes:
        dark: (A, B) bool, seen texels in shadow.
        ratio: (3,) or (A, B, 3) linear light in shadow by that in the sun.
        lit: (A, B, 3) median linear light of the lateral offset in full sun.
    """

    dark: Mask
    ratio: Float32
    lit: Float32


def read_shade(
    color: Float32,
    seen: Mask,
    expected: Mask,
    profile: Profile,
    *,
    texels_per_m: float,
    start: Mask | None = None,
    belief: float = 0.2,
) -> Shade:
    """Separate shadow from sun in what was seen.

    A first guess of what is dark gives the ratio at the offsets that have both, the ratio gives the colours in full sun, and
    against these every texel shows its own state; and again.

    Args:
        color: (A, B, 3) of the chart; seen: (A, B).
        expected: (A, B) texels that the scene casts shadow on.
        profile: see :data:`Profile`.
        start: (A, B) first guess; None = what is expected.
        belief: how far that moves the border between light and dark, as a share of the fall between them.
    """
    light = linear_light(color)
    smooth = linear_light(masked_blur(color, seen, SMOOTH_M * texels_per_m))
    log = np.log(np.maximum(luminance(smooth), LEAST_LIGHT))
    dark = (expected if start is None else start) & seen
    ratio = np.full(3, USUAL, dtype=np.float32)
    lit = light
    for _ in range(ROUNDS):
        ratio = _ratio(smooth, seen, dark, ratio, border=max(1, round(PENUMBRA_M * texels_per_m)))
        lit = profile(np.where(dark[..., None], light / ratio, light).astype(np.float32), seen)
        fall = float(np.log(luminance(ratio)))
        # Half way down is the border, but for what the scene says.
        threshold = np.where(expected, 0.5 - belief, 0.5 + belief) * fall
        darker = log - np.log(np.maximum(luminance(lit), LEAST_LIGHT))
        dark = seen & (darker < threshold)
        opened = cv2.morphologyEx((dark | ~seen).astype(np.uint8), cv2.MORPH_OPEN, disc(SPECK_M * texels_per_m))
        dark = opened.astype(bool) & seen
    return Shade(dark, ratio, lit)


def _ratio(smooth: Float32, seen: Mask, dark: Mask, before: Float32, *, border: int) -> Float32:
    """(3,) median over lateral offsets of dark by lit, away from the shadows' borders, each weighing as its texels and codes tell;
    ``before`` where no offset has both."""
    kernel = disc(border)
    inner = seen & dark & (cv2.erode((dark | ~seen).astype(np.uint8), kernel) > 0)
    outer = seen & ~dark & (cv2.dilate(dark.astype(np.uint8), kernel) == 0)
    both = np.flatnonzero((inner.sum(axis=0) >= LEAST_TEXELS) & (outer.sum(axis=0) >= LEAST_TEXELS))
    if not len(both):
        return before
    sides = np.stack([[np.median(smooth[side[:, c], c], axis=0) for c in both] for side in (inner, outer)])
    count = np.minimum(inner[:, both].sum(axis=0), outer[:, both].sum(axis=0))
    weight = count * light_certainty(srgb_of_linear(sides)).min(axis=(0, 2))
    if not weight.any():
        return before
    quotients = sides[0] / np.maximum(sides[1], 1e-6)
    order = np.argsort(quotients, axis=0)
    passed = np.cumsum(weight[order], axis=0) >= 0.5 * weight.sum()
    middle = order[passed.argmax(axis=0), np.arange(3)]
    ratio = quotients[middle, np.arange(3)].astype(np.float32)
    # What is darker lies right beside an object, which hides the sky as well; its colour is that of the shade all the same.
    least = DARKEST / max(float(luminance(ratio)), 1e-3)
    return np.clip(ratio * max(1.0, least), 0.1 * DARKEST, BRIGHTEST).astype(np.float32)


def shade_where_unseen(light: Light, sound: Mask, dark: Mask, *, texels_per_m: float) -> Float32:
    """(A, B) 0 to 1, how much of the sun's light is missing when what is removed is gone.

    The shadows of what stays, but for those of which only sunny ground is seen, moved to where they are seen to lie and corrected
    by what was seen close by: a roof that no camera saw casts its shadow all the same.

    Args:
        sound: (A, B) texels that show the ground as it will be; dark: (A, B) of them, in shadow.
    """
    kept = light.kept & ~_refuted(light.kept, sound, dark) if on("refuted_shade") else light.kept
    share = _moved(kept.astype(np.uint8), sound, dark, texels_per_m)
    share = np.clip(share + _correction(share, sound, dark, FAR_M, FAR_PRIOR, texels_per_m), 0, 1)
    correction = _correction(share, sound, dark, NEAR_M, PRIOR, texels_per_m)
    soft: Float32 = np.clip((share + correction - 0.5) * 2.0 + 0.5, 0, 1).astype(np.float32)
    return soft


def _refuted(cast: Mask, sound: Mask, dark: Mask) -> Mask:
    """(A, B) shadows among those ``cast`` (A, B) of which what is seen lies in the sun: what casts them is not there, or not so."""
    count, part = cv2.connectedComponents(cast.astype(np.uint8), connectivity=8)
    size, seen, shaded = (np.bincount(part[where], minlength=count) for where in (cast, cast & sound, cast & dark))
    wrong = (seen > SEEN_SHARE * size) & (shaded < SHADED_SHARE * seen)
    return np.asarray(wrong[part])


def _correction(
    share: Float32, sound: Mask, dark: Mask, reach_m: tuple[float, float], prior: float, texels_per_m: float
) -> Float32:
    """(A, B) what must be added to a ``share`` of shade for what was seen around.

    Args:
        reach_m: standard deviations of the surroundings along s and t, metres; prior: weight of the share.
    """
    if not on("corrected_shade"):
        return np.zeros_like(share)
    missed = np.where(sound, dark.astype(np.float32) - (share > 0.5), 0).astype(np.float32)
    # A border's misplacement is no news: what is missed must be broad.
    broad = masked_blur(missed, sound, 0.2 * texels_per_m)
    missed[np.abs(broad) < 0.5] = 0
    along, across = (m * texels_per_m for m in reach_m)
    return np.asarray(1.3 * masked_blur(missed, sound, (along, across), prior=prior))


def _moved(kept: NDArray[np.uint8], sound: Mask, dark: Mask, texels_per_m: float) -> Float32:
    """``kept`` (A, B), its borders soft, each part moved by up to ``SHIFT_M`` to where it agrees best with ``dark`` among the
    ``sound`` texels around: trees are seen from one side only, and the sun is known to a few degrees."""
    factor = max(1, round(SHIFT_STEP_M * texels_per_m))
    rows, columns = kept.shape
    size = (-(-columns // factor), -(-rows // factor))

    def coarse(plane: NDArray[Any]) -> Float32:
        return cv2.resize(plane.astype(np.float32), size, interpolation=cv2.INTER_AREA)  # type: ignore[return-value]

    cast, weight = coarse(kept), coarse(sound)
    seen = coarse(sound & dark) / np.maximum(weight, 1e-6)
    weight[weight < 0.3] = 0
    sigma = WINDOW_M * texels_per_m / factor
    reach = round(SHIFT_M / SHIFT_STEP_M) if on("moved_shade") else 0
    best = np.full(cast.shape, -np.inf, dtype=np.float32)
    shift = np.zeros((*cast.shape, 2), dtype=np.float32)
    steps = [(i, j) for i in range(-reach, reach + 1) for j in range(-reach, reach + 1)]
    for i, j in sorted(steps, key=lambda step: step[0] ** 2 + step[1] ** 2):
        moved = cv2.warpAffine(
            cast, np.array([[1, 0, j], [0, 1, i]], dtype=np.float32), size, borderMode=cv2.BORDER_REPLICATE
        )
        wrong = cv2.GaussianBlur(weight * np.abs(moved - seen), (0, 0), sigma)
        score = -wrong - SHIFT_COST * (i * i + j * j) / max(reach, 1) ** 2
        better = score > best + 1e-6
        best[better] = score[better]
        shift[better] = (i, j)
    known = cv2.GaussianBlur(weight, (0, 0), sigma) + 1e-3
    shift = cv2.GaussianBlur(shift * known[..., None], (0, 0), sigma / 2)
    shift /= cv2.GaussianBlur(known, (0, 0), sigma / 2)[..., None]
    shift = cv2.resize(shift, (columns, rows)) * factor
    soft = cv2.GaussianBlur(kept.astype(np.float32), (0, 0), 0.05 * texels_per_m)
    result = np.empty_like(soft)
    across = np.arange(columns, dtype=np.float32)
    # Charts may be longer than remap's limit.
    for start in range(0, rows, 8192):
        part = np.s_[max(0, start - 512) : start + 8192 + 512]
        picture = soft[part]
        along = np.arange(start, min(rows, start + 8192), dtype=np.float32)
        moved_by = shift[start : start + 8192]
        result[start : start + 8192] = cv2.remap(
            picture,
            across[None] - moved_by[..., 1],
            along[:, None] - part.start - moved_by[..., 0],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
    return result
