"""The record of a projected surfel, as project writes it and the tile kernels read it: one float32 per name."""

from __future__ import annotations

SIZE = 24
"""One and a half cache lines: in an array that begins at one, each record lies in two, wherever it is."""
CX, CY, IZ, A0, B0, A1, B1, A2, B2, OPACITY = range(10)
"""Projected mean, 1 / depth, the intersection's A and (a2, b2), opacity."""
RED, GREEN, BLUE, NX, NY, NZ, Z, LABEL_LOW = range(10, 18)
"""Colour, normal in the camera's frame, depth; and eight times the label plus ``low``."""
EX, EY, E0, E1, E2, REST = range(18, 24)
"""What it can reach: the ellipse ``|(e0 x + e1 y, e2 y)| <= 1`` about (ex, ey), or a circle of squared radius ``low``
about the projected mean; and the rounding residual of the projected mean."""

LOW_RANGE = 8.0
"""Over the greatest ``low``."""

REST_UNIT, REST_BASE = 2.5e-7, 4096.0
"""Unit and base of ``rest``, the fixed-point rounding residual of (cx, cy), packed as x times the base plus y.

In the middle of a photograph float32 resolves a coordinate to 3e-5 pixels, and a disc seen edge-on is thinner than 0.01 pixels:
without the residual its gradients are off by 1e-4."""
REST_MAX = 2047.0
