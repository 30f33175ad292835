"""The ground of a drive before there is a scene, from its photographs and poses alone.

Where no LiDAR measured it, few points lie on the ground, and few photographs show each place of it: what is optimized from there
ends up metres too deep or before the cameras. But a street is a surface, and a car's cameras are as high over it all along: the
height at which photographs of the lane ahead agree is found by trial, and pixels show ground if photographs agree more on that
surface than on anything that stands upright.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from unveil_core.base.evenly import evenly
from unveil_core.base.frame_cache import FrameCache
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float32, Float64, Levels, Mask
from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.cheapest_path import cheapest_path
from unveil_core.surfels.plane_kernels import NOTHING
from unveil_core.surfels.planes import BlurredView, agreement, blurred_view

__all__ = ["StreetViews", "heights_over_ground", "lane_ahead", "shows_ground", "street_axes"]

SIDE_PX, HALF_PX = 288, 7
"""Longer side of the pictures that are compared, and half of the window's: as wide as a quarter of a lane 8 m ahead."""
NEIGHBOURS, LEAST_MOVE_M = 2, 0.3
"""A frame is compared with so many before and after it, each at least so far from the one before."""
LOWEST_M, HIGHEST_M, STEP = 0.4, 5.0, 0.04
"""Heights of a camera over the ground that are tried, and the share by which they rise."""
ABOUT, RIVAL = 0.3, 0.85
"""Share by which what points tell of the height may be off; and share of the best agreement from which on another height may be the
true one, and none is taken."""
AROUND = 0.15
"""Once some frames have told the height, others are asked about heights that differ by no more than this share."""
ASKED_FIRST, FEWEST = 9, 3
"""Frames that are asked about all heights, and how many of these must tell one."""
AHEAD, ASIDE = (1.5, 8.0), 1.5
"""The lane ahead: places between so many heights of the camera ahead of it, and no more than so many aside."""
WIDE, EVERY_PX = 4.0, 4
"""Half the width of the street, in heights of the camera, in which single places are told, and which pixels are asked."""
TOLD = 0.4
"""Mean correlation in the lane from which on a frame tells the height: of unlike windows it is 0.1 to 0.2."""
SAME = 0.15
"""Spread of the frames' heights, between the quartiles, as a share of their median, over which there is no one height."""
SMOOTHED = 5
"""A frame is as high as the median of so many."""
UPRIGHT_M, BESIDE_M, PLANES = (2.5, 100.0), (1.5, 20.0), (36, 24)
"""What stands upright faces the camera at distances between the first, or lies along the street at the second; so many planes each,
evenly in inverse distance."""
ALIKE, AGREES, SMOOTH_PX = -0.1, 0.3, 2.0
"""Pixels show ground where it explains them no worse than what stands upright, but for the first, and well enough, the second;
both after a blur by the third. In even pictures of kerbs, and along edges that run ahead, all planes agree."""
SURELY = 0.75
"""Correlation from which on what stands upright is told: of noise the best of so many planes has 0.5 to 0.6."""
MOST, BEND = 0.3, 0.4
"""How far a single pixel counts for or against ground, and what a row costs by which the foot of things differs from column to
column: as much as a pixel and a bit."""
FARTHEST = 20.0
"""Farther ahead than so many heights of the camera nothing is told: there a window spans metres of the ground."""


@dataclass(frozen=True, eq=False)
class StreetViews:
    """Photographs of one track, to be compared: (F,) in order of travel, and of each its axes (3, 3): rows right, ahead, up."""

    views: Sequence[BlurredView]
    axes: Sequence[Float64]

    @staticmethod
    def of(cameras: Sequence[Camera], images: Sequence[Levels], cache: FrameCache) -> StreetViews:
        """Photographs (H, W, 3) of a track's cameras, made when they are asked for."""
        views = cache.frames(len(cameras), lambda i: blurred_view(cameras[i], images[i], SIDE_PX))
        return StreetViews(views, [street_axes(cameras, i) for i in range(len(cameras))])

    def around(self, i: int) -> list[BlurredView]:
        """Those that view ``i`` is compared with."""
        found = []
        for step in (-1, 1):
            last, j, taken = self.views[i], i + step, 0
            while 0 <= j < len(self.views) and taken < NEIGHBOURS:
                other = self.views[j]
                if np.linalg.norm(other.camera.centre - last.camera.centre) >= LEAST_MOVE_M:
                    if other.levels.shape == self.views[i].levels.shape:
                        found.append(other)
                    last, taken = other, taken + 1
                j += step
        return found


