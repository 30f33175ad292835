"""The depth range that all scenes have in common."""

from __future__ import annotations

__all__ = ["ASKED_M", "FAR_M", "NEAR_M"]

NEAR_M, FAR_M = 0.2, 100.0
"""Near plane; and the far limit of the distortion loss, which is also the depth assigned to the sky. Metres."""
ASKED_M = 2 * FAR_M
"""Distance from which on a frame is not asked about a place, a point or the sky, metres: no surface is rendered beyond half of it,
and the time of a long drive must not grow with the square of its length."""
