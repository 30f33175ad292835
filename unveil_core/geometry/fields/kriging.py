"""Kriging: a plane carried to where nothing is known of it, by what is known around and by how alike its own places are.

The best linear estimate (Matheron, *Principles of geostatistics*, Economic Geology 1963) with a covariance that is measured on the
plane itself, so nothing is assumed of how far anything goes on: lines and kerbs of a street that is the same all along are carried
along it, patches of light only as far as such patches are large. First broadly, on coarse cells; then what that leaves, on finer
ones. The equations are solved by conjugate gradients with the covariance as a convolution, and its inverse as preconditioner.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy import fft

from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.fields.covariance import Covariance, ladder, measured_covariance

__all__ = ["Carried", "kriged"]

LEAST_KNOWN = 0.2
"""Share of a cell that must be known for it to count."""
PRECISE = 0.01
"""Error of the equations, as a share of what they explain, at which they are solved."""
MOST_ROUNDS = 100
"""Of conjugate gradients: they need a dozen to sixty."""


@dataclass(frozen=True)
class Level:
    """One of the levels, from coarse to fine.

    Attributes:
        cell_m: side of its cells, metres.
        lengths, endless: of its Gaussians, see :func:`ladder`.
    """

    cell_m: float
    lengths: int
    endless: bool


LEVELS = (Level(0.32, 5, endless=True), Level(0.08, 3, endless=False))
"""Coarse: up to 12 m across the street and 80 m along it. Fine: lines and stains. A third level of 4 cm changes nothing that is
measured; with the coarse one alone, what was seen is 0.6 dB farther from what it is taken for."""


@dataclass(frozen=True, eq=False)
class Carried:
    """A plane everywhere.

    Attributes:
        broad: (A, B, C) as the coarse level has it; all: (A, B, C) with what the finer ones add.
    """

    broad: Float32
    all: Float32


def kriged(values: Float32, known: Mask, texel: float) -> Carried:
    """A plane carried to where it is not known.

    Args:
        values: (A, B, C); known: (A, B) texels whose values count; texel: side of a texel, metres.
    """
    middle = values[known].mean(axis=0) if known.any() else np.full(values.shape[2], 0.5)
    total = np.broadcast_to(middle, values.shape).astype(np.float32)
    planes = []
    for level in LEVELS:
        if known.any():
            side = max(1, round(level.cell_m / texel))
            rest, weight = _cells(values - total, known, side)
            covariance = measured_covariance(rest, weight, *ladder(level.lengths, endless=level.endless))
            total = total + _enlarged(_solved(rest, weight, covariance), side, known.shape)
        planes.append(total)
    return Carried(planes[0], planes[-1])


def _cells(values: Float32, known: Mask, side: int) -> tuple[Float32, Float32]:
    """Means of cells, of what is known of each, and the share that is."""
    rows, columns = (-(-n // side) for n in known.shape)
    padding = ((0, rows * side - known.shape[0]), (0, columns * side - known.shape[1]))
    weight = np.pad(known.astype(np.float32), padding)
    total = np.pad(np.where(known[..., None], values, 0).astype(np.float32), (*padding, (0, 0)))
    weight = weight.reshape(rows, side, columns, side).mean(axis=(1, 3))
    total = total.reshape(rows, side, columns, side, -1).mean(axis=(1, 3))
    return total / np.maximum(weight, 1e-6)[..., None], weight


def _solved(values: Float32, weight: Float32, covariance: Covariance) -> Float32:
    """The estimate (A, B, C) in all cells.

    Args:
        values: (A, B, C) with a mean of 0; weight: (A, B) share of each that is known.
    """
    known = weight > LEAST_KNOWN
    if covariance.noise <= 0 or not known.any():
        return np.zeros_like(values)
    rows, columns = known.shape
    size = [
        fft.next_fast_len(n + more, real=True)
        for n, more in zip(known.shape, covariance.reach(known.shape), strict=True)
    ]
    alike = np.maximum(fft.rfft2(covariance.kernel((size[0], size[1]))).real, 0)
    inverse = (1 / (alike + covariance.noise)).astype(np.float32)
    noise = np.where(known, covariance.noise / np.maximum(weight, LEAST_KNOWN), 0).astype(np.float32)

    def filtered(plane: Float32, by: Float32) -> Float32:
        spread: Float32 = fft.irfft2(fft.rfft2(plane, size) * by, size)[:rows, :columns]
        return spread

    def preconditioned(plane: Float32) -> Float32:
        return np.where(known, filtered(plane, inverse), 0).astype(np.float32)

    def product(plane: Float32) -> Float32:
        return np.where(known, filtered(plane, alike) + noise * plane, 0).astype(np.float32)

    found = np.empty_like(values)
    for channel in range(values.shape[2]):
        left = np.where(known, values[..., channel], 0).astype(np.float32)
        enough = PRECISE**2 * float((left * left).sum())
        weights = np.zeros_like(left)
        step = ahead = preconditioned(left)
        power = float((left * ahead).sum())
        for _ in range(MOST_ROUNDS):
            if power <= 0 or float((left * left).sum()) <= enough:
                break
            turned = product(step)
            length = np.float32(power / max(float((step * turned).sum()), 1e-30))
            weights, left = weights + length * step, left - length * turned
            ahead = preconditioned(left)
            before, power = power, float((left * ahead).sum())
            step = ahead + np.float32(power / before) * step
        found[..., channel] = filtered(weights, alike)
    return found


def _enlarged(cells: Float32, side: int, shape: tuple[int, ...]) -> Float32:
    """Cells as texels (A, B, C)."""
    rows, columns = cells.shape[:2]
    large = cv2.resize(cells, (columns * side, rows * side), interpolation=cv2.INTER_CUBIC).reshape(
        rows * side, columns * side, -1
    )
    return large[: shape[0], : shape[1]].astype(np.float32)