def street_axes(cameras: Sequence[Camera], i: int) -> Float64:
    """(3, 3) rows right, ahead and up at a camera of a track: ahead along its way, or as it looks where it stands."""
    before, after = cameras[max(i - 1, 0)], cameras[min(i + 1, len(cameras) - 1)]
    way = after.centre - before.centre
    if np.linalg.norm(way) < LEAST_MOVE_M:
        way = cameras[i].forward - (cameras[i].forward @ UP) * UP
    ahead = way / np.linalg.norm(way)
    up: Float64 = UP - (UP @ ahead) * ahead
    up = up / np.linalg.norm(up)
    return np.stack([np.cross(ahead, up), ahead, up])


def heights_over_ground(
    street: StreetViews, barred: Sequence[Mask], *, usual: float | None = None, progress: Progress = no_progress
) -> tuple[Float64, Float64] | None:
    """Heights (F,) of a track's cameras over the ground ahead of them, metres, and places (P, 3) on the ground; None where the
    photographs agree on no height.

    Args:
        barred: (H, W) per frame of any size, pixels that do not show what stands still.
        usual: about the height, as points tell it; None = not known. Paving repeats itself, and then agrees on other heights, too.
    """
    count = len(street.views)
    first = evenly(count, ASKED_FIRST)
    lowest, highest = (LOWEST_M, HIGHEST_M) if usual is None else (usual * (1 - ABOUT), usual * (1 + ABOUT))
    ladder = lowest * (1 + STEP) ** np.arange(1 + np.log(highest / lowest) / np.log(1 + STEP))
    some = [told[0] for i in first if (told := _height(street, i, ladder, barred[i])) is not None]
    if len(some) < min(FEWEST, count):
        return None
    middle = float(np.median(some))
    near = middle * np.linspace(1 - AROUND, 1 + AROUND, 1 + 2 * round(2 * AROUND / STEP))
    heights, places = np.full(count, np.nan), []
    for i in range(count):
        told = _height(street, i, near, barred[i])
        if told is not None:
            heights[i] = told[0]
            places.append(told[1])
        progress(i + 1, count, "looking for the ground")
    known = np.isfinite(heights)
    if known.sum() < min(FEWEST, count) or np.subtract(*np.percentile(some, (75, 25))) > SAME * middle:
        return None
    index = np.arange(count)
    heights = median_filter(np.interp(index, index[known], heights[known]), SMOOTHED, mode="nearest")
    return heights, np.concatenate(places)


def lane_ahead(camera: Camera, axes: Float64, aside: float = ASIDE) -> Mask:
    """(H, W) pixels that show the lane ahead of a camera with these axes, see :func:`street_axes`, whatever its height.

    Args:
        aside: half its width, in heights of the camera.
    """
    rays = camera.rays() @ axes.T
    down = np.maximum(-rays[..., 2], 1e-9)
    ahead, beside = rays[..., 1] / down, np.abs(rays[..., 0]) / down
    return (rays[..., 2] < 0) & (ahead > AHEAD[0]) & (ahead < AHEAD[1]) & (beside < aside)


def _height(street: StreetViews, i: int, ladder: Float64, barred: Mask) -> tuple[float, Float64] | None:
    """The height over the ground on which the photographs of the lane ahead agree, and places (P, 3) of the street, each as high as
    they agree on there; None where they do on none within the ladder."""
    view, others = street.views[i], street.around(i)
    axes, clear = street.axes[i], ~_resized(barred, view)
    lane, wide = (lane_ahead(view.camera, axes, aside) & clear for aside in (ASIDE, WIDE))
    if not others or lane.sum() < 4 * HALF_PX**2:
        return None
    # Of every window's width a few pixels are enough.
    some = np.zeros(wide.shape, dtype=bool)
    some[::EVERY_PX, ::EVERY_PX] = wide[::EVERY_PX, ::EVERY_PX]
    score, table = np.empty(len(ladder)), np.empty((len(ladder), np.count_nonzero(some)))
    for k, height in enumerate(ladder):
        found = agreement(view, others, -axes[2], np.array([height]), HALF_PX)
        score[k], table[k] = np.maximum(found[lane], 0).mean(), found[some]
    best = int(score.argmax())
    rival = np.max(score[np.abs(np.log(ladder / ladder[best])) > AROUND], initial=0.0)
    if score[best] < TOLD or best in (0, len(ladder) - 1) or rival > RIVAL * score[best]:
        return None
    rung = table.argmax(axis=0)
    sure = (table.max(axis=0) > SURELY) & (rung > 0) & (rung < len(ladder) - 1)
    table, rung = table[:, sure], rung[sure]
    rays = view.camera.rays()[some][sure]
    local = np.interp(_between(table, rung), np.arange(len(ladder)), ladder)
    places = view.camera.centre + (local / -(rays @ axes[2]))[:, None] * rays
    return float(np.interp(_between(score[:, None], np.array([best]))[0], np.arange(len(ladder)), ladder)), places


