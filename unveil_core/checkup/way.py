"""The way seen from above, over the points of the drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from unveil_core.base.types import Float64, Picture
from unveil_core.drives.drive import Drive, tracks
from unveil_core.geometry.cloud import every_nth

__all__ = ["COLOURS", "WayPicture", "way_picture"]

COLOURS = ((92, 195, 171), (240, 140, 50), (86, 140, 245), (217, 174, 98), (167, 157, 224), (230, 90, 110))
"""Of cameras, sRGB, in their order."""
LONGER_PX = 1100
AROUND_M = 25.0
"""Beside the way, that is shown; metres."""
MOST_POINTS = 400_000
FEW_POINTS = 30_000
"""On the map; fewer are drawn larger."""
DARK = (43, 48, 56)
"""Where no points are, sRGB."""
MOST_TICKS = 60
"""Frames whose viewing direction is drawn."""
BARS_M = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)


@dataclass(frozen=True, eq=False)
class WayPicture:
    """A map.

    Attributes:
        ground: (H, W, 3) points from above, brighter where they are many.
        lines: by camera its name, its colour and pixels (N, 2) of its frames.
        ticks: pairs of pixels (2, 2): where some frames stand and look.
        boxes: (4, 2) pixels each, of objects where they are first seen.
        pixels_per_m: of the map; bar_m: length of its scale bar.
    """

    ground: Picture
    lines: tuple[tuple[str, tuple[int, int, int], Float64], ...]
    ticks: tuple[Float64, ...]
    boxes: tuple[Float64, ...]
    pixels_per_m: float
    bar_m: float


def way_picture(drive: Drive, more: Sequence[Float64] = ()) -> WayPicture:
    """The map of a drive in metres with z up; the way goes from left to right.

    Args:
        more: (P, 3) points of sweeps, beside those of the drive.
    """
    centres = np.stack([f.camera.centre for f in drive.frames])[:, :2]
    turn = _along(centres)
    placed = centres @ turn.T
    low, high = placed.min(axis=0) - AROUND_M, placed.max(axis=0) + AROUND_M
    scale = LONGER_PX / float((high - low).max())
    width, height = (max(2, math.ceil(v)) for v in (high - low) * scale)

    def pixels(points: Float64) -> Float64:
        local = points[:, :2] @ turn.T
        return np.stack([(local[:, 0] - low[0]) * scale, height - (local[:, 1] - low[1]) * scale], axis=1)

    clouds = [c for c in (drive.points.positions, *more) if len(c)]
    ground = (
        _density(pixels(every_nth(np.concatenate(clouds), MOST_POINTS)), width, height)
        if clouds
        else _empty(width, height)
    )
    frames = drive.frames
    lines = []
    for k, track in enumerate(tracks(drive)):
        path = pixels(np.stack([frames[i].camera.centre for i in track]))
        lines.append((frames[track[0]].camera_name, COLOURS[k % len(COLOURS)], path))
    length = 0.035 * LONGER_PX / scale
    ticks = []
    for f in frames[:: max(1, len(frames) // MOST_TICKS)]:
        ahead = f.camera.forward * (1, 1, 0)
        far = float(np.linalg.norm(ahead))
        if far > 0:
            ticks.append(pixels(np.stack([f.camera.centre, f.camera.centre + length * ahead / far])))
    first = {b.id: b for f in reversed(frames) for b in f.boxes}
    boxes = tuple(pixels(b.corners()[[0, 2, 6, 4]]) for b in first.values())
    bar = max((b for b in BARS_M if b * scale <= 0.25 * width), default=BARS_M[0])
    return WayPicture(ground, tuple(lines), tuple(ticks), boxes, scale, bar)


def _along(centres: Float64) -> Float64:
    """(2, 2) rotation that brings the longest extent of places (N, 2) to x, the first on the left."""
    offset = centres - centres.mean(axis=0)
    axes = np.linalg.svd(offset, full_matrices=True)[2] if len(centres) > 1 else np.eye(2)
    ahead = axes[0] * (1.0 if (centres[-1] - centres[0]) @ axes[0] >= 0 else -1.0)
    return np.array([ahead, [-ahead[1], ahead[0]]])


def _empty(width: int, height: int) -> Picture:
    return np.full((height, width, 3), DARK, np.uint8)


def _density(pixels: Float64, width: int, height: int) -> Picture:
    """Points by how many fall into a pixel, on a logarithmic scale."""
    column, row = np.floor(pixels).astype(np.int64).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    counts = np.bincount(row[inside] * width + column[inside], minlength=width * height).reshape(height, width)
    if int(inside.sum()) < FEW_POINTS:
        counts = cv2.dilate(counts.astype(np.float32), np.ones((3, 3), np.uint8))
    bright = np.log1p(counts) / max(
        float(np.log1p(np.percentile(counts[counts > 0], 98))) if counts.any() else 1.0, 1e-9
    )
    light = np.array((214, 220, 224), np.float64)
    shown = np.asarray(DARK) + np.clip(bright, 0, 1)[..., None] * (light - np.asarray(DARK))
    return shown.astype(np.uint8)
