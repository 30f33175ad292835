"""The record of a projected surfel, as project writes it and the tile kernels read it: one float32 per name."""

from __future__ import annotations

__all__ = [
    "RECORD", "R_A0", "R_A1", "R_A2", "R_B0", "R_B1", "R_B2", "R_BLUE", "R_CX", "R_CY", "R_E0", "R_E1", "R_E2", "R_EX",
    "R_EY", "R_GREEN", "R_IZ", "R_LABEL", "R_LOW", "R_NX", "R_NY", "R_NZ", "R_OPACITY", "R_RED", "R_Z",
]  # fmt: skip

RECORD = 24
R_CX, R_CY, R_IZ, R_A0, R_B0, R_A1, R_B1, R_A2, R_B2, R_OPACITY = range(10)
"""Projected mean, 1 / depth, the intersection's A and (a2, b2), opacity."""
R_RED, R_GREEN, R_BLUE, R_NX, R_NY, R_NZ, R_Z, R_LABEL = range(10, 18)
"""Colour, normal in the camera's frame, depth, label."""
R_EX, R_EY, R_E0, R_E1, R_E2, R_LOW = range(18, 24)
"""What it can reach: the ellipse ``|(e0 x + e1 y, e2 y)| <= 1`` about (ex, ey), or a circle of squared radius ``low``
about the projected mean."""
