"""Tracks: features of several photographs that show one place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from unveil_core.base.types import Float64
from unveil_core.geometry.adjustment.features import Features

__all__ = ["Tracks", "joined_tracks"]


@dataclass(frozen=True, eq=False)
class Tracks:
    """Observations of P places in V photographs.

    Attributes:
        view: (M,) photograph of each observation; point: (M,) place, numbered from 0.
        pixel: (M, 2) float64.
    """

    view: NDArray[np.int64]
    point: NDArray[np.int64]
    pixel: Float64

    @property
    def count(self) -> int:
        """P."""
        return int(self.point.max(initial=-1)) + 1

    def of_points(self, keep: NDArray[np.bool_]) -> Tracks:
        """The observations of places (P,) that are kept, numbered anew."""
        own = keep[self.point]
        return Tracks(self.view[own], (np.cumsum(keep) - 1)[self.point[own]], self.pixel[own])


def joined_tracks(
    features: Sequence[Features], pairs: Sequence[tuple[int, int, NDArray[np.int64]]], *, least: int = 3
) -> Tracks:
    """Matches of pairs of photographs joined to tracks.

    A track that would show one place twice in a photograph is wrong somewhere, and is left out.

    Args:
        features: of all photographs; pairs: two of them and their matches (M, 2).
        least: observations that a track must have: two agree with any pose but across the epipolar line.
    """
    first = np.concatenate([[0], np.cumsum([len(f.pixels) for f in features])])
    total = int(first[-1])
    ends = [(first[i] + m[:, 0], first[j] + m[:, 1]) for i, j, m in pairs if len(m)]
    if not ends:
        return Tracks(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)))
    a, b = (np.concatenate(side) for side in zip(*ends, strict=True))
    graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(total, total))
    _, track = connected_components(graph, directed=False)
    view = np.repeat(np.arange(len(features)), np.diff(first))
    pixel = np.concatenate([f.pixels for f in features])
    length = np.bincount(track)
    seen = np.unique(np.stack([track, view], axis=1), axis=0)[:, 0]
    once = np.bincount(seen, minlength=len(length)) == length
    own = ((length >= least) & once)[track]
    _, point = np.unique(track[own], return_inverse=True)
    return Tracks(view[own], point.ravel().astype(np.int64), pixel[own])
