"""Pixels seen elsewhere are carried over: what another photograph shows of a place behind a removed object is taken from it.

A scene of surfels holds a street to some 20 dB; a photograph of the same place from a few metres off is sharp. It is warped by the
depth of the empty scene and, on the ground, by the ground itself. Three things make it fit, all told by the *ring* of pixels around
removed objects that this frame's own photograph shows as well:

* a small shift, one for the ground and one for what stands on it (:mod:`unveil_core.delivery.alignment`);
* the difference in light, carried smoothly from the ring into the hole, as in seamless cloning (Farbman et al., *Coordinates for
  instant image cloning*, SIGGRAPH 2009): exposure, vignetting, and the glare of the road, which changes with the view;
* how wrong it is, against how wrong the rendered scene is there, in the light of the ring as well. Whichever errs less around a
  place is shown in it. An error is told by a part of the ring to which the light was not fitted: with as many unknowns as a
  smooth correction has, anything agrees with the ring that it was fitted to. The scene was fitted to this frame, too, so its
  error there is less than in the hole (:data:`IN_SAMPLE`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from unveil_core.base.mechanisms import on
from unveil_core.base.types import Float32, Float64, Levels, Mask
from unveil_core.delivery.alignment import find_shift, shift_planes
from unveil_core.delivery.views import EmptyViews, choose_sources, places_behind, sees
from unveil_core.geometry.fields.pull_push import pull_push
from unveil_core.geometry.fields.robust import held_near_median
from unveil_core.geometry.images import area_px, border_px, luminance, masked_blur, sample_at, scale_from_384, within
from unveil_core.ground.street import Ground

__all__ = ["Photographs", "carried_over"]

SOURCES = 4
"""Photographs at most that a frame takes from. On KITTI and on a drawn street better than two and three; six are no better."""
RING_PX = 16
"""Width of the ring, pixels at 384, in proportion in wider pictures. 24 take a fifth longer and are better
by less than the error of the measurement, 12 are worse on the ground."""
LEAST_RING_PX = 50
"""Fewest pixels of the ring, of 384x256, by which a photograph can be judged."""
SMOOTH_PX = 1.5
"""Length over which light and errors are averaged, pixels at 384, rounded to a power of two. Of 1.5, 3 and 6 the best on KITTI and
on a drawn street."""
COMPARED_PX = 1.0
"""Standard deviation of the blur under which errors are taken, pixels at 384: a photograph is not to lose to a smooth picture
because its grain is another's."""
FEATHER_PX = 2.0
"""Standard deviation of the seams between photographs, and between them and the render, pixels at 384."""
END_PX = 1.0
"""Width over which a photograph fades where it shows no more, pixels at 384. Of 0, 1, 2 and 4 the one with the least LPIPS of whole
cars on KITTI; the wider, the less is left of thin strips."""
FOLD_PX = 16.0
"""Side of the squares, by turns fitted to and judged by, pixels at 384: as wide as the ring, so that a judged pixel is as far from
those that were fitted to as the hole is."""
IN_SAMPLE = 6.0
"""Squared error of the scene in a hole as a multiple of that on the ring, to which it was fitted, the frame's own photograph among
others: 1.5 on PandaSet, 4 to 8 on KITTI, 12 on nuScenes, by planted cars. Of 1, 3, 6 and 12 nuScenes gains 0.9 dB from 1 to 6, the
others change by less than 0.1 dB. A photograph of another frame was fitted to nothing here: 0.9 to 2."""
LEAST_LEVELS = 2.0
"""Least standard deviation of differences on the ring, levels of 255."""
BLURS_PX = (1.0, 2.0)
"""Standard deviations under which a photograph is read that is twice and four times finer, pixels: half of what a pixel covers."""
SAMPLES = 4000
"""Pixels, evenly chosen, of which medians are taken."""
MEAN = np.full(3, 1 / 3, np.float32)
"""Of three channels: a product with it takes a quarter of the time of ``mean``."""
UNKNOWN = np.float32(np.inf)


@dataclass(frozen=True, eq=False)
class Photographs:
    """What frames can take from one another.

    Attributes:
        views: of all frames; pictures: (H, W, 3) levels of 255, their photographs in canonical colours.
        ground: the street's, None where there is none.
    """

    views: EmptyViews
    pictures: Sequence[Levels]
    ground: Ground | None


