"""Sharpness of delivered frames: what the footage of other frames, or another piece of the same ground, shows finer than the
clean frame of working size.

A clean frame is right in place and colour, but no sharper than the working size. A source shows the same in full detail, but a few
pixels off, in another light. So coarse structure is taken from the clean frame, and what is finer from the source.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import masked_blur

__all__ = ["FINER_THAN", "high_band", "merged_sources", "with_detail"]

FINER_THAN = 3.0
"""Structure up to so many pixels of working size wide (standard deviation of a Gaussian) is taken from sources: rendered surfels
are that soft."""
ALIKE = 0.06
"""Difference in colour, levels from 0 to 1, up to which a source shows the same as the clean frame, none at twice as much: else
what it shows is something else."""
SMOOTH_PX = 6.0
"""Pixels of working size over which the choice between sources is smoothed: grain of one source side by side with that of another
shows."""


def merged_sources(pictures: Sequence[Float32], qualities: Sequence[Float32], scale: float) -> tuple[Float32, Mask]:
    """One picture of several: at each pixel the best source around it that shows it.

    Args:
        pictures: (H, W, 3) of each source; qualities: (H, W) of each, 0 where it does not show the place.
        scale: pixels of the footage to one of working size.
    Returns:
        (H, W, 3), and (H, W) bool where any source shows it.
    """
    shape = pictures[0].shape
    merged, best = np.zeros(shape, np.float32), np.zeros(shape[:2], np.float32)
    for picture, quality in zip(pictures, qualities, strict=True):
        smooth = cv2.blur(quality, (2 * round(SMOOTH_PX * scale / 2) + 1,) * 2)
        wins = (quality > 0) & (1e-3 + smooth > best)
        merged[wins] = picture[wins]
        best[wins] = 1e-3 + smooth[wins]
    return merged, best > 0


def with_detail(base: Float32, source: Float32, shown: Mask, scale: float) -> tuple[Float32, Float32]:
    """A clean frame with the detail of a source.

    Args:
        base: (H, W, 3) the clean frame, enlarged; source: (H, W, 3); shown: (H, W) bool, where the source shows the place.
        scale: pixels of the footage to one of working size.
    Returns:
        (H, W, 3), and (H, W) in [0, 1] how far the source was believed.
    """
    difference = masked_blur(base - source, shown, FINER_THAN * scale)
    apart = np.abs(difference).max(axis=2)
    believed = np.clip(2.0 - apart / ALIKE, 0, 1).astype(np.float32) * shown
    sharp = source + difference
    return base + believed[..., None] * (sharp - base), believed


def high_band(picture: Float32, known: Mask, sigma: float) -> Float32:
    """(H, W, 3) what of a picture is finer than a Gaussian of ``sigma`` pixels, 0 where it is not ``known`` (H, W)."""
    return np.where(known[..., None], picture - masked_blur(picture, known, sigma), 0).astype(np.float32)
