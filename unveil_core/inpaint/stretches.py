"""A street cut into stretches, whose ground and facades are read and filled one after the other.

What a stretch does not own, it reads as the surroundings of what it owns: the fill at its ends follows from the same texels as that
of its neighbour. Two stretches part where the least is removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from unveil_core.base.types import Float64, Mask
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.reach import centres_of
from unveil_core.ground.blocks import Blocks
from unveil_core.ground.street import Ground
from unveil_core.inpaint.chart.street_chart import READ_M, TEXEL_M, rows_of

__all__ = ["CASTS_M", "Stretch", "cut_street", "seen_rows"]

AROUND_M = 25.0
"""Length beyond its ends that a stretch reads as its surroundings, metres: twice the half length of the widest window in which
medians and shade are taken, see ``fill.chart_fill`` and ``light.scene_light``."""
CASTS_M = 60.0
"""Distance beyond that from which shadows fall into a stretch, metres: of a house of 15 m with the sun 14 degrees high."""
QUIET_M, QUIET_SHARE = 12.0, 0.25
"""How far from the middle between two blocks their stretches may part, metres, over a parked lorry, and as a share of the shorter
block."""
CELL_M, SMOOTHED_M = 0.5, 1.0
"""Resolution at which the quietest place is looked for, and standard deviation of its smoothing, metres."""

ASKED_M, MARGIN_M = 1.0, 3.0
"""Raster of the ground on which cameras are asked, and what is held beyond the first and last place that they show, metres: a
picture is wider than a step where the ground comes into it, and pixels sample half of their footprint around them."""


@dataclass(frozen=True, eq=False)
class Stretch:
    """A piece of the street.

    Attributes:
        number: of its block.
        own: indices of the frames that are cleaned with it; frames: of those that see it or its surroundings.
        rows: first and last but one row of the drive's chart that it owns; around: with its surroundings.
        s: arc lengths between which it owns what stands beside the street, metres; infinite at the street's ends.
        s_around: arc lengths of its surroundings.
    """

    number: int
    own: tuple[int, ...]
    frames: tuple[int, ...]
    rows: tuple[int, int]
    around: tuple[int, int]
    s: tuple[float, float]
    s_around: tuple[float, float]

    @property
    def name(self) -> str:
        """For files."""
        return f"{self.number:04d}"

    @property
    def has_ground(self) -> bool:
        """Whether it owns any of the street's ground."""
        return self.rows[0] < self.rows[1]

    def owns(self, s: Float64) -> Mask:
        """(N,) which arc lengths (N,) are its own."""
        return (s >= self.s[0]) & (s < self.s[1])

    def near(self, s: Float64, beyond: float = CASTS_M) -> Mask:
        """(N,) which arc lengths (N,) lie no farther than ``beyond`` from its surroundings, metres; by default of what may hide,
        light or shade what it reads."""
        return (s >= self.s_around[0] - beyond) & (s < self.s_around[1] + beyond)


def cut_street(ground: Ground, blocks: Blocks, cameras: Sequence[Camera], removed: Float64) -> list[Stretch]:
    """One stretch for each block of a drive.

    Args:
        blocks: of the drive; cameras: of all its frames.
        removed: (M, 3) world places of what is removed.
    """
    s_of_camera = ground.path.to_street(centres_of(cameras))[:, 0]
    street = ground.path.to_street(removed)
    busy = street[ground.inside(street[:, 0], street[:, 1]), 0]
    borders = [-np.inf]
    for before, after in zip(blocks.blocks[:-1], blocks.blocks[1:], strict=True):
        last, first = (s_of_camera[list(block.own)] for block in (before, after))
        if not (len(last) and len(first)):
            borders.append(borders[-1])
            continue
        reach = min(QUIET_M, QUIET_SHARE * min(float(np.ptp(last)), float(np.ptp(first))))
        borders.append(max(_quietest(float(last.max() + first.min()) / 2, busy, reach), borders[-1]))
    borders.append(np.inf)
    count = rows_of(ground)
    stretches = []
    for k, block in enumerate(blocks.blocks):
        low, high = borders[k], borders[k + 1]
        rows, around = ((_row(ground, low - m, count), _row(ground, high + m, count)) for m in (0.0, AROUND_M))
        far = AROUND_M + READ_M
        frames = np.flatnonzero((s_of_camera >= low - far) & (s_of_camera <= high + far))
        stretches.append(
            Stretch(
                k,
                block.own,
                tuple(frames.tolist()),
                rows,
                around,
                (low, high),
                (low - AROUND_M, high + AROUND_M),
            )
        )
    return stretches


def _row(ground: Ground, s: float, count: int) -> int:
    """The row of the drive's chart at an arc length, within the chart's 0 to ``count``."""
    return int(np.clip(np.ceil((s - ground.s_start) / TEXEL_M), 0, count))


def _quietest(middle: float, busy: Float64, reach: float) -> float:
    """The arc length within ``reach`` of a place at which least is removed, of equals the nearest."""
    cells = int(reach / CELL_M)
    at = middle + CELL_M * np.arange(-cells, cells + 1)
    edges = np.append(at - CELL_M / 2, at[-1] + CELL_M / 2)
    count: NDArray[np.float64] = np.histogram(busy, edges)[0].astype(np.float64)
    smooth = gaussian_filter1d(count, SMOOTHED_M / CELL_M, mode="nearest")
    return float(at[np.lexsort((np.abs(at - middle), np.round(smooth, 3)))[0]])


def seen_rows(ground: Ground, cameras: Sequence[Camera], first: int, end: int) -> tuple[int, int]:
    """The rows from ``first`` up to ``end`` without those at both ends that no camera shows; all if none shows any.

    Args:
        ground: whose chart's rows these are.
    """
    step, margin = round(ASKED_M / TEXEL_M), round(MARGIN_M / TEXEL_M)
    rows = np.arange(first, end + step, step)
    across = np.arange(ground.t_min.min(), ground.t_max.max() + ASKED_M, ASKED_M)
    s, t = np.repeat(ground.s_start + TEXEL_M * rows, len(across)), np.tile(across, len(rows))
    places = ground.path.to_world(np.stack([s, t, ground.height_at(s, t)], axis=1))
    shown = np.zeros(len(rows), dtype=bool)
    for camera in cameras:
        shown[camera.shown(places)[0] // len(across)] = True
    if not shown.any():
        return first, end
    seen = rows[shown]
    return max(int(seen[0]) - margin, first), min(int(seen[-1]) + margin, end)
