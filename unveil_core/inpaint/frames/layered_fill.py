"""A hole in layers: far ground, what stands or hangs above the horizon, and what is near.

Patches of the surroundings continue a wall well, but know nothing of the street: behind a car at the end of it they lay brick where
there is road, or road where there is sky. So what is far, below the horizon and beside ground in its row is ground, for streets go
on, and takes the colours of that ground, which is about as far. What is far and above the horizon has the colours around it and
those at the same height, for skylines and rows of trees are level, with the grain of patches. All else is left to patches.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter1d

from unveil_core.base.pictures.levels import rounded_like
from unveil_core.base.types import Float32, Levels, Mask
from unveil_core.geometry.images import masked_blur, scale_from_384
from unveil_core.inpaint.single_image.registry import exemplar, fill_around, telea

__all__ = ["across", "fill_in_layers"]

FAR_M = 25.0
"""Continued depth from which on a hole is filled in layers, metres. Nearer, what is below the horizon is often the wall behind a
parked car. On eight streets by seed 15 to 35 m differ by less than 0.3 dB of a hole, but on one with walls close by, where 15 m
cost 0.5."""
BESIDE_PX = 8
"""Pixels at 384 whose mean is a row's colour on one side, in proportion in wider images."""
DOWN_PX = 2.0
"""Standard deviation, pixels at 384, over which rows beside each other are blended: where a line or a lamp lies beside one and not
beside the next, the ground would come out in stripes. In the holes of thirteen streets 49 +0.7, 45 +0.5, 54 +0.2, the others within
0.04 dB; 3 pixels are no better."""
GRAIN_PX = 4.0
"""Standard deviation, pixels at 384, below which details come from patches, in proportion in wider images. By patches alone the
colours are 0.7 to 2 dB worse on five of eight streets, and as good on the others."""


def fill_in_layers(
    image: Levels, hole: Mask, depth: NDArray[np.float64], *, ground: Mask, beside: Mask, below_horizon: Mask
) -> Levels:
    """Fill a hole whose surroundings are known by what they show.

    Args:
        image: (H, W, 3) levels of 255; hole: (H, W); depth: (H, W) metres, continued into the hole.
        ground: (H, W) pixels that are known to show ground; beside: those that show something else.
        below_horizon: (H, W) pixels that cannot show the sky.
    """
    far = hole & (depth > FAR_M)
    on_ground, above = far & below_horizon, far & ~below_horizon
    ground, beside = ground & ~hole, beside & ~hole
    if ground.any():
        on_ground &= _next_to(ground, ground | beside)
        image = across(image, on_ground, ground)
        hole = hole & ~on_ground
    patches = fill_around(exemplar, image, hole)
    if not above.any():
        return patches
    color = fill_around(telea, image, hole).astype(np.float32)
    source = beside & ~below_horizon
    if source.any():
        color = (color + across(image, above, source)) / 2  # type: ignore[assignment]
    mixed = patches + masked_blur(color - patches, above, GRAIN_PX * scale_from_384(image.shape[1]))
    return np.where(above[..., None], rounded_like(mixed, image), patches)


def across(image: Levels, wanted: Mask, source: Mask) -> Levels:
    """Interpolate each row of ``wanted`` (H, W) between the nearest pixels of ``source`` on its two sides; rows without any take
    over the nearest of the others."""
    reach = round(BESIDE_PX * scale_from_384(image.shape[1]))
    result = image.astype(np.float32)
    reached = source.copy()
    for y in np.flatnonzero(wanted.any(axis=1) & source.any(axis=1)):
        x, known = np.flatnonzero(wanted[y]), np.flatnonzero(source[y])
        total = np.concatenate([np.zeros((1, 3)), np.cumsum(image[y, known].astype(np.float64), axis=0)])
        after = np.searchsorted(known, x)
        color, weight = np.zeros((2, len(x), 3))
        for begin, end, nearest in (
            (np.maximum(after - reach, 0), after, after - 1),
            (after, np.minimum(after + reach, len(known)), after),
        ):
            there = end > begin
            apart = np.abs(known[np.clip(nearest, 0, len(known) - 1)] - x)
            share = np.where(there, 1.0 / np.maximum(apart, 1), 0.0)[:, None]
            color += share * (total[end] - total[begin]) / np.maximum(end - begin, 1)[:, None]
            weight += share
        result[y, x] = color / weight
        reached[y, x] = True
    result = _down(result, wanted & reached, DOWN_PX * scale_from_384(image.shape[1]))
    left = wanted & ~reached
    if left.any() and reached.any():
        row, column = distance_transform_edt(~reached, return_distances=False, return_indices=True)
        result[left] = result[row[left], column[left]]
    return rounded_like(result, image)


def _down(image: Float32, wanted: Mask, sigma: float) -> Float32:
    """An image (H, W, 3) whose ``wanted`` pixels (H, W) are blended with those above and below."""
    weight = wanted.astype(np.float32)[..., None]
    total, share = (gaussian_filter1d(plane, sigma, axis=0, mode="constant") for plane in (image * weight, weight))
    blended: Float32 = np.where(wanted[..., None], total / np.maximum(share, 1e-6), image)
    return blended


def _next_to(source: Mask, known: Mask) -> Mask:
    """(H, W) whether the nearest ``known`` pixel of the row, on one side or the other, is one of ``source``: a wall on both sides
    goes on between."""
    columns = np.arange(source.shape[1])[None]
    before = np.maximum.accumulate(np.where(known, columns, -1), axis=1)
    after = np.minimum.accumulate(np.where(known, columns, source.shape[1])[:, ::-1], axis=1)[:, ::-1]
    padded = np.pad(source, ((0, 0), (1, 1)))
    found: Mask = np.take_along_axis(padded, before + 1, axis=1) | np.take_along_axis(padded, after + 1, axis=1)
    return found
