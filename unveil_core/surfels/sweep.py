"""Points where neither LiDAR nor sparse SfM has any: a small plane sweep over the known poses.

Each frame is compared with its neighbours for a ladder of depths (Collins 1996) by normalized cross-correlation; a depth
counts where it wins clearly and where another frame's own sweep confirms it. It reaches upper facades and the far end
of the street, and fills the gaps of a drive that brings only sparse points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.parallel import in_parallel
from unveil_core.base.progress import Progress, no_progress
from unveil_core.base.types import Float32, Levels
from unveil_core.geometry.camera import Camera
from unveil_core.surfels.pictures import reduced_gray, to_other
from unveil_core.surfels.sweep_kernels import BAND, NOTHING, sweep_bands

__all__ = ["SweepSettings", "sweep_depth", "sweep_points"]


@dataclass(frozen=True)
class SweepSettings:
    """Attributes:
    side: longer image side that the sweep runs at, pixels.
    depths: number of hypotheses, equally spaced in inverse depth.
    window: side of the correlation window, pixels.
    neighbours: how many frames before and after are compared with.
    correlation: least correlation that counts.
    agreement: how far another frame's depth may differ, relative.
    """

    side: int = 288
    depths: int = 72
    window: int = 7
    neighbours: int = 2
    correlation: float = 0.75
    agreement: float = 0.05


def sweep_depth(
    camera: Camera,
    gray: Float32,
    others: Sequence[tuple[Camera, Float32]],
    depths: NDArray[np.float64],
    settings: SweepSettings,
    *,
    usable: NDArray[np.bool_] | None = None,
) -> tuple[Float32, Float32]:
    """Depth of one frame.

    Args:
        camera, gray: the frame (H, W) float32, levels of 255.
        others: neighbouring frames, of one size.
        depths: (D,) hypotheses, from near to far, equally spaced in inverse depth.
        usable: (H, W), the pixels that are asked for; all by default.
    Returns:
        depth (H, W) and its correlation (H, W), -1 where nothing could be compared.
    """
    pictures = np.ascontiguousarray(np.stack([picture for _, picture in others]), dtype=np.float32)
    ways = [[part.astype(np.float32) for part in to_other(camera, other)] for other, _ in others]
    inverse = 1.0 / depths
    rung = np.empty(gray.shape, np.int32)
    score, before, after = (np.empty(gray.shape, np.float32) for _ in range(3))
    asked = np.ones(gray.shape, np.uint8) if usable is None else usable.astype(np.uint8)
    in_parallel(
        sweep_bands,
        -(-len(gray) // BAND),
        1,
        gray,
        pictures,
        np.stack([t for t, _ in ways]),
        np.stack([s for _, s in ways]),
        inverse.astype(np.float32),
        asked,
        settings.window // 2,
        rung,
        score,
        before,
        after,
    )
    # A parabola through the winner and its neighbours in the ladder: depth between the steps.
    curvature = before - 2 * score + after
    bent = (before > NOTHING) & (after > NOTHING) & (curvature < -1e-6)
    shift = np.where(bent, 0.5 * (before - after) / np.where(bent, curvature, -1.0), 0.0)
    step = inverse[1] - inverse[0]
    depth = 1.0 / np.maximum(inverse[rung] + np.clip(shift, -0.5, 0.5) * step, inverse[-1] * 0.5)
    inner = (rung > 0) & (rung < len(depths) - 1)
    return depth.astype(np.float32), np.where(inner, score, NOTHING)


def sweep_points(
    cameras: Sequence[Camera],
    images: Sequence[Levels],
    usable: Sequence[NDArray[np.bool_]],
    settings: SweepSettings,
    *,
    near: float,
    far: float,
    stride: int = 2,
    progress: Progress = no_progress,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sweep all frames of one track and keep what two frames agree on.

    Args:
        cameras: of the track, in order of travel.
        images: (H, W, 3) levels of 255 per frame; usable: (H, W) bool per frame, False where no point should come from (sky).
        near, far: depth range, metres.
        stride: one sweep pixel in so many per direction becomes a point.
    Returns:
        points (P, 3) and the world size of their pixel footprint (P,).
    """
    count, reach = len(cameras), settings.neighbours
    ladder = 1.0 / np.linspace(1.0 / near, 1.0 / far, settings.depths)
    ready: dict[int, _Small] = {}
    swept: dict[int, tuple[Float32, Float32]] = {}
    positions, sizes = [], []
    # Only a frame and its neighbours are held at a time; what they confirm lags behind what is swept.
    for i in range(count + reach):
        for j in range(i, min(i + reach + 1, count)):
            if j not in ready:
                ready[j] = _smaller(cameras[j], images[j], usable[j], settings)
        if i < count:
            swept[i] = _swept(i, ready, ladder, settings, 0.02 * near)
            progress(i + 1, count, "sweeping depths")
        done = i - reach
        if done >= 0:
            found, size = _confirmed(done, ready, swept, settings, near, stride)
            positions.append(found)
            sizes.append(size)
        ready.pop(done - reach, None)
        swept.pop(done - reach, None)
    if not positions:
        return np.zeros((0, 3)), np.zeros(0)
    return np.concatenate(positions), np.concatenate(sizes)


