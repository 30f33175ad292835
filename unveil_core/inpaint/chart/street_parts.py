"""Parts of a chart that are one street each: after a corner, kerb, lanes and sidewalk lie at other lateral offsets."""

from __future__ import annotations

import numpy as np

from unveil_core.base.types import Float64
from unveil_core.ground.path import StreetPath

__all__ = ["parts_between_corners"]

CORNER_RADIUS_M, CORNER_DEGREES = 20.0, 45.0
"""Radius of the path under which it turns a corner, metres, and by how much it does then. Corners of junctions are driven on 7 to
15 m; streets with houses bend on 30 m and more, and their kerbs with them."""
AROUND_M = 1.5
"""Half length of the stretch over which the radius is read, metres: half a step between frames."""
LEAST_M = 5.0
"""Shortest part along the street, metres: of less there is no lateral profile."""


def parts_between_corners(path: StreetPath, s: Float64) -> list[slice]:
    """Runs of rows before, between and after corners; one of all rows where the path turns none. The rows of a corner are in none.

    Args:
        s: (A,) arc lengths of the rows, evenly spaced.
    """
    rows = len(s)
    heading = path.heading_at(s)
    half = max(1, round(AROUND_M / (s[1] - s[0]))) if rows > 1 else 1
    here = np.arange(rows)
    before, after = np.maximum(here - half, 0), np.minimum(here + half, rows - 1)
    curvature = (heading[after] - heading[before]) / np.maximum(s[after] - s[before], 1e-9)
    # One corner turns one way: two in a row are two.
    turning = np.where(np.abs(curvature) > 1 / CORNER_RADIUS_M, np.sign(curvature), 0)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], turning, [0]])))
    corners = [
        (first, last)
        for first, last in zip(edges, edges[1:], strict=False)
        if turning[first] and abs(heading[last - 1] - heading[first]) > np.radians(CORNER_DEGREES)
    ]
    starts, ends = [0, *(last for _, last in corners)], [*(first for first, _ in corners), rows]
    least = 0 if not corners else LEAST_M / max(s[1] - s[0], 1e-9)
    return [slice(int(a), int(b)) for a, b in zip(starts, ends, strict=True) if b - a > least]  # type: ignore[call-overload]
