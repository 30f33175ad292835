"""How alike two places of a plane are, by how far apart they lie along it and across it: measured on what is known of the plane.

The covariance is a sum of Gaussians, short and long, round and drawn out along the rows; their variances follow from the plane's
autocorrelation and from its differences by lag, its variogram, by least squares without negative ones (Lawson and Hanson, *Solving
Least Squares Problems*, 1974, chapter 23).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, optimize

from unveil_core.base.types import Float32, Float64

__all__ = ["Covariance", "ladder", "measured_covariance"]

STEP = 2.5
"""From one length of the ladder to the next: sums of Gaussians so far apart follow an exponential to some per cent."""
ENDLESS = 1e6
"""Length, cells, of what is the same all along the rows."""
COUNTED = 0.5
"""Share of a cell from which on what is known of it is measured by."""
LEAST_NOISE = 0.02
"""Share of the variance that is noise at the least: it keeps the equations of kriging solvable in single precision."""
FEWEST_PAIRS = 50
"""Pairs of cells from which a lag is measured."""
CLOSE_LAGS, ALONG_LAGS, ACROSS_LAGS = 6, 20, 12
"""Lags of a cell each that are all looked at, and how many are beyond them, farther and farther apart, along and across."""
ACROSS_WEIGHT = 4.0
"""By how much a cell across is farther than one along, where lags are weighted: short ones matter most."""


@dataclass(frozen=True, eq=False)
class Covariance:
    """A sum of Gaussians.

    Attributes:
        along, across: (K,) their standard deviations, cells; variance: (K,).
        noise: variance of a cell that has nothing to do with any other.
    """

    along: Float64
    across: Float64
    variance: Float64
    noise: float

    def kernel(self, shape: tuple[int, int]) -> Float32:
        """On a torus (A, B): its value at each lag, those of negative ones at the end."""
        along, across = (np.minimum(np.arange(n), n - np.arange(n))[:, None] for n in shape)
        total: Float64 = (np.exp(-0.5 * (along / self.along) ** 2) * self.variance) @ np.exp(
            -0.5 * (across / self.across) ** 2
        ).T
        return total.astype(np.float32)

    def reach(self, shape: tuple[int, int]) -> tuple[int, int]:
        """Cells along and across beyond which a plane of this shape need not be repeated by a transform."""
        some = self.variance > 1e-3 * max(self.variance.sum(), 1e-30)
        lengths = (np.max(sigma, where=some, initial=0.0) for sigma in (self.along, self.across))
        return tuple(min(n, int(3 * length) + 1) for n, length in zip(shape, lengths, strict=True))  # type: ignore[return-value]


def ladder(lengths: int, *, endless: bool) -> tuple[Float64, Float64]:
    """Standard deviations along and across (K,) of Gaussians, cells: from one cell on so many lengths across, and two more along;
    each as long as it is wide, or longer.

    Args:
        endless: whether there is one of each width that goes on for ever.
    """
    across = STEP ** np.arange(lengths)
    along = [*STEP ** np.arange(lengths + 2), *[ENDLESS] * endless]
    pairs = [(a, c) for a in along for c in across if a >= c]
    first, second = np.array(pairs, dtype=np.float64).T
    return first, second


def measured_covariance(values: Float32, weight: Float32, along: Float64, across: Float64) -> Covariance:
    """The covariance of a plane.

    Args:
        values: (A, B, C) with a mean of 0, of which C are taken as so many planes of one kind; weight: (A, B) share of each cell
            that is known.
        along, across: (K,) of the Gaussians, cells.
    """
    known = weight > COUNTED
    within = across.max() * STEP
    far = [min(n - 1, int(length)) for n, length in zip(known.shape, (within * STEP, within), strict=True)]
    lags = [_lags(most, count) for most, count in zip(far, (ALONG_LAGS, ACROSS_LAGS), strict=True)]
    size = [fft.next_fast_len(n + most, real=True) for n, most in zip(known.shape, far, strict=True)]
    inside = fft.rfft2(known.astype(np.float32), size)
    pairs = fft.irfft2(np.abs(inside) ** 2, size)
    # By products, and by half the squared differences: these tell more of what is known only here and there, those of all else.
    products, unlike = np.zeros_like(pairs), np.zeros_like(pairs)
    for plane in np.moveaxis(np.where(known[..., None], values, 0), 2, 0) / np.float32(np.sqrt(values.shape[2])):
        spectrum, squares = fft.rfft2(plane, size), fft.rfft2(plane**2, size)
        products += fft.irfft2(np.abs(spectrum) ** 2, size)
        unlike += fft.irfft2((squares * inside.conj()).real, size)
    power = float(products[0, 0] / max(pairs[0, 0], 1.0))
    unlike -= products
    row, column = (grid.ravel() for grid in np.meshgrid(lags[0], [*lags[1], *-lags[1][1:]], indexing="ij"))
    counts = pairs[row, column]
    told = (counts >= FEWEST_PAIRS) & ((row != 0) | (column != 0))
    row, column, counts = row[told], column[told], counts[told]
    if len(row) < len(along):
        return Covariance(
            along, across, np.full(len(along), (1 - LEAST_NOISE) * power / len(along)), LEAST_NOISE * power
        )
    wanted = (power + (products - unlike)[row, column] / counts) / 2
    gaussians = np.exp(-0.5 * ((row[:, None] / along) ** 2 + (column[:, None] / across) ** 2))
    trust = np.sqrt(counts) / (1 + np.hypot(row, ACROSS_WEIGHT * column))
    variance = optimize.nnls(gaussians * trust[:, None], wanted * trust)[0]
    return Covariance(along, across, variance, max(power - float(variance.sum()), LEAST_NOISE * power))


def _lags(most: int, count: int) -> NDArray[np.int64]:
    """Lags up to ``most``, farther and farther apart."""
    beyond = np.geomspace(CLOSE_LAGS, max(most, CLOSE_LAGS), count)
    lags = np.unique(np.round(np.concatenate([np.arange(CLOSE_LAGS), beyond])).astype(np.int64))
    return lags[lags <= most]
