"""Which rows of the street's chart some cameras show: of what lies behind them all, nothing need be held."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unveil_core.geometry.camera import Camera
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.street_chart import TEXEL_M

__all__ = ["seen_rows"]

STEP_M, MARGIN_M = 1.0, 3.0
"""Raster of the ground on which cameras are asked, and what is held beyond the first and last place that they show, metres: a
picture is wider than a step where the ground comes into it, and pixels sample half of their footprint around them."""


def seen_rows(ground: Ground, cameras: Sequence[Camera], first: int, end: int) -> tuple[int, int]:
    """The rows from ``first`` up to ``end`` without those at both ends that no camera shows; all if none shows any.

    Args:
        ground: whose chart's rows these are.
    """
    step, margin = round(STEP_M / TEXEL_M), round(MARGIN_M / TEXEL_M)
    rows = np.arange(first, end + step, step)
    across = np.arange(ground.t_min.min(), ground.t_max.max() + STEP_M, STEP_M)
    s, t = np.repeat(ground.s_start + TEXEL_M * rows, len(across)), np.tile(across, len(rows))
    places = ground.path.to_world(np.stack([s, t, ground.height_at(s, t)], axis=1))
    shown = np.zeros(len(rows), dtype=bool)
    for camera in cameras:
        shown[camera.shown(places)[0] // len(across)] = True
    if not shown.any():
        return first, end
    seen = rows[shown]
    return max(int(seen[0]) - margin, first), min(int(seen[-1]) + margin, end)
