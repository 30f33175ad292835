"""How bright the ground looks by where in the picture it is seen.

A lens darkens the corners (vignetting), and asphalt mirrors the sky and the sun the more, the flatter it is looked at: on real
streets the same ground is up to three times as bright far off, against the sun, as at the bumper. The camera looks along the
street all the way, so both hang on the place in the picture alone, and a drive calibrates them itself: the same ground is seen at
many places in the picture as the car comes by (radiometric self-calibration; Kim and Pollefeys, *Robust radiometric calibration
and vignetting correction*, 2008). In linear light it is a factor, here its logarithm.

The chart holds the ground without this factor, so that it looks the same from near and far; frames get theirs back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from unveil_core.base.srgb import linear_of_srgb, srgb_of_linear
from unveil_core.base.types import Float32, Float64, Labels, Levels
from unveil_core.geometry.fields.picture_field import PictureField, fit_fields

__all__ = ["GroundLooks", "ViewLight", "light_by_view", "light_of", "lit", "unlit"]

FLOOR = 0.003
"""Linear light that is added before the logarithm is taken: a level of 8-bit sRGB at its dark end, where noise is."""
NEAR_M = 8.0
"""Distance at which a look weighs half of one from right above, metres: farther off, pixels mix what lies along the street."""
HELD_OUT = 4
"""Every so manieth cell of the ground is left out of a first fit, to see whether the field explains ground it was not fitted to."""
SURE = 2.0
"""Standard errors by which it must."""
BRIGHTEST, BRIGHT_SHARE = 235 / 255, 99.5
"""sRGB that this share of the ground, per cent, stays below in the chart: so there is room to fill in white paint."""
LEAST_CELLS = 8
"""Cells of ground seen from several places, fewer than which tell nothing."""
_LIGHT = np.log(linear_of_srgb(np.arange(256) / 255) + FLOOR).astype(np.float32)


@dataclass(frozen=True, eq=False)
class GroundLooks:
    """Ground seen by cameras at places in their pictures.

    Attributes:
        camera: (N,) index of the camera; place: (N,) number of the texel; cell: (N,) number of the patch of ground around it.
        pixels: (N, 2) where it is seen; seen: (N, 3) logarithm of linear light; depth: (N,) how far off, metres.
    """

    camera: Labels
    place: Labels
    cell: Labels
    pixels: Float64
    seen: Float64
    depth: Float64


@dataclass(frozen=True, eq=False)
class ViewLight:
    """The factor by camera, as a logarithm.

    Attributes:
        fields: one a camera, of three channels.
        level: the factor of ground seen from near, the same for all.
        error, error_without: mean difference between looks of the same ground that was held out, with and without it.
    """

    fields: tuple[PictureField, ...]
    level: float
    error: float
    error_without: float

    @property
    def range(self) -> tuple[float, float]:
        """Least and greatest factor, but for a twentieth of the pictures on either side, of that of ground seen from near."""
        every = np.concatenate([(f.values.mean(axis=2) - self.level).ravel() for f in self.fields])
        low, high = np.exp(np.percentile(every, (5, 95)))
        return float(low), float(high)


def light_of(picture: Levels) -> Float32:
    """(…, 3) logarithm of the linear light of sRGB, levels of 255."""
    if picture.dtype == np.uint8:
        return _LIGHT[picture]
    light = linear_of_srgb(np.maximum(picture, 0) / 255) + FLOOR
    return np.log(light).astype(np.float32)  # type: ignore[no-any-return]


def unlit(picture: Levels, field: PictureField) -> Float32:
    """A picture (H, W, 3) without the factor of its camera, levels of 255, not rounded."""
    light = np.exp(light_of(picture) - field.plane()) - FLOOR
    found: Float32 = (255 * srgb_of_linear(np.maximum(light, 0))).astype(np.float32)
    return found


def lit(colors: Float32, factor: Float32) -> Float32:
    """Colours (N, 3), white 1, with a factor (N, 3), or (3,), which is a logarithm."""
    light = (linear_of_srgb(colors) + FLOOR) * np.exp(factor) - FLOOR
    found: Float32 = srgb_of_linear(np.maximum(light, 0)).astype(np.float32)
    return found


def light_by_view(looks: GroundLooks, sizes: Sequence[tuple[int, int]]) -> ViewLight | None:
    """The factor that makes the same ground look the same from everywhere; None where what was held out does not bear it out.

    Args:
        sizes: width and height of the pictures of each camera.
    """
    _, place, count = np.unique(looks.place, return_inverse=True, return_counts=True)
    often = count[place] > 1
    if not often.any():
        return None
    camera, pixels, seen, depth = looks.camera[often], looks.pixels[often], looks.seen[often], looks.depth[often]
    place, cell = (np.unique(a[often], return_inverse=True)[1] for a in (looks.place, looks.cell))
    weight = 1 / (1 + np.square(depth / NEAR_M))
    start = [PictureField.flat(size, float(min(pixels[camera == k, 1], default=0.0))) for k, size in enumerate(sizes)]

    def fit(some: np.ndarray) -> list[PictureField]:
        own = np.unique(place[some], return_inverse=True)[1]
        return fit_fields(start, camera[some], own, pixels[some], seen[some], weight[some])

    held = cell % HELD_OUT == 0
    if len(np.unique(cell[held])) < LEAST_CELLS or held.all():
        return None
    tried = fit(~held)
    errors = [
        _by_cell(seen - factor, place, cell, weight, held)
        for factor in (_factors(tried, camera, pixels), np.zeros_like(seen))
    ]
    gained = errors[1] - errors[0]
    if gained.mean() < SURE * gained.std() / np.sqrt(len(gained)):
        return None
    fields = fit(np.ones_like(held))
    factor = _factors(fields, camera, pixels)
    nearest = np.lexsort((depth, place))
    nearest = nearest[np.concatenate([[True], np.diff(place[nearest]) > 0])]
    base = np.median(factor[nearest], axis=0)
    bright = np.percentile((seen - factor)[nearest] + base, BRIGHT_SHARE)
    level = max(0.0, float(bright - np.log(linear_of_srgb(np.array(BRIGHTEST)) + FLOOR)))
    fields = [PictureField(f.values - base + level, f.size, f.top) for f in fields]
    return ViewLight(tuple(fields), level, float(errors[0].mean()), float(errors[1].mean()))


def _factors(fields: Sequence[PictureField], camera: Labels, pixels: Float64) -> Float64:
    """(N, 3) at positions (N, 2) in the pictures of cameras (N,)."""
    found = np.zeros((len(camera), 3))
    for k, field in enumerate(fields):
        found[camera == k] = field.at(pixels[camera == k])
    return found


def _by_cell(seen: Float64, place: Labels, cell: Labels, weight: Float64, held: np.ndarray) -> Float64:
    """(C,) by held-out cell of the ground, mean difference of looks from the mean of their place."""
    total = np.maximum(np.bincount(place, weight), 1e-12)
    mean = np.stack([np.bincount(place, weight * seen[:, k]) / total for k in range(3)], axis=1)
    error = np.abs(seen - mean[place]).mean(axis=1)
    numbers = np.unique(cell[held], return_inverse=True)[1]
    found: Float64 = np.bincount(numbers, (weight * error)[held]) / np.bincount(numbers, weight[held])
    return found
