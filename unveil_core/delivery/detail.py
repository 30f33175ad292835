"""Sharpness of delivered frames: what the footage of other frames, or another piece of the same ground, shows finer than the
clean frame of working size.

A clean frame is right in place and colour, but no sharper than the working size. A source shows the same in full detail, but a few
pixels off, in another light. So coarse structure is taken from the clean frame, and what is finer from the source.
"""

from __future__ import annotations

import cv2
import numpy as np

from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import luminance, masked_blur

__all__ = ["FINER_THAN", "BestSource", "grain_of", "sensor_noise", "with_detail"]

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


def with_detail(base: Float32, source: Float32, shown: Mask, scale: float) -> tuple[Float32, Float32]:
    """A clean frame with the detail of a source.

    Args:
        base: (H, W, 3) the clean frame, enlarged; source: (H, W, 3); shown: (H, W) bool, where the source shows the place.
        scale: pixels of the footage to one of working size.
    Returns:
        (H, W, 3) the source in the clean frame's coarse colours, and (H, W) in [0, 1] how far it can be believed.
    """
    difference = masked_blur(base - source, shown, FINER_THAN * scale)
    apart = np.abs(difference).max(axis=2)
    believed = (np.clip(2.0 - apart / ALIKE, 0, 1) * shown).astype(np.float32)
    return source + difference, believed


class BestSource:
    """The best of several sources at each pixel, fed one after the other: a long list of full-size pictures is never held.

    Attributes:
        picture: (H, W, 3); believed: (H, W) in [0, 1], 0 where no source shows the place.
    """

    def __init__(self, base: Float32, scale: float) -> None:
        self.picture, self.believed = base.copy(), np.zeros(base.shape[:2], np.float32)
        self._best, self._scale = np.zeros(base.shape[:2], np.float32), scale

    def add(self, picture: Float32, believed: Float32, quality: Float32) -> None:
        """Take what a source shows better than those before.

        Args:
            picture: (H, W, 3); believed: (H, W), both of :func:`with_detail`; quality: (H, W), how finely it shows the place.
        """
        side = 2 * round(SMOOTH_PX * self._scale / 2) + 1
        value = cv2.blur(quality * believed, (side, side)) * (believed > 0)
        wins = value > self._best
        self.picture[wins], self.believed[wins], self._best[wins] = picture[wins], believed[wins], value[wins]


def grain_of(picture: Float32, sigma: float) -> Float32:
    """(H, W) luminance that is finer than a Gaussian of ``sigma`` pixels, without edges: these are no grain."""
    gray = luminance(picture)
    band = gray - cv2.GaussianBlur(gray, (0, 0), sigma)
    strength = cv2.blur(np.abs(band), (2 * round(sigma) + 1,) * 2)
    usual = max(EDGE * float(np.median(strength)), 1e-6)  # most of a drawn or letterboxed picture has none at all
    clipped: Float32 = np.clip(band, -usual, usual) * np.clip(2 - strength / usual, 0, 1)
    return clipped


def sensor_noise(picture: Float32, known: Mask, scale: float, *, seed: int) -> Float32:
    """(H, W) noise like that of the photograph where it shows next to nothing: a sensor's, as compression left it.

    Args:
        picture: (H, W, 3); known: (H, W) bool, pixels of the photograph itself.
        scale: pixels of the footage to one of working size: what is coarser is in the clean frame.
    """
    gray = luminance(picture)
    band = gray - cv2.GaussianBlur(gray, (0, 0), max(0.8, scale))
    strength = cv2.blur(np.abs(band), (2 * round(scale) + 3,) * 2)
    level = float(np.percentile(strength[known], QUIET)) if known.any() else 0.0
    noise = np.random.default_rng(seed).standard_normal(gray.shape).astype(np.float32)
    noise = cv2.GaussianBlur(noise, (0, 0), NOISE_PX)
    found: Float32 = noise * np.float32(level / max(float(np.abs(noise).mean()), 1e-9))
    return found
