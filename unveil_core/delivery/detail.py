"""Sharpness of delivered frames: what the footage of other frames, or another piece of the same ground, shows finer than the
clean frame of working size.

A clean frame is right in place and colour, but no sharper than the working size. A source shows the same in full detail, but a few
pixels off, in another light. So coarse structure is taken from the clean frame, and what is finer from the source. How far both
are apart, and which source is the best, is coarse structure itself: it is found at working size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.parallel import in_parallel
from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.delivery.kernels import CHUNK, detail_between, without_edges
from unveil_core.geometry.images import masked_blur

__all__ = ["FINER_THAN", "BestSource", "Detail", "grain_of", "sensor_noise"]

FINER_THAN = 3.0
"""Structure up to so many pixels of working size wide (standard deviation of a Gaussian) is taken from sources: rendered surfels
are that soft."""
ALIKE = 0.06
"""Difference in colour, levels from 0 to 1, up to which a source shows the same as the clean frame, none at twice as much: else
what it shows is something else."""
SMOOTH_PX = 6.0
"""Pixels of working size over which the choice between sources is smoothed: grain of one source side by side with that of another
shows."""
QUIET, NOISE_PX = 30, 0.8
"""Percentile of the local contrast of a photograph that is noise alone, and the width of that noise, pixels: Bayer patterns and
JPEG blocks leave no single pixels."""
EDGE = 2.5
"""Times the median of the absolute contrast beyond which fine contrast belongs to an edge."""
LEAST_SIGMA = 2.0
"""Pixels, of a Gaussian after whose picture was made smaller: pixels of that then are a quarter of its width."""
SAMPLES = 1 << 17
"""Pixels, evenly chosen, of which medians and percentiles are taken."""


@dataclass(frozen=True, eq=False)
class Detail:
    """Where detail of a clean frame comes from, at working size.

    Attributes:
        source: (h, w) number of the source, -1 where none shows the place.
        difference: (h, w, 3) from what it shows to the clean frame's coarse colours.
        believed: (h, w) in [0, 1], how far it shows the same; 0 without a source.
    """

    source: NDArray[np.int32]
    difference: Float32
    believed: Float32

    def at(self, positions: Float64) -> tuple[NDArray[np.int32], Float32, Float32]:
        """The source of the nearest pixel to positions (N, 2), (N,), and between pixels that have it the difference (N, 3) and how
        far it is believed (N,)."""
        count = len(positions)
        source, difference = np.empty(count, np.int32), np.empty((count, 3), np.float32)
        believed = np.empty(count, np.float32)
        planes = (self.source, self.difference, self.believed)
        in_parallel(detail_between, count, CHUNK, positions, *planes, source, difference, believed)
        return source, difference, believed


class BestSource:
    """The best of several sources at each pixel, fed one after the other.

    Args:
        clean: (h, w, 3) the clean frame, of working size, in [0, 1].
    """

    def __init__(self, clean: Float32) -> None:
        shape = clean.shape[:2]
        self._clean, self._best = clean, np.zeros(shape, np.float32)
        self.found = Detail(np.full(shape, -1, np.int32), np.zeros_like(clean), np.zeros(shape, np.float32))

    def add(self, number: int, picture: Float32, quality: Float32) -> None:
        """Take what a source shows better than those before.

        Args:
            number: of the source; picture: (h, w, 3) what it shows, no finer than the clean frame.
            quality: (h, w), how finely its footage shows the place, 0 = not at all.
        """
        shown = quality > 0
        difference = masked_blur(self._clean - picture, shown, FINER_THAN)
        apart = np.abs(difference)
        apart = np.maximum(np.maximum(apart[..., 0], apart[..., 1]), apart[..., 2])
        believed = np.clip(2.0 - apart / np.float32(ALIKE), 0, 1) * shown
        side = 2 * round(SMOOTH_PX / 2) + 1
        value = cv2.blur(quality * believed, (side, side)) * (believed > 0)
        wins = value > self._best
        found = self.found
        found.source[wins], found.difference[wins], found.believed[wins] = number, difference[wins], believed[wins]
        self._best[wins] = value[wins]


def grain_of(picture: NDArray[Any], sigma: float) -> Float32:
    """(H, W) luminance that is finer than a Gaussian of ``sigma`` pixels, in [0, 1], without edges: these are no grain.

    Args:
        picture: as a file has it: grey, colour or with transparency, 8 or 16 bits, or a plate's float32.
    """
    band = _finer(_gray(picture), sigma)
    strength = cv2.blur(np.abs(band), (2 * round(sigma) + 1,) * 2)
    usual = max(EDGE * float(np.median(_some(strength.ravel()))), 1e-6)  # most of a letterboxed picture has none at all
    in_parallel(without_edges, band.size, CHUNK, band.ravel(), strength.ravel(), np.float32(usual))
    return band


def sensor_noise(picture: NDArray[Any], known: Mask, scale: float, *, seed: int) -> Float32:
    """(H, W) noise like that of the photograph where it shows next to nothing: a sensor's, as compression left it.

    Args:
        picture: as for :func:`grain_of`; known: (H, W) bool, pixels of the photograph itself.
        scale: pixels of the footage to one of working size: what is coarser is in the clean frame.
    """
    band = np.abs(_finer(_gray(picture), max(0.8, scale)))
    strength = cv2.blur(band, (2 * round(scale) + 3,) * 2)
    level = float(np.percentile(_some(strength[known]), QUIET)) if known.any() else 0.0
    noise = np.random.default_rng(seed).standard_normal(known.shape, dtype=np.float32)
    noise = cv2.GaussianBlur(noise, (0, 0), NOISE_PX)
    mean = float(np.abs(_some(noise.ravel())).mean())
    noise *= np.float32(level / max(mean, 1e-9))
    return noise


def _gray(picture: NDArray[Any]) -> Float32:
    """(H, W) luminance in [0, 1] of a file's picture."""
    most = 1.0 if picture.dtype == np.float32 else np.iinfo(picture.dtype).max
    values = np.ascontiguousarray(picture, dtype=np.float32)
    if values.ndim == 3:
        values = cv2.cvtColor(values, cv2.COLOR_RGBA2GRAY if values.shape[2] == 4 else cv2.COLOR_RGB2GRAY)
    if most != 1.0:
        values = (
            values * np.float32(1.0 / most)
            if values is picture
            else np.multiply(values, np.float32(1.0 / most), out=values)
        )
    return values


def _finer(gray: Float32, sigma: float) -> Float32:
    """(H, W) what of a picture (H, W) is finer than a Gaussian of ``sigma`` pixels. A wide one is taken of a smaller picture, which
    shows all that it lets through."""
    factor = max(1, int(sigma / LEAST_SIGMA))
    if factor == 1:
        coarse = cv2.GaussianBlur(gray, (0, 0), sigma)
    else:
        height, width = gray.shape
        small = cv2.resize(gray, (-(-width // factor), -(-height // factor)), interpolation=cv2.INTER_AREA)
        coarse = cv2.resize(
            cv2.GaussianBlur(small, (0, 0), sigma / factor), (width, height), interpolation=cv2.INTER_LINEAR
        )
    return cv2.subtract(gray, coarse)


def _some(values: Float32) -> Float32:
    """Some of many values (N,), evenly chosen."""
    return values[:: max(1, len(values) // SAMPLES)]