@dataclass(frozen=True, eq=False)
class _Small:
    """A frame at the size of the sweep: camera, grey (H, W) and the pixels (H, W) that are asked for."""

    camera: Camera
    gray: Float32
    usable: NDArray[np.bool_]


def _smaller(camera: Camera, image: Levels, usable: NDArray[np.bool_], settings: SweepSettings) -> _Small:
    small, gray = reduced_gray(camera, image, settings.side)
    size = (small.width, small.height)
    mask = cv2.resize(usable.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST).astype(bool)
    return _Small(small, gray, mask)


def _swept(
    i: int, ready: Mapping[int, _Small], ladder: NDArray[np.float64], settings: SweepSettings, least_m: float
) -> tuple[Float32, Float32]:
    """Depth and correlation of frame i against its neighbours; one within ``least_m`` of its place tells nothing of depth."""
    own = ready[i]
    around = [ready[j] for j in range(i - settings.neighbours, i + settings.neighbours + 1) if j != i and j in ready]
    around = [other for other in around if np.linalg.norm(other.camera.centre - own.camera.centre) > least_m]
    others = [(other.camera, other.gray) for other in around if other.gray.shape == own.gray.shape]
    if not others:
        return np.zeros_like(own.gray), np.full_like(own.gray, -1.0)
    return sweep_depth(own.camera, own.gray, others, ladder, settings, usable=own.usable)


def _confirmed(
    i: int,
    ready: Mapping[int, _Small],
    swept: Mapping[int, tuple[Float32, Float32]],
    settings: SweepSettings,
    near: float,
    stride: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points (P, 3) of frame i that the sweep of a neighbour confirms, and the world size of their footprints (P,)."""
    camera, (depth, score) = ready[i].camera, swept[i]
    grid = np.zeros(score.shape, bool)
    grid[stride // 2 :: stride, stride // 2 :: stride] = True
    rows, columns = np.nonzero(grid & (score > settings.correlation))
    d = depth[rows, columns].astype(np.float64)
    points = camera.centre + d[:, None] * camera.rays()[rows, columns]
    confirmed = np.zeros(len(points), bool)
    for j in range(i - settings.neighbours, i + settings.neighbours + 1):
        if j == i or j not in swept:
            continue
        pixel, z = ready[j].camera.project(points)
        inside = ready[j].camera.in_picture(pixel, z, nearest=near)
        column, row = pixel[inside, 0].astype(int), pixel[inside, 1].astype(int)
        there, sure = swept[j]
        same = np.abs(there[row, column] - z[inside]) < settings.agreement * z[inside]
        confirmed[np.flatnonzero(inside)[same & (sure[row, column] > settings.correlation - 0.15)]] = True
    return points[confirmed], d[confirmed] * stride / camera.fx
