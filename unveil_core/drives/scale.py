"""Lengths that all scenes have in common."""

from __future__ import annotations

__all__ = ["FAR_M", "NEAR_M"]

NEAR_M, FAR_M = 0.2, 100.0
"""Nearest depth that is rendered or counts as seen, and where the range that distortion is measured in ends; the sky is taken to
be as far away, metres."""
