"""How well an order of frames makes a way: its length, how often it turns back, and the order in which places lie along one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float64

__all__ = ["Way", "along_the_way", "way_of"]

MOST_ORDERED = 2000
"""Frames whose order along the way is looked for: it takes the square of their number."""
MOST_TURNS = 500
"""Pieces of a way that are turned round until it is short: a way that needs more is none."""


@dataclass(frozen=True)
class Way:
    """Attributes:
    length: of all steps, in units of the drive; extent: of its bounding box, corner to corner.
    turning_back: share of steps that lead back from the one before, of those that lead anywhere.
    """

    length: float
    extent: float
    turning_back: float

    @property
    def zigzags(self) -> bool:
        """Whether no vehicle drives so: to and fro, over and over."""
        return self.turning_back > 0.3 and self.length > 2.0 * self.extent > 0.0


def way_of(centres: Float64) -> Way:
    """The way through places (N, 3) in their order."""
    with np.errstate(all="ignore"):
        steps = np.diff(centres, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        extent = float(np.linalg.norm(np.ptp(centres, axis=0))) if len(centres) else 0.0
        moved = steps[lengths > 1e-6 * extent]
        back = float((np.einsum("ij,ij->i", moved[:-1], moved[1:]) < 0).mean()) if len(moved) > 1 else 0.0
    return Way(float(lengths.sum()), extent, back)


def along_the_way(centres: Float64, ahead: Float64) -> NDArray[np.int64] | None:
    """The order in which places lie along a way, found from the places alone.

    From place to the nearest one that is left, then pieces of the way are turned round as long as it gets shorter.

    Args:
        centres: (N, 3) of the cameras; ahead: (N, 3) where they look, which tells the direction of travel.
    Returns:
        (N,) indices; None where there are too few or too many.
    """
    count = len(centres)
    if not 4 <= count <= MOST_ORDERED or not np.isfinite(centres).all():
        return None
    order = _shortened(centres, _from_place_to_place(centres))
    steps = np.diff(centres[order], axis=0)
    forward = float(np.einsum("ij,ij->", steps, ahead[order[:-1]] + ahead[order[1:]]))
    return order if forward >= 0 else order[::-1]


def _from_place_to_place(centres: Float64) -> NDArray[np.int64]:
    here = int(np.argmax(np.linalg.norm(centres - centres.mean(axis=0), axis=1)))
    here = int(np.argmax(np.linalg.norm(centres - centres[here], axis=1)))
    left = np.ones(len(centres), dtype=bool)
    order = [here]
    for _ in range(len(centres) - 1):
        left[here] = False
        far = np.linalg.norm(centres - centres[here], axis=1)
        far[~left] = np.inf
        here = int(np.argmin(far))
        order.append(here)
    return np.array(order, dtype=np.int64)


def _shortened(centres: Float64, order: NDArray[np.int64]) -> NDArray[np.int64]:
    """The order with the piece turned round that shortens the open way most, again and again."""
    for _ in range(MOST_TURNS):
        way = centres[order]
        steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
        # Pieces i..j: the step before i and the one after j are replaced; at the ends there is none.
        before = np.concatenate([[0.0], steps])
        after = np.concatenate([steps, [0.0]])
        best, piece = 1e-9 * float(steps.sum()), None
        worst = np.argsort(-before)[:40]  # a long step is one that is worth replacing
        for i in {0, *worst.tolist()}:
            joined_before = np.linalg.norm(way[i - 1] - way, axis=1) if i > 0 else np.zeros(len(way))
            joined_after = np.concatenate([np.linalg.norm(way[i] - way[1:], axis=1), [0.0]])
            gain = before[i] + after - joined_before - joined_after
            gain[: i + 1] = -np.inf
            j = int(np.argmax(gain))
            if gain[j] > best:
                best, piece = float(gain[j]), (i, j)
        if piece is None:
            break
        i, j = piece
        order = np.concatenate([order[:i], order[i : j + 1][::-1], order[j + 1 :]])
    return order
