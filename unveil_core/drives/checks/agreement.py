"""How well poses, photographs and points agree: by what two photographs show both, and how near points lie to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from unveil_core.base.types import Float64
from unveil_core.drives.checks.matches import MatchedPair, places, share_explained
from unveil_core.geometry.camera import Camera

__all__ = ["FEWEST_POINTS", "RIGHT", "Agreement", "agreement", "tree_of"]

RIGHT = 0.8
"""Share of the matches that right poses explain at least: they explain 0.8 to 1, others mostly below 0.3, and up to 0.8 where the
camera looks to the side or straight along a straight way."""
FEWEST_POINTS = 50
FEWEST_PLACES = 12
"""Of a pair, to be asked how near the points are."""


@dataclass(frozen=True, eq=False)
class Agreement:
    """Of one reading of poses and lenses.

    Attributes:
        share: of the matches that lie before both cameras where their rays meet; None where no pair tells.
        where: (N, 3) where these lie.
        depth: (N,) of them, from a camera.
        apart: distance of the nearest point as a share of that depth, the median over all; right ones have 0.01 to 0.05. None where
            too few lie anywhere, or there are no points.
        nearest: the same of the pair where it is smallest.
    """

    share: float | None
    where: Float64
    depth: Float64
    apart: float | None
    nearest: float | None

    def puts_right(self, other: Agreement, *, near: float = 0.06, times: float = 4.0) -> bool:
        """Whether what photographs show lies at the points by this reading, and clearly does not by another."""
        if self.apart is None or (self.share or 0.0) < RIGHT:
            return False
        return self.apart < near and (other.apart is None or self.apart * times < other.apart)


def tree_of(points: Float64) -> cKDTree | None:
    """For :func:`agreement`, of points (P, 3); None of too few."""
    return cKDTree(points) if len(points) >= FEWEST_POINTS else None


def agreement(pairs: Sequence[MatchedPair], camera_of: Callable[[int], Camera], tree: cKDTree | None) -> Agreement:
    """How well pairs of photographs, their cameras by number and the points agree."""
    shown = [places(p, camera_of(p.first), camera_of(p.second)) for p in pairs]
    shown = [s for s in shown if len(s[0]) >= FEWEST_PLACES]
    where = np.concatenate([w for w, _ in shown]) if shown else np.zeros((0, 3))
    depth = np.concatenate([d for _, d in shown]) if shown else np.zeros(0)
    apart = nearest = None
    if tree is not None and shown:
        shares = [tree.query(w)[0] / d for w, d in shown]
        apart, nearest = float(np.median(np.concatenate(shares))), min(float(np.median(s)) for s in shares)
    return Agreement(share_explained(pairs, camera_of), where, depth, apart, nearest)
