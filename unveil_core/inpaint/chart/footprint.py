"""Where removed objects stand: their footprints on the chart, from the surfels that were theirs."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.mechanisms import on
from unveil_core.base.types import Mask
from unveil_core.inpaint.chart.street_chart import OBSERVED, StreetChart

__all__ = ["footprint_of"]

LOWEST_M, HIGHEST_M = -0.5, 2.5
"""Heights over the ground between which an object's surfels say where it stands, metres: not the roof of a lorry, nor strays below
the road."""
LONGEST_M = 6.0
"""Length from which on an object gets a hull for each so long piece of it, metres: longer than a car, it is an articulated lorry in
a bend, or several that touch."""
WIDEST_M = 2.6
"""Width of the widest vehicle, metres."""
JOIN_M = 0.3
"""Side of the gaps that are closed between texels of an object before its parts are compared, metres. Chosen on the two sample
streets."""
LEAST_PART_M2, LEAST_PART = 0.15, 0.25
"""Smallest area of a part of an object that counts for its hull, square metres and as a share of the largest: strays would stretch
it. Chosen on the two sample streets."""


def footprint_of(
    chart: StreetChart, removed: Sequence[NDArray[np.float64]], loose: NDArray[np.float64] | None = None
) -> NDArray[np.bool_]:
    """(A, B) texels that removed objects stand on: the hull of each object's low surfels, of a long one's piece by piece. Ground
    that frames show is only part of it between an object's sides, under a lorry: what they show between two cars that pass for
    one, or behind one, is street.

    Args:
        removed: (M, 3) positions of each object's surfels; loose: (L, 3) of those that belong to none and have no hull.
    """
    footprint, unseen = np.zeros(chart.source.shape, dtype=np.uint8), chart.source != OBSERVED
    across = np.ones((1, int(WIDEST_M / chart.texel)), np.uint8)
    if loose is not None:
        texels = _low_texels(chart, loose)
        footprint |= texels & _dense(texels, chart.texel, 0.0)
    for means in removed:
        texels = _low_texels(chart, means)
        if np.count_nonzero(texels) < 3 or not on("footprint_hulls"):
            footprint |= texels
            continue
        dense = _dense(texels, chart.texel)
        rows, columns = np.nonzero(dense)
        hull = np.zeros_like(footprint)
        for inside in _pieces(rows, LONGEST_M / chart.texel):
            if np.count_nonzero(inside) >= 3:
                corners = cv2.convexHull(np.stack([columns[inside], rows[inside]], axis=1).astype(np.int32))
                cv2.fillConvexPoly(hull, corners, 1)
        between = cv2.morphologyEx(dense.astype(np.uint8), cv2.MORPH_CLOSE, across)
        footprint |= texels | (hull & (between | unseen))
    return footprint.astype(bool)


def _low_texels(chart: StreetChart, means: NDArray[np.float64]) -> NDArray[np.uint8]:
    """(A, B) texels over which surfels (M, 3) of an object lie low enough to tell where it stands."""
    texels = np.zeros(chart.source.shape, dtype=np.uint8)
    street = chart.ground.path.to_street(means)
    above = chart.ground.over(street)
    row, column, on_chart = chart.index_of(street)
    low = on_chart & (above < HIGHEST_M) & (above > LOWEST_M)
    texels[row[low], column[low]] = 1
    return texels


def _dense(texels: NDArray[np.uint8], texel: float, least_part: float = LEAST_PART) -> Mask:
    """(A, B) of an object's texels those with company: strays would stretch its hull.

    Args:
        least_part: share of the largest part that a part must have.
    """
    closed = cv2.morphologyEx(texels, cv2.MORPH_CLOSE, np.ones((2 * int(JOIN_M / texel) + 1,) * 2, np.uint8))
    count, component, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    areas = stats[:, cv2.CC_STAT_AREA] * texel**2
    least = max(LEAST_PART_M2, least_part * areas[1:].max(initial=0.0))
    return np.isin(component, [k for k in range(1, count) if areas[k] > least])


def _pieces(rows: NDArray[np.int64], longest: float) -> list[Mask]:
    """Which texels (N,), by their rows along the street, belong to each piece of an object; pieces of a long one overlap by
    half, so that none ends where it is widest."""
    if not len(rows) or np.ptp(rows) < longest:
        return [np.ones(len(rows), dtype=bool)]
    starts = np.arange(rows.min(), rows.max(), longest / 2)
    return [(rows >= start) & (rows <= start + longest) for start in starts]
