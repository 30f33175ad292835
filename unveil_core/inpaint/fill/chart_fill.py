"""Filling the street chart: shadows of what went are taken away, and what nobody saw is invented.

The lateral median continues paint, kerb and walk; texture comes from places with the same lateral offset elsewhere along
the street, chosen patch by patch so that it meets what is already there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float32
from unveil_core.geometry.images import luminance, masked_blur
from unveil_core.inpaint.chart.lateral_profile import lateral_profile
from unveil_core.inpaint.chart.rectify import Drift, find_drift
from unveil_core.inpaint.chart.street_chart import INVENTED, OBSERVED, OUTSIDE, RELIT, StreetChart
from unveil_core.inpaint.fill.transverse_markings import continue_crossings
from unveil_core.inpaint.light.kerb_shade import shade_of_strips
from unveil_core.inpaint.light.relight import prevailing_shade, relighting_gain, shadows_of_removed
from unveil_core.inpaint.light.shade import CONTACT_M, Light, Profile, disc, read_shade, shade_where_unseen

__all__ = ["FillSettings", "fill_chart"]

FOOT_M = 0.3
"""How far from its sides the ground is not read for what its offset looks like; over twice as far it goes on as it is inside,
metres."""
SHARP_M = 10.0
"""From farther off the face of a kerb is no more than a pixel, metres."""
MARK = 0.06
"""What differs more from its lateral offset over a decimetre is a thing of its own."""


@dataclass(frozen=True)
class FillSettings:
    """How the chart is filled.

    Attributes:
        window_m: half length of the stretch whose median stands for a lateral offset, metres.
        shadow_ratio: a texel darker than this share of its offset's lit level lies in shadow.
        shadow_reach_m: a removed object's shadow reaches at most so far from it, metres; 0 = shadows stay.
        black_ratio: a shadowed texel darker than this share of its lit level holds no texture to relight and is invented.
        texture: how much of the exemplar's detail is taken over, 0 to 1.
        patch_m: size of a texture patch, metres.
        search_m: how far along the street a patch may come from, metres.
    """

    window_m: float = 5.0
    shadow_ratio: float = 0.82
    shadow_reach_m: float = 5.0
    black_ratio: float = 0.3
    texture: float = 0.6
    patch_m: float = 0.8
    search_m: float = 30.0


def fill_chart(
    chart: StreetChart,
    footprint: NDArray[np.bool_],
    settings: FillSettings,
    *,
    light: Light | None = None,
    progress: Progress = no_progress,
) -> StreetChart:
    """Relight what lay in the shadow of removed objects, and invent what nobody saw.

    Args:
        chart: as read.
        footprint: (A, B) texels under or inside removed objects.
        settings: see there.
        light: the sun and its shadows, None where it does not shine or is not known; then nearness to the objects tells
            which dark texels are their shadow, and what is invented has the shade that prevails around it.
    """
    per_m = 1.0 / chart.texel
    seen = chart.source == OBSERVED
    rows, columns = seen.shape
    s, t = chart.coordinates()
    inside = chart.ground.inside(np.repeat(s, columns), np.tile(t, rows)).reshape(rows, columns)
    window, hop = int(settings.window_m * per_m), max(1, int(4 * per_m))

    drift = find_drift(chart.color, seen, texels_per_m=per_m)

    def profile(color: Float32, usable: NDArray[np.bool_]) -> Float32:
        return drift.bent(lateral_profile(*drift.straightened(color, usable), window=window, hop=hop)[0])

    if light is None:
        shade = prevailing_shade(
            chart.color, seen, shadow_ratio=settings.shadow_ratio, window=window, hop=hop, per_m=per_m
        )
    else:
        # Right beside an object it is dark whatever the sun does, which would pass for the colour of its offset.
        clear = ~cv2.dilate(footprint.astype(np.uint8), disc(CONTACT_M * per_m)).astype(bool)
        shade = read_shade(
            chart.color, seen, light.kept | light.gone, lambda c, usable: profile(c, usable & clear), texels_per_m=per_m
        )
        sharp = seen & (chart.nearest < SHARP_M)
        sharp &= ~cv2.dilate(footprint.astype(np.uint8), disc(CONTACT_M / 4 * per_m)).astype(bool)
        shade = shade_of_strips(chart.color, sharp, shade, drift, texels_per_m=per_m)
    shadow, hopeless = shadows_of_removed(
        chart.color, seen, shade, footprint, light,
        reach_m=settings.shadow_reach_m, black_ratio=settings.black_ratio, per_m=per_m,
    )  # fmt: skip
    hole = inside & (~seen | hopeless)
    kernel = disc(0.12 * per_m)
    # The penumbra reaches a little beyond what counts as dark.
    wide = cv2.dilate(shadow.astype(np.uint8), kernel).astype(bool)
    sound = seen & ~hole & ~wide & ~cv2.dilate(footprint.astype(np.uint8), kernel).astype(bool)
    missing = np.zeros(seen.shape, dtype=np.float32)
    if light is not None:
        stays = shade.dark & ~shadow
        missing = shade_where_unseen(light, sound, stays, texels_per_m=per_m)
        missing[sound] = cv2.GaussianBlur(stays.astype(np.float32), (0, 0), 0.03 * per_m)[sound]
    left = 1 - missing[..., None] * (1 - shade.ratio)
    # In full sun: what the medians and the texture are taken from.
    sunny = np.where(seen[..., None], chart.color / left, 0).astype(np.float32)
    border = (missing > 0.02) & (missing < 0.98)
    border = cv2.dilate(border.astype(np.uint8), kernel).astype(bool)
    even = sound & ~border if light is not None else sound
    median = _in_the_sun(sunny, even, inside, profile, per_m=per_m, uneven=light is not None)
    target = median * left

    color, source, gain = chart.color.copy(), chart.source.copy(), chart.gain.copy()
    if shadow.any():
        relit = shadow & seen & ~hole
        gain = relighting_gain(chart.color, target, seen, shadow, wide, relit, per_m=per_m)
        gain[hole] = 1.0
        lifted = (gain.max(axis=2) > 1.0) & seen & ~hole
        color[lifted] = np.clip(color[lifted] * gain[lifted], 0, 1)
        source[relit] = RELIT
    progress(1, 2, "filling the street")
    invented = _invented(sunny - median, even, hole, drift, settings, per_m=per_m)
    fill = (median + invented) * left
    color[hole] = np.clip(fill[hole], 0, 1)
    source[hole] = INVENTED
    # Beyond the street the chart repeats its profile, so that nothing black is blended in at its edge.
    beyond = ~inside & ~seen
    color[beyond] = target[beyond]
    source[beyond] = OUTSIDE
    labels = chart.label.copy()
    unknown = hole & (labels < 0)
    if unknown.any():
        labels[unknown] = _lateral_labels(chart.label, seen)[np.nonzero(unknown)[1]]
    # Beside the object's outline pixels are too mixed to be read; they show the invented ground as well.
    close = cv2.dilate(footprint.astype(np.uint8), disc(0.6 * per_m)) > 0
    progress(2, 2, "filling the street")
    return replace(chart, color=color, source=source, gain=gain, label=labels, replaced=hole & close)


def _in_the_sun(
    sunny: Float32, even: NDArray[np.bool_], inside: NDArray[np.bool_], profile: Profile, *, per_m: float, uneven: bool
) -> Float32:
    """(A, B, 3) what the ground looks like in the sun, from what lies at its lateral offset.

    Args:
        sunny: (A, B, 3) as seen, shade taken away; even: (A, B) where that can be trusted; inside: (A, B) the ground.
        uneven: whether brightness varies along the street.
    """
    # At the foot of walls pixels mix, and after straightening one offset is wall here and walk there.
    read, kept = (
        cv2.erode(inside.astype(np.uint8), np.ones((1, 2 * int(m * per_m) + 1), np.uint8)).astype(bool)
        for m in (FOOT_M, 2 * FOOT_M)
    )
    median = np.minimum(_to_the_sides(profile(sunny, even & read), kept), 1.0)
    if uneven:
        # Light and dark alike vary along the street: more sky, a bright wall across.
        median = median * (1 + masked_blur(sunny / np.maximum(median, 0.02) - 1, even, 1.5 * per_m, prior=0.05))
    return median


def _invented(
    detail: Float32, even: NDArray[np.bool_], hole: NDArray[np.bool_], drift: Drift, settings: FillSettings, *, per_m: float
) -> Float32:  # fmt: skip
    """(A, B, 3) texture and lines for the hole (A, B), from ``detail`` (A, B, 3), what differs from the medians where ``even``."""
    # Texture is fine and faint; lines across the street, and what is left of shadows, are no texture to lay down elsewhere.
    broad = np.abs(luminance(masked_blur(detail, even, 0.1 * per_m)))
    faint = even & ~cv2.dilate((broad > MARK).astype(np.uint8), disc(0.1 * per_m)).astype(bool)
    texture, known = drift.straightened(detail, faint)
    wanted = drift.straightened(texture, hole)[1]
    invented = settings.texture * _quilt(
        texture, known, wanted, patch=max(6, int(settings.patch_m * per_m)), search=int(settings.search_m * per_m)
    )
    lines, on_line = continue_crossings(*drift.straightened(detail, even), wanted, texels_per_m=per_m)
    return drift.bent(lines + (1 - on_line[..., None]) * invented)


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


def _quilt(detail: Float32, valid: NDArray[np.bool_], hole: NDArray[np.bool_], *, patch: int, search: int) -> Float32:
    """Detail for the hole, patch by patch from the same columns of other rows (see :func:`_quilt_patches`)."""
    if not hole.any():
        return np.zeros_like(detail)
    return _quilt_patches(detail, valid, hole, patch, search)


@njit(cache=True)
def _quilt_patches(detail, valid, hole, patch, search):  # type: ignore[no-untyped-def]
    """Raster order over overlapping patches; for each the shift along the rows whose source is valid and meets best what
    already lies in the patch's surroundings; overlaps are blended with a tent."""
    rows, columns = hole.shape
    out = np.zeros((rows, columns, 3), np.float32)
    weight = np.zeros((rows, columns), np.float32)
    known = valid.copy()
    filled = detail.copy()
    step = max(1, patch * 2 // 3)
    stride = 2
    for r0 in range(0, rows, step):
        for c0 in range(0, columns, step):
            r1, c1 = min(rows, r0 + patch), min(columns, c0 + patch)
            need = 0
            for r in range(r0, r1):
                for c in range(c0, c1):
                    if hole[r, c] and weight[r, c] == 0:
                        need += 1
            if need == 0:
                continue
            ring = patch // 4
            best_cost, best_shift = 1e30, 0
            for shift in range(-search, search + 1, stride):
                if -patch < shift < patch:
                    continue
                if r0 + shift < 0 or r1 + shift > rows:
                    continue
                bad = 0
                total = 0
                for r in range(r0, r1, stride):
                    for c in range(c0, c1, stride):
                        if hole[r, c]:
                            total += 1
                            if not valid[r + shift, c]:
                                bad += 1
                if total == 0 or bad * 4 > total:
                    continue
                cost, count = 0.0, 0
                for r in range(max(0, r0 - ring), min(rows, r1 + ring), stride):
                    if r + shift < 0 or r + shift >= rows:
                        continue
                    for c in range(max(0, c0 - ring), min(columns, c1 + ring), stride):
                        if known[r, c] and valid[r + shift, c]:
                            for k in range(3):
                                d = filled[r, c, k] - detail[r + shift, c, k]
                                cost += d * d
                            count += 1
                mean = cost / count if count > 0 else 0.01
                mean = mean + 0.02 * bad / total + 1e-6 * abs(shift)
                if mean < best_cost:
                    best_cost, best_shift = mean, shift
            if best_cost >= 1e30:
                continue
            for r in range(r0, r1):
                for c in range(c0, c1):
                    if hole[r, c] and valid[r + best_shift, c]:
                        tr = min(r - r0 + 1, r1 - r) / patch
                        tc = min(c - c0 + 1, c1 - c) / patch
                        w = np.float32(max(0.01, min(tr, tc)))
                        for k in range(3):
                            out[r, c, k] += w * detail[r + best_shift, c, k]
                        weight[r, c] += w
                        for k in range(3):
                            filled[r, c, k] = out[r, c, k] / weight[r, c]
                        known[r, c] = True
    for r in range(rows):
        for c in range(columns):
            if weight[r, c] > 0:
                for k in range(3):
                    out[r, c, k] /= weight[r, c]
    return out
