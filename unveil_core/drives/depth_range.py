"""The depth range that all scenes have in common."""

from __future__ import annotations

__all__ = ["ASKED_M", "FARTHEST_M", "FAR_M", "NEAR_M"]

NEAR_M, FAR_M = 0.2, 100.0
"""Near plane; and the far limit of the distortion loss, which is also the depth assigned to the sky. Metres."""
FARTHEST_M = 1000.0
"""Depth up to which what no point measures is looked for and planted, metres: the far end of a street and the skyline. What is
planted at 100 m and stands at 300 m shifts by 50 pixels of a picture 768 wide while the camera moves 15 m, and is blurred by that;
from 1000 m on it shifts by 7 pixels at the most. Of a KITTI street 1000 m are worth 1.1 dB on hidden parts, 100 m beside it."""
ASKED_M = 2 * FAR_M
"""Distance from which on a frame is not asked about a place, a point or the sky, metres: no surface is rendered beyond half of it,
and the time of a long drive must not grow with the square of its length."""
