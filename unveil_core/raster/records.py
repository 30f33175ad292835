"""The record of a projected surfel, as project writes it and the tile kernels read it: one float32 per name."""

from __future__ import annotations

SIZE = 24
"""One and a half cache lines: in an array that begins at one, each record lies in two, wherever it is."""
CX, CY, IZ, A0, B0, A1, B1, A2, B2, OPACITY = range(10)
"""Projected mean, 1 / depth, the intersection's A and (a2, b2), opacity."""
RED, GREEN, BLUE, NX, NY, NZ, Z, LABEL = range(10, 18)
"""Colour, normal in the camera's frame, depth, label."""
EX, EY, E0, E1, E2, LOW = range(18, 24)
"""What it can reach: the ellipse ``|(e0 x + e1 y, e2 y)| <= 1`` about (ex, ey), or a circle of squared radius ``low``
about the projected mean."""
