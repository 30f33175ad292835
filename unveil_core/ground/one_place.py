"""Whether street coordinates name each place once: inside of a sharp bend, and where a way comes back to itself, they do not.

There two pairs of arc length and lateral offset are one place, and of a chart in these coordinates one texel shows what belongs to
the other.
"""

from __future__ import annotations

import numpy as np

from unveil_core.base.types import Float64, Mask
from unveil_core.ground.path import EXTENSION_M, StreetPath

__all__ = ["LEAST_OWN", "goes_round", "limited_to_own", "share_of_own"]

OWN_M = 0.5
"""A place is its own whose coordinates come back as they were to so many metres: two nodes of the path."""
STEP_S_M, STEP_T_M = 0.5, 0.25
"""Distances of the places that are tried, along the street and across, metres."""
HALF_WIDTH_M = 8.0
"""Half the width over which a path is judged, metres: two lanes, the parked cars and a sidewalk on either side."""
LEAST_OWN = 0.8
"""Share of its places that must be their own for a path to be a street's. A quarter turn of 6 m radius has 0.97 and a half turn
0.86; a half turn of 4 m has 0.74, an orbit of 4 m 0.68: there one side lies in the other."""
ROUND_RAD, ROUND_M = np.radians(270.0), 25.0
"""A way that turns by more than the first, on circles of less than the second in the mean, goes round something. Round a block
of houses the mean radius is above 30 m, of a roundabout one seldom drives more than half."""


def _own(path: StreetPath, s: Float64, t: Float64) -> Mask:
    """Whether street coordinates (N,) and (N,) are those that their places have."""
    street = np.stack([s, t, np.zeros_like(s)], axis=1)
    back = path.to_street(path.to_world(street))
    own: Mask = np.abs(back[:, :2] - street[:, :2]).max(axis=1) < OWN_M
    return own


def share_of_own(path: StreetPath) -> float:
    """Share of the places beside the driven part of a path, 0 to 1, that have one pair of street coordinates."""
    length = path.step * (len(path.nodes) - 1)
    first, last = path.start + EXTENSION_M, path.start + length - EXTENSION_M
    s, t = np.meshgrid(
        np.arange(first, max(first + STEP_S_M, last), STEP_S_M),
        np.arange(-HALF_WIDTH_M, HALF_WIDTH_M + STEP_T_M, STEP_T_M),
        indexing="ij",
    )
    return float(_own(path, s.ravel(), t.ravel()).mean())


def goes_round(path: StreetPath) -> bool:
    """Whether the driven part of a path goes round something, as an orbit does."""
    cut = round(EXTENSION_M / path.step)
    driven = path.heading[cut : len(path.heading) - cut]
    turned = float(np.abs(np.diff(driven)).sum())
    return turned > ROUND_RAD and len(driven) * path.step / turned < ROUND_M


def limited_to_own(path: StreetPath, s: Float64, t_min: Float64, t_max: Float64) -> tuple[Float64, Float64]:
    """Lateral limits (A,) and (A,) drawn in until all between them are their own places.

    Args:
        s: (A,) arc lengths; t_min, t_max: (A,) limits there.
    """
    low, high = float(t_min.min()), float(t_max.max())
    count = max(2, round((high - low) / STEP_T_M) + 1)
    t = np.linspace(low, high, count)
    rows, across = np.meshgrid(s, t, indexing="ij")
    own = _own(path, rows.ravel(), across.ravel()).reshape(rows.shape)
    # From the path outwards to the first place that is another's.
    foreign_right = np.where(own | (across > 0), -np.inf, across).max(axis=1)
    foreign_left = np.where(own | (across < 0), np.inf, across).min(axis=1)
    step = (high - low) / (count - 1)
    return np.maximum(t_min, foreign_right + step), np.minimum(t_max, foreign_left - step)
