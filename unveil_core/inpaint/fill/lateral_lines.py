"""Lines along the street: what a lateral offset has in common for some car lengths, and its neighbours have not."""

from __future__ import annotations

import numpy as np

from unveil_core.base.types import Float32, Mask
from unveil_core.geometry.images import blurred, blurred_over, masked_blur

__all__ = ["lateral_lines"]

BROAD_M = 0.3
"""Standard deviation, metres, of the surroundings that a texel's detail is told from: wider than a painted line or a joint."""
ALONG_M, ACROSS_M = 10.0, 0.05
"""Standard deviations along and across the street over which a line is told, metres: two cars and what is between them; a texel."""
INDEPENDENT_M = 1.0
"""Length along the street from which on another look at an offset tells something new, metres: patches and stains are as long."""


def lateral_lines(color: Float32, known: Mask, texel: float) -> Float32:
    """(A, B, 3) by how much ground differs from that to its left and right because of its lateral offset.

    The mean detail of an offset is shrunk by what it may be by chance (James and Stein, *Estimation with quadratic loss*, 1961):
    what was seen once, or never the same, is no line.

    Args:
        color: (A, B, 3); known: (A, B) where that tells of the ground; texel: side of a texel, metres.
    """
    detail = np.where(known[..., None], color - masked_blur(color, known, BROAD_M / texel), 0).astype(np.float32)
    reach = ALONG_M / texel, ACROSS_M / texel
    # One blurred weight serves for all.
    weight = blurred(known.astype(np.float32), reach)
    mean = blurred_over(detail, weight, reach)
    signal = (mean**2).sum(axis=2)
    power = blurred_over((detail**2).sum(axis=2).astype(np.float32), weight, reach)
    seen = weight / blurred(np.ones((2, known.shape[1]), np.float32), reach)[0]
    looks = np.maximum(seen * (2 * np.sqrt(np.pi) * ALONG_M / INDEPENDENT_M), 1e-3)
    chance = np.maximum(power - signal, 0) / looks
    lines: Float32 = mean * np.clip(1 - chance / np.maximum(signal, 1e-9), 0, 1)[..., None].astype(np.float32)
    return lines