def _between(table: Float64, best: NDArray[np.int64]) -> Float64:
    """(P,) where between its rows a table (D, P) is greatest: on a parabola through the best row, not the first or last, and those
    beside it."""
    column = np.arange(len(best))
    before, at, after = (table[best + step, column] for step in (-1, 0, 1))
    shift: Float64 = 0.5 * (before - after) / np.minimum(before - 2 * at + after, -1e-9)
    return best.astype(np.float64) + np.clip(shift, -0.5, 0.5)


def shows_ground(street: StreetViews, i: int, height: float, shape: tuple[int, int]) -> Mask:
    """(H, W) of a shape, pixels of a photograph that show ground."""
    view, others = street.views[i], street.around(i)
    right, ahead, up = street.axes[i]
    rays = view.camera.rays() @ up
    below = rays < -1 / FARTHEST
    if not others:
        return np.zeros(shape, dtype=bool)
    of_ground = agreement(view, others, -up, height * np.array([0.95, 1.0, 1.05]), HALF_PX)
    facing, beside = (1 / np.linspace(1 / a, 1 / b, n) for (a, b), n in zip((UPRIGHT_M, BESIDE_M), PLANES, strict=True))
    families = ((view.camera.forward, facing), (right, beside), (-right, beside))
    upright = np.max([agreement(view, others, normal, planes, HALF_PX) for normal, planes in families], axis=0)
    more, well = (cv2.GaussianBlur(p, (0, 0), SMOOTH_PX) for p in (of_ground - upright, of_ground))
    found = below & (more > ALIKE) & (well > AGREES)
    # Beside nothing that could be compared, and in noise, of which some plane always explains something, nothing is told.
    told = found | (below & (of_ground > NOTHING) & (upright > SURELY))
    free = _free_space(np.where(told, more - ALIKE, 0.0)) & below & found.any(axis=0)
    found = _whole(found | free)
    return cv2.resize(found.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST).astype(bool)


def _free_space(evidence: Float32) -> Mask:
    """(H, W) what lies below the first thing that stands on the ground, column by column: the way to it is free (Badino et al.,
    *Free space computation using stochastic occupancy grids and dynamic programming*, 2007).

    Args:
        evidence: (H, W) for ground where it is positive, against it where negative.
    """
    sure = np.clip(evidence, -MOST, MOST)
    # Cost of a foot over each row: what tells against ground below it, and for ground above it.
    below = np.concatenate([np.cumsum(sure[::-1], axis=0)[::-1], np.zeros((1, sure.shape[1]))])
    foot = cheapest_path(-below.T, _beside)
    return np.asarray(np.arange(len(sure))[:, None] >= foot)


def _beside(total: Float64) -> tuple[NDArray[np.int64], Float64]:
    """A step of :func:`cheapest_path` that costs ``BEND`` a row."""
    index = np.arange(len(total))
    best, cost = index, total
    for turned in (slice(None), slice(None, None, -1)):
        level = cost[turned] - BEND * index
        low = np.minimum.accumulate(level)
        at = np.maximum.accumulate(np.where(level <= low, index, 0))
        best, cost = best[turned][at][turned], (low + BEND * index)[turned]
    return best, cost


def _whole(found: Mask) -> Mask:
    """A mask (H, W) without specks, and with its small holes filled."""
    least = (2 * HALF_PX + 1) ** 2
    for value in (1, 0):
        count, part, stats, _ = cv2.connectedComponentsWithStats((found == value).astype(np.uint8), connectivity=4)
        small = stats[:, cv2.CC_STAT_AREA] < least
        small[0] = False
        found = np.where(small[part] & (found == value), not value, found)
    return np.asarray(found, dtype=bool)


def _resized(mask: Mask, view: BlurredView) -> Mask:
    height, width = view.levels.shape[1:]
    return cv2.resize(mask.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST).astype(bool)
