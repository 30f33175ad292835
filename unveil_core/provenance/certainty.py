"""How sure a pixel is: the expectation that it is right, from where it comes from and what speaks against it.

A pixel is *right* if its smoothed colour is less than ``RIGHT_LEVELS`` from that of the true empty street. The expectation is a
logistic function for each origin: a constant, less a weight times each doubt. No weight is negative, so no doubt makes surer.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask, Picture
from unveil_core.geometry.images import smoothed
from unveil_core.inpaint.origin import CONTINUED, INVENTED, RELIT, SEEN_ELSEWHERE

__all__ = ["CERTAIN", "MODELS", "ORIGINAL_LEVEL", "RIGHT_LEVELS", "certainty_levels", "expected_right", "right_pixels"]

RIGHT_LEVELS = 12.0
"""Root mean square of the channels, levels of 255: half of what passes as another shade of the street (``evaluate.detail``)."""
ORIGINAL_LEVEL = 255
"""Level of a pixel that is the photograph's. All others have at most one less."""
MODELS: dict[int, tuple[float, ...]] = {
    RELIT: (4.856, 0.0, 0.471, 0.0, 0.521, 0.0, 0.381, 0.322, 0.0, 0.004),
    SEEN_ELSEWHERE: (4.508, 0.062, 0.0, 0.132, 0.19, 1.226, 0.0, 1.252, 0.492, 0.041),
    CONTINUED: (3.622, 0.093, 0.0, 0.576, 0.14, 0.582, 0.0, 0.52, 0.273, 0.021),
    INVENTED: (4.752, 0.0, 0.284, 0.236, 0.138, 0.876, 0.0, 2.436, 0.325, 0.209),
}
"""For each origin the constant, and the weights in the order of ``doubts.DOUBTS``."""
CERTAIN = 242
"""Level from which on a pixel is called certain."""


def expected_right(
    origin: NDArray[np.uint8], doubts: Float32, models: dict[int, tuple[float, ...]] = MODELS
) -> Float32:
    """(P,) expectation, 0 to 1, that changed pixels are right.

    Args:
        origin: (P,) of ``inpaint.origin``; doubts: (P, D), see ``doubts``.
    """
    expected = np.ones(len(origin), dtype=np.float32)
    for kind, (constant, *weights) in models.items():
        some = origin == kind
        score = constant - doubts[some] @ np.array(weights, dtype=np.float32)
        expected[some] = 1 / (1 + np.exp(-score))
    return expected


def certainty_levels(expected: Float32) -> NDArray[np.uint8]:
    """Expectations as levels: 254 times as much, rounded."""
    return np.round(np.clip(expected, 0, 1) * (ORIGINAL_LEVEL - 1)).astype(np.uint8)


def right_pixels(delivered: Picture, truth: Picture) -> Mask:
    """(H, W) pixels that are right, of pictures (H, W, 3) in the same exposure."""
    error = np.square(smoothed(delivered) - smoothed(truth)).mean(axis=2)
    right: Mask = error < RIGHT_LEVELS**2
    return right
