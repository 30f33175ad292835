"""Smooth interpolation of scattered pixels: averages over coarser and coarser grids, and back.

Gortler et al., *The Lumigraph* (SIGGRAPH 1996), section 3.4.2: linear in the number of pixels, however far there is to go.
"""

from __future__ import annotations

import cv2
import numpy as np

from unveil_core.base.types import Float32

__all__ = ["pull_push"]

ENOUGH = 0.25
"""Weight of a cell, of that of one all known, from which on it needs nothing of the coarser grid. Of 0.1 to 0.5 all give the same
but for cells at the border of what is known."""
NOTHING = np.float32(1e-9)
"""Least weight that is divided by."""
MOST_LEVELS = 10
"""Grids at most: a thousand pixels across become one."""


def pull_push(values: Float32, weight: Float32, first: int = 0) -> Float32:
    """(H, W, C) known values, carried smoothly to where none are.

    Args:
        values: (H, W, C); weight: (H, W) in [0, 1], 0 where nothing is known.
        first: grids that are only averaged over: the result is smooth over 2 ** first pixels, known pixels among them.
    """
    sums: list[Float32] = [(values * weight[..., None]).astype(np.float32)]
    weights: list[Float32] = [weight.astype(np.float32)]
    while min(weights[-1].shape) > 1 and len(weights) < MOST_LEVELS:
        rows, columns = ((n + 1) // 2 for n in weights[-1].shape)
        sums.append(cv2.pyrDown(sums[-1]).reshape(rows, columns, -1))  # type: ignore[arg-type]
        weights.append(cv2.pyrDown(weights[-1]))  # type: ignore[arg-type]
    first = min(first, len(weights) - 1)
    found = _mean(sums[-1], weights[-1])
    for total, known in zip(reversed(sums[first:-1]), reversed(weights[first:-1]), strict=True):
        share = np.clip(known / ENOUGH, 0, 1).astype(np.float32)[..., None]
        found = share * _mean(total, known) + (1 - share) * _enlarged(found, known.shape)
    return _enlarged(found, weight.shape) if first else found


def _mean(total: Float32, weight: Float32) -> Float32:
    mean: Float32 = (total / np.maximum(weight, NOTHING)[..., None]).astype(np.float32)
    return mean


def _enlarged(plane: Float32, shape: tuple[int, ...]) -> Float32:
    larger: Float32 = cv2.resize(plane, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR).reshape(*shape, -1)
    return larger