@dataclass(frozen=True, eq=False)
class _Places:
    """What a frame asks for, in the box (h, w) around it.

    Attributes:
        asked: (h, w) pixels that are looked for or lie on the ring; wanted, ring: (h, w) which of both.
        filled: (h, w) pixels that do not show the photograph, the wanted ones among them.
        ground: (h, w) pixels that show the ground.
        points: (N, 3) behind the asked pixels, in the order of ``np.nonzero``; size: (N,) metres of a pixel there.
        photograph: (h, w, 3) of the frame itself; scale: from 384.
    """

    asked: Mask
    wanted: Mask
    ring: Mask
    filled: Mask
    ground: Mask
    points: Float64
    size: Float64
    photograph: Float32
    scale: float

    @property
    def surfaces(self) -> tuple[Mask, Mask]:
        """(h, w) the ground, and what stands on it: their depth is found in different ways, and their light differs."""
        return self.ground, ~self.ground

    def scattered(self, index: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(h, w, ...) values of some of the points, 0 elsewhere."""
        rows, columns = (i[index] for i in np.nonzero(self.asked))
        plane = np.zeros((*self.asked.shape, *values.shape[1:]), values.dtype)
        plane[rows, columns] = values
        return plane

    def enough(self, mask: Mask) -> bool:
        """Whether so many pixels of the ring tell anything."""
        return int(mask.sum()) >= area_px(self.asked.shape, LEAST_RING_PX)

    def told(self, shown: Mask) -> Iterator[tuple[Mask, Mask]]:
        """The surfaces of which a picture shows wanted places and enough of the ring to judge it by.

        Args:
            shown: (h, w) pixels that it shows.
        Returns:
            of each the pixels (h, w), and those of them on the ring.
        """
        for surface in self.surfaces:
            mask = shown & surface
            ring = mask & self.ring
            if self.enough(ring) and (mask & self.wanted).any():
                yield mask, ring

    def light(self, left: Float32, ring: Mask) -> Float32:
        """(h, w, 3) differences on the ring (h, w), carried smoothly everywhere, and held near their median where the two show
        different things."""
        known = left[ring]
        return self.smooth(held_near_median(left, known[:: max(1, len(known) // SAMPLES)], LEAST_LEVELS), ring)

    def error(self, left: Float32, ring: Mask) -> Float32:
        """(h, w) squared error that a picture in this frame's light has, as the ring (h, w) tells by cross-validation: differences
        ``left`` (h, w, 3) in one half of its squares, less the light fitted to the other half, carried smoothly everywhere."""
        row, column = (np.arange(n) // max(1, round(FOLD_PX * self.scale)) for n in ring.shape)
        even = (row[:, None] + column) % 2 == 0
        unlike = np.where(ring[..., None], left, 0)
        for judged in (even & ring, ~even & ring):
            if (fitted := ring & ~judged).any():
                unlike[judged] -= self.light(left, fitted)[judged]
        blurred = masked_blur(unlike, ring, COMPARED_PX * self.scale)
        return self.smooth((np.square(blurred) @ MEAN)[..., None], ring)[..., 0]

    def feathered(self, mask: Mask) -> Float32:
        """(h, w) a mask with a soft border."""
        soft: Float32 = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), FEATHER_PX * self.scale)
        return np.maximum(soft, np.float32(1e-6))

    def smooth(self, plane: Float32, known: Mask) -> Float32:
        """(h, w, C) what is known, carried everywhere."""
        levels = round(float(np.log2(SMOOTH_PX * self.scale)))
        return pull_push(plane, known.astype(np.float32), levels)


def carried_over(given: Photographs, own: int, street: Levels, rendered: Levels, wanted: Mask) -> Levels:
    """The empty street in a frame, with what other photographs show better than the scene.

    Args:
        own: the frame's number.
        street: (H, W, 3) of the empty street; rendered: (H, W, 3) of the empty scene; both in canonical colours.
        wanted: (H, W) pixels that another frame has seen.
    Returns:
        (H, W, 3) in canonical colours; the street itself where the pixels are not wanted.
    """
    view = given.views.frames[own]
    wanted = wanted & (view.depth > 0)
    if not wanted.any() or not on("carried_photographs"):
        return street
    part, places = _places(given, own, wanted)
    base = street[part].astype(np.float32)
    sought = places.wanted[places.asked]
    photographs = [
        found
        for j in choose_sources(places.points[sought], own, given.views, SOURCES, places.ground[places.asked][sought])
        if (found := _photograph(given, j, places)) is not None
    ]
    if not photographs:
        return street
    left, errs = places.photograph - rendered[part], np.full(places.wanted.shape, UNKNOWN)
    for mask, ring in places.told(np.ones_like(places.wanted)):
        errs[mask] = IN_SAMPLE * places.error(left, ring)[mask]
    mixed = _mixed(base, errs, photographs, places)
    result = street.astype(np.float32)
    result[part] = np.where(places.wanted[..., None], mixed, street[part])
    return result


def _places(given: Photographs, own: int, wanted: Mask) -> tuple[tuple[slice, slice], _Places]:
    """The box of what is wanted (H, W) with the ring around, and what is asked for in it."""
    view = given.views.frames[own]
    scale = scale_from_384(view.camera.width)
    reach = RING_PX * scale
    rows, columns = np.flatnonzero(wanted.any(axis=1)), np.flatnonzero(wanted.any(axis=0))
    part = tuple(slice(max(0, int(i[0] - 2 * reach)), int(i[-1] + 2 * reach) + 1) for i in (rows, columns))
    barred, wanted, depth = view.barred[part], wanted[part], view.depth[part]
    ring = within(barred, reach) & within(wanted, 2 * reach) & ~barred & (depth > 0)
    ring[::2, ::2] = ring[1::2, 1::2] = False  # every other pixel tells as much in half the time
    asked = ring | wanted
    filled = wanted | ~within(~barred, border_px(view.camera.width))
    rays = view.camera.rays()[part][asked]
    behind = places_behind(view.camera, rays, depth[asked].astype(np.float64), given.ground)
    ground = np.zeros(asked.shape, dtype=bool)
    ground[asked] = behind.on_ground
    photograph = given.pictures[own][part].astype(np.float32)
    size = behind.depth / view.camera.fx
    return part, _Places(asked, wanted, ring, filled, ground, behind.points, size, photograph, scale)  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class _Layer:
    """What the hole could show.

    Attributes:
        picture: (h, w, 3) in this frame's light; error: (h, w) squared, as far as the ring tells, infinite where it shows nothing.
    """

    picture: Float32
    error: Float32


def _photograph(given: Photographs, j: int, places: _Places) -> _Layer | None:
    """What frame ``j`` shows of the places; None where that is nothing, or nothing by which it could be judged."""
    index, pixels, depth = sees(given.views.frames[j], places.points, places.ground[places.asked])
    finer = places.size[index] / (depth / given.views.cameras[j].fx)
    at = places.scattered(index, np.column_stack([pixels, finer]).astype(np.float32))
    shown = at[..., 2] > 0
    picture_there = given.pictures[j].astype(np.float32)
    levels = [picture_there, *(cv2.GaussianBlur(picture_there, (0, 0), blur) for blur in BLURS_PX)]
    planes = shift_planes(luminance(picture_there))
    picture, error = np.zeros_like(places.photograph), np.full(shown.shape, UNKNOWN)
    for mask, ring in places.told(shown):
        shift = np.zeros(2)
        if on("aligned_photographs"):
            shift = find_shift(planes, at[ring][:, :2], luminance(places.photograph[ring]))
        plane = np.zeros_like(picture)
        position = at[mask]
        plane[mask] = _sampled(levels, position[:, :2] + shift, position[:, 2])
        left = places.photograph - plane
        picture[mask] = (plane + places.light(left, ring))[mask]
        error[mask] = places.error(left, ring)[mask]
    return _Layer(picture, error) if np.isfinite(error).any() else None


def _sampled(levels: Sequence[Float32], pixels: Float64, finer: Float32) -> Float32:
    """(N, 3) colours of a photograph at positions (N, 2), blurred where it is so many times finer (N,) than what asks."""
    level = np.clip(np.log2(np.maximum(finer, 1)), 0, len(levels) - 1)
    found = np.zeros((len(pixels), 3), np.float32)
    for k, picture in enumerate(levels):
        share = np.maximum(1 - np.abs(level - k), 0).astype(np.float32)
        some = share > 0
        if some.any():
            found[some] += share[some, None] * sample_at(picture, pixels[some], cv2.INTER_CUBIC)
    return found


def _mixed(base: Float32, errs: Float32, photographs: Sequence[_Layer], places: _Places) -> Float32:
    """(h, w, 3) at each pixel what errs least, with soft seams.

    Args:
        base: (h, w, 3) of the empty street; errs: (h, w) its squared error.
    """
    errors = np.stack([np.where(places.wanted, photograph.error, UNKNOWN) for photograph in photographs])
    best, least = errors.argmin(axis=0), errors.min(axis=0)
    taken = least < errs
    total = places.feathered(places.wanted & ~taken)
    mixed = base * total[..., None]
    for k, one in enumerate(photographs):
        shown = np.isfinite(errors[k])
        if (mine := taken & (best == k)).any():
            share = places.feathered(mine)
            # Where a photograph ends, the street goes on.
            ends = shown | ~places.filled
            inside = cv2.distanceTransform(ends.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            ramp = np.clip(inside / (END_PX * places.scale + 1), 0, 1) * shown
            mixed += (share * ramp)[..., None] * one.picture + (share * (1 - ramp))[..., None] * base
            total += share
    return mixed / total[..., None]
