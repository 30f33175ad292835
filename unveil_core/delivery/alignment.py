"""A small shift of one photograph against another: poses and depth are right to a pixel or two."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64
from unveil_core.geometry.fields.robust import MAD_TO_DEVIATION
from unveil_core.geometry.images import sample_at

__all__ = ["find_shift", "shift_planes"]

BLURS_PX = (2.0, 1.0, 0.0)
"""Standard deviations of the blurs under which the shift is looked for one after the other, pixels: shifts of some pixels are
found under the first, parts of a pixel without any."""
ROUNDS = 6
"""Steps at most under each blur; three or four settle."""
SETTLED_PX = 0.04
"""A step so small ends the search, pixels: no interpolation shows it."""
MOST_PX = 4.0
"""Largest shift, pixels. Poses of KITTI, which are a pixel off, need 0.2 to 3; what goes farther follows another texture."""
PIXELS = 2000
"""That are compared, evenly chosen: a shift of two numbers does not need more, and each costs time."""
LEAST_LEVELS = 2.0
"""Least scale of the robust weights, levels of 255: quantization and compression."""


def shift_planes(gray: Float32) -> list[Float32]:
    """(H, W, 3) each: the luminance (H, W) of a photograph, levels of 255, under each blur, and its slopes across and down."""
    blurred = [cv2.GaussianBlur(gray, (0, 0), blur) if blur else gray for blur in BLURS_PX]
    ways = ((1, 0), (0, 1))
    return [cv2.merge([g, *(cv2.Sobel(g, cv2.CV_32F, *way, scale=1 / 8) for way in ways)]) for g in blurred]  # type: ignore[misc]


def find_shift(planes: Sequence[Float32], pixels: NDArray[np.floating], target: Float32) -> Float64:
    """(2,) what has to be added to positions in a photograph for it to show there what another does; 0 where none helps.

    Lucas and Kanade (1981) with robust weights, a gain and a bias. The shift is fitted to every other pixel, and taken if it lowers
    the error of those between.

    Args:
        planes: of the photograph, see :func:`shift_planes`.
        pixels: (N, 2) positions in it; target: (N,) luminance that the other shows at them.
    """
    step = max(1, len(pixels) // PIXELS)
    pixels, target = pixels[::step].astype(np.float64), target[::step].astype(np.float64)
    shift = np.zeros(2)
    for plane in planes:
        for _ in range(ROUNDS):
            level, across, down = sample_at(plane, pixels[::2] + shift).T.astype(np.float64)
            moved = _step(level, across, down, target[::2] - level)
            shift = np.clip(shift + np.clip(moved, -1, 1), -MOST_PX, MOST_PX)
            if np.abs(moved).max() < SETTLED_PX:
                break
    before, after = (_error(sample_at(planes[-1], pixels[1::2] + s)[:, 0], target[1::2]) for s in (np.zeros(2), shift))
    return shift if after < before else np.zeros(2)


def _step(level: Float64, across: Float64, down: Float64, left: Float64) -> Float64:
    """(2,) the step that lowers the differences ``left`` (N,) most, together with a change of gain and bias."""
    equations = np.stack([across, down, level - level.mean(), np.ones_like(level)], axis=1)
    spread = MAD_TO_DEVIATION * np.median(np.abs(left - np.median(left))) + LEAST_LEVELS
    weighted = equations / (1 + (left / (2 * spread)) ** 2)[:, None]
    # The smallest that makes a plain surface, which no shift changes, solvable.
    found: Float64 = np.linalg.solve(weighted.T @ equations + 1e-3 * np.eye(4), weighted.T @ left)
    return found[:2]


def _error(level: NDArray[np.floating], target: NDArray[np.floating]) -> float:
    """Mean absolute difference but for the median's."""
    left = target - level
    return float(np.abs(left - np.median(left)).mean()) if len(left) else 0.0
