"""A picture seen through overlapping windows, and what is found in them put together.

The windows are evenly spaced and overlap by a quarter at least. Where they overlap, each counts by sin² of the place in it: next
to nothing at its border, where a network lacks the surroundings, most in its middle. So no seam shows where two windows differ.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from unveil_core.base.types import Float32, Picture

__all__ = ["best_at_size", "blended", "starts"]

LEAST_OVERLAP = 0.25
"""Of a window's side. Less leaves places that are near the border of every window that shows them."""
LEAST_WEIGHT = 1e-3
"""At the very border, so that weights never vanish."""


def starts(length: int, window: int) -> list[int]:
    """Where windows begin along a side, so that they cover it and overlap enough; one where the side is no longer."""
    if length <= window:
        return [0]
    count = int(np.ceil((length - window) / (window * (1 - LEAST_OVERLAP)))) + 1
    return [int(s) for s in np.round(np.linspace(0, length - window, count))]


def blended(picture: Picture, window: tuple[int, int], scores_of: Callable[[Picture], Float32]) -> Float32:
    """(K, H, W) scores of a picture (H, W, 3) from those of its windows.

    Args:
        window: height and width.
        scores_of: gives (K, h, w) for a part (h, w, 3), no larger than the window.
    """
    height, width = picture.shape[:2]
    corners = [(y, x) for y in starts(height, window[0]) for x in starts(width, window[1])]
    if len(corners) == 1:
        return scores_of(picture)
    total: Float32 | None = None
    weights = np.zeros((height, width), dtype=np.float32)
    for y, x in corners:
        part = np.s_[y : min(y + window[0], height), x : min(x + window[1], width)]
        scores = scores_of(picture[part])
        total = np.zeros((len(scores), height, width), dtype=np.float32) if total is None else total
        weight = _bump(scores.shape[1])[:, None] * _bump(scores.shape[2])
        total[:, *part] += scores * weight
        weights[part] += weight
    assert total is not None
    total /= weights
    return total


def _bump(length: int) -> Float32:
    """(length,) weights along a side."""
    place = (np.arange(length, dtype=np.float32) + 0.5) / length
    return (LEAST_WEIGHT + np.sin(np.pi * place) ** 2).astype(np.float32)


def best_at_size(scores: Float32, size: tuple[int, int]) -> np.ndarray:
    """(H, W) int64, which of K scores (K, h, w) is largest once they are enlarged to a size; one at a time, for memory's sake."""
    if scores.shape[1:] == size:
        return np.asarray(scores.argmax(axis=0))
    best = np.zeros(size, dtype=np.int64)
    largest: Float32 | None = None
    for k, plane in enumerate(scores):
        enlarged = cv2.resize(plane, size[::-1], interpolation=cv2.INTER_LINEAR)
        if largest is None:
            largest = enlarged
        else:
            better = enlarged > largest
            best[better] = k
            largest = np.maximum(largest, enlarged)
    return best
