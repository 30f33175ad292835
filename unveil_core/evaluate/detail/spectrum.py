"""The spectrum of a region: how strong its detail is, by octaves of its wavelength.

Bands are differences of Gaussians of the luminance (Burt and Adelson, *The Laplacian pyramid as a compact image code*, 1983), not
subsampled. Gaussians are normalised by the region that they cover (Knutsson and Westin, *Normalized and differential
convolution*, 1993), so that neither its border nor what lies beyond counts.
"""

from __future__ import annotations

import math
from itertools import pairwise

import cv2
import numpy as np

from unveil_core.base.types import Float32, Mask, Picture
from unveil_core.geometry.images import luminance

__all__ = ["BANDS_PX", "Spectrum"]

BANDS_PX = (4, 8, 16)
"""Longest wavelength of each band, pixels; each begins at half of it. Below 2 pixels a picture has none, and above 16 it is no
grain but the course of the light, and what PSNR tells."""
HALF_SIGMA = math.sqrt(2 * math.log(2)) / (2 * math.pi)
"""Standard deviation, in wavelengths, of the Gaussian that halves a wave."""


class Spectrum:
    """The bands of one region in pictures of one size; what only the region tells is found once.

    Args:
        region: (H, W) pixels that count.
    """

    def __init__(self, region: Mask) -> None:
        self._size = region.shape
        rows, columns = (np.flatnonzero(region.any(axis=axis)) for axis in (1, 0))
        self._box = tuple(slice(int(at[0]), int(at[-1]) + 1) if len(at) else slice(0, 0) for at in (rows, columns))
        self._inside = region[self._box].astype(np.float32)
        self._weights = [self._blurred(self._inside, wavelength) for wavelength in BANDS_PX]

    def energies(self, picture: Picture) -> tuple[float, ...]:
        """The energy of each band of ``BANDS_PX`` in a picture (H, W, 3) uint8: squared levels of 255, summed up over the region.

        Raises:
            ValueError: a picture of another size than the region.
        """
        if picture.shape[:2] != self._size:
            raise ValueError(f"a picture of {picture.shape[:2]} does not fit a region of {self._size}")
        if not self._inside.size:
            return (0.0,) * len(BANDS_PX)
        levels = [luminance(picture[self._box].astype(np.float32)) * self._inside]
        for wavelength, weight in zip(BANDS_PX, self._weights, strict=True):
            smooth = self._blurred(levels[0], wavelength) / np.maximum(weight, 1e-6)
            levels.append(smooth * self._inside)
        return tuple(float(np.square(fine - coarse, dtype=np.float64).sum()) for fine, coarse in pairwise(levels))

    def _blurred(self, plane: Float32, wavelength: int) -> Float32:
        """A plane (H, W) without what is finer than a wavelength, zero beyond the picture."""
        if not plane.size:
            return plane
        sigma = HALF_SIGMA * wavelength
        return cv2.GaussianBlur(plane, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT).astype(np.float32, copy=False)
