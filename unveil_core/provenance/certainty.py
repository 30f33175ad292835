"""How sure a pixel is: the expectation that it is right, from where it comes from and what speaks against it.

A pixel is *right* if its smoothed colour is less than ``RIGHT_LEVELS`` from that of the true empty street. For each origin the
expectation is a ceiling times a logistic function: of a constant, less a weight times each doubt. No weight is negative, so no
doubt makes surer.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Mask, Picture
from unveil_core.geometry.images import smoothed
from unveil_core.inpaint.origin import CONTINUED, INVENTED, RELIT, SEEN_ELSEWHERE

__all__ = [
    "CEILINGS",
    "CERTAIN",
    "CERTAIN_RIGHT",
    "MODELS",
    "ORIGINAL_LEVEL",
    "RIGHT_LEVELS",
    "certainty_levels",
    "expected_right",
    "right_pixels",
]

RIGHT_LEVELS = 12.0
"""Root mean square of the channels, levels of 255: half of what passes as another shade of the street (``evaluate.detail``)."""
ORIGINAL_LEVEL = 255
"""Level of a pixel that is the photograph's. All others have at most one less."""
CEILINGS: dict[int, float] = {RELIT: 1.0, SEEN_ELSEWHERE: 1.0, CONTINUED: 0.9, INVENTED: 0.9}
"""Highest expectation: what no frame shows can hold something that nothing tells of, a cover, a line, a shadow. On the
parked street that is so in a tenth of the continued pixels that no doubt speaks against; on the country road in less."""
MODELS: dict[int, tuple[float, ...]] = {
    RELIT: (10.081, 0.353, 0.484, 1.829, 1.367, 0.252, 0.997, 0.457, 0.0, 0.118, 0.227, 0.954),
    SEEN_ELSEWHERE: (6.526, 0.112, 0.0, 1.016, 1.126, 1.008, 0.0, 1.063, 0.51, 0.195, 0.0, 1.489),
    CONTINUED: (5.617, 0.032, 0.079, 1.1, 1.174, 1.248, 0.0, 0.194, 0.233, 0.0, 0.616, 0.211),
    INVENTED: (5.26, 0.411, 0.0, 0.33, 1.363, 1.743, 0.001, 0.731, 0.664, 0.0, 0.077, 0.0),
}
"""For each origin the constant, and the weights in the order of ``doubts.DOUBTS``: fitted by
``benchmarks/streets/certainty.py`` to planted holes of three real drives and to two drawn streets, copied from
``benchmarks/results/certainty.json``."""
CERTAIN, CERTAIN_RIGHT = 230, 0.95
"""Level from which on a pixel is called certain, and the share of such pixels that is right: behind planted cars of three real
drives, each predicted by a fit to the others, on their mean; 93 % on the worst. It is over the ceiling of what no frame shows, so
that is never certain."""


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
        expected[some] = CEILINGS[kind] / (1 + np.exp(-score))
    return expected


def certainty_levels(expected: Float32) -> NDArray[np.uint8]:
    """Expectations as levels: 254 times as much, rounded."""
    return np.round(np.clip(expected, 0, 1) * (ORIGINAL_LEVEL - 1)).astype(np.uint8)


def right_pixels(delivered: Picture, truth: Picture) -> Mask:
    """(H, W) pixels that are right, of pictures (H, W, 3) in the same exposure."""
    error = np.square(smoothed(delivered) - smoothed(truth)).mean(axis=2)
    right: Mask = error < RIGHT_LEVELS**2
    return right
