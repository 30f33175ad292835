"""Which frames are compared: neighbours, and places that the camera comes back to."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from unveil_core.base.types import Float64
from unveil_core.solve.looks.thumbs import Thumbs

__all__ = ["frame_pairs", "loops_of"]

NEAR = 5
"""Following frames that each one is compared with; farther ones at powers of two, for slow cameras."""
FAR = (8, 16, 32)
LOOP_APART = 40
"""Frames that lie between two of one place at least, for it to be a return."""
LOOP_LIKENESS = 0.8
"""Correlation of two tiny pictures of one place: streets look alike, and false ones cost only time."""
LOOPS_EACH, LOOP_EVERY = 2, 4
"""Returns that are tried for each so many-th frame."""
TINY_PX = 16


def frame_pairs(count: int) -> list[tuple[int, int]]:
    """Pairs of neighbours among so many frames in order."""
    steps = [s for s in (*range(1, NEAR + 1), *FAR) if s < count]
    return [(a, a + step) for step in steps for a in range(count - step)]


def loops_of(thumbs: Thumbs, frames: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs of places in ``frames`` that look as if the camera had come back, as positions in it."""
    if len(frames) <= LOOP_APART:
        return []
    tiny = np.stack([_tiny(thumbs.pictures[i]) for i in frames])
    alike = tiny @ tiny.T
    found = []
    for a in range(0, len(frames), LOOP_EVERY):
        row = alike[a].copy()
        row[: a + LOOP_APART] = -1
        for b in np.argsort(-row)[:LOOPS_EACH]:
            if row[b] > LOOP_LIKENESS:
                found.append((a, int(b)))
    return found


def _tiny(picture: np.ndarray) -> Float64:
    small = cv2.resize(picture, (TINY_PX, TINY_PX), interpolation=cv2.INTER_AREA).astype(np.float64)
    high = small - cv2.GaussianBlur(small, (0, 0), 4)
    size = float(np.linalg.norm(high))
    return np.asarray(high.ravel() / size if size > 0 else high.ravel())
