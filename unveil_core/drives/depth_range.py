"""The depth range that all scenes have in common."""

from __future__ import annotations

__all__ = ["FAR_M", "NEAR_M"]

NEAR_M, FAR_M = 0.2, 100.0
"""Near plane; and the far limit of the distortion loss, which is also the depth assigned to the sky. Metres."""
