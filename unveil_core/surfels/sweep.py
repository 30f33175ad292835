"""Points where neither LiDAR nor sparse SfM has any: a small plane sweep over the known poses.

Each frame is compared with its neighbours for a ladder of depths (Collins 1996) by normalized cross-correlation; a depth
counts where it wins clearly and where another frame's own sweep confirms it. It reaches upper facades and the far end
of the street, and fills the gaps of a drive that brings only sparse points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.progress import Progress, no_progress

__all__ = ["SweepSettings", "sweep_depth", "sweep_points"]

Float32 = NDArray[np.float32]


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


def _plane_homography(first: Camera, second: Camera, depth: float) -> NDArray[np.float64]:
    """Maps pixels of ``first`` to pixels of ``second`` over the plane at ``depth`` before ``first``."""
    relative = second.world_to_camera @ first.camera_to_world

    def matrix(c: Camera) -> NDArray[np.float64]:
        # Array positions: the centre of the first pixel is 0 there.
        return np.array([[c.fx, 0, c.cx - 0.5], [0, c.fy, c.cy - 0.5], [0, 0, 1]])

    plane = relative[:3, :3] + np.outer(relative[:3, 3], [0, 0, 1.0]) / depth
    return matrix(second) @ plane @ np.linalg.inv(matrix(first))


def sweep_depth(
    camera: Camera,
    gray: Float32,
    others: Sequence[tuple[Camera, Float32]],
    depths: NDArray[np.float64],
    settings: SweepSettings,
) -> tuple[Float32, Float32]:
    """Depth of one frame.

    Args:
        camera, gray: the frame (H, W) float32.
        others: neighbouring frames.
        depths: (D,) hypotheses, from near to far.
    Returns:
        depth (H, W) and its correlation (H, W), -1 where nothing could be compared.
    """
    size = (settings.window, settings.window)
    shape = gray.shape
    mean = cv2.blur(gray, size)
    variance = cv2.blur(gray * gray, size) - mean * mean
    textured = variance > 4.0
    best = np.full(shape, -1.0, np.float32)
    best_index = np.zeros(shape, np.int32)
    before = np.full(shape, -1.0, np.float32)  # the winner's neighbours in the ladder, for sub-step depth
    after = np.full(shape, -1.0, np.float32)
    previous = np.full(shape, -1.0, np.float32)
    inside_marker = np.ones(shape, np.float32)
    for k, depth in enumerate(depths):
        scores = []
        for other, picture in others:
            h = _plane_homography(camera, other, float(depth))
            flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            warped = cv2.warpPerspective(picture, h, shape[::-1], flags=flags)
            inside = cv2.warpPerspective(inside_marker, h, shape[::-1], flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
            m = cv2.blur(warped, size)
            v = cv2.blur(warped * warped, size) - m * m
            c = cv2.blur(gray * warped, size) - mean * m
            score = c / np.sqrt(np.maximum(variance * v, 16.0))
            scores.append(np.where(inside > 0, score, -1.0))
        # The two best of the neighbours: what one does not see, the others may.
        stacked = np.sort(np.stack(scores), axis=0)
        score = stacked[-2:].mean(axis=0) if len(scores) > 2 else stacked[-1]
        won = score > best
        after = np.where(best_index == k - 1, score, after)
        before = np.where(won, previous, before)
        after = np.where(won, -1.0, after)
        best = np.where(won, score, best)
        best_index = np.where(won, k, best_index)
        previous = score
    inverse = 1.0 / depths
    step = inverse[1] - inverse[0]
    curvature = before - 2 * best + after
    usable = (before > -1) & (after > -1) & (curvature < -1e-6)
    shift = np.where(usable, 0.5 * (before - after) / np.where(usable, curvature, -1.0), 0.0)
    depth_map = 1.0 / np.maximum(inverse[best_index] + np.clip(shift, -0.5, 0.5) * step, inverse[-1] * 0.5)
    interior = (best_index > 0) & (best_index < len(depths) - 1)
    return depth_map.astype(np.float32), np.where(textured & interior, best, -1.0).astype(np.float32)


def sweep_points(
    cameras: Sequence[Camera],
    images: Sequence[NDArray[np.uint8]],
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
        images: (H, W, 3) uint8 per frame; usable: (H, W) bool per frame, False where no point should come from (sky).
        near, far: depth range, world units.
        stride: one sweep pixel in so many per direction becomes a point.
    Returns:
        points (P, 3) and the world size of their pixel footprint (P,).
    """
    count = len(cameras)
    small, gray, masks = [], [], []
    for i, camera in enumerate(cameras):
        factor = min(1.0, settings.side / max(camera.width, camera.height))
        size = (max(16, round(camera.width * factor)), max(16, round(camera.height * factor)))
        small.append(camera.resized(*size))
        plain = cv2.cvtColor(images[i], cv2.COLOR_RGB2GRAY)
        gray.append(cv2.resize(plain, size, interpolation=cv2.INTER_AREA).astype(np.float32))
        masks.append(cv2.resize(usable[i].astype(np.uint8), size, interpolation=cv2.INTER_NEAREST).astype(bool))
    ladder = 1.0 / np.linspace(1.0 / near, 1.0 / far, settings.depths)
    depth, score = [], []
    for i in range(count):
        around = [j for j in range(max(0, i - settings.neighbours), min(count, i + settings.neighbours + 1)) if j != i]
        # A neighbour at the same place tells nothing of depth.
        around = [j for j in around if np.linalg.norm(cameras[j].centre - cameras[i].centre) > 0.02 * near]
        if around:
            d, s = sweep_depth(small[i], gray[i], [(small[j], gray[j]) for j in around], ladder, settings)
        else:
            d, s = np.zeros_like(gray[i]), np.full_like(gray[i], -1.0)
        depth.append(d)
        score.append(np.where(masks[i], s, -1.0))
        progress(i + 1, count, "sweeping depths")
    positions, sizes = [], []
    for i in range(count):
        grid = np.zeros(gray[i].shape, bool)
        grid[stride // 2 :: stride, stride // 2 :: stride] = True
        rows, columns = np.nonzero(grid & (score[i] > settings.correlation))
        if not len(rows):
            continue
        d = depth[i][rows, columns].astype(np.float64)
        points = small[i].centre + d[:, None] * small[i].rays()[rows, columns]
        confirmed = np.zeros(len(points), bool)
        for j in range(max(0, i - settings.neighbours), min(count, i + settings.neighbours + 1)):
            if j == i:
                continue
            pixel, z = small[j].project(points)
            inside = (z > near) & (pixel[:, 0] >= 0) & (pixel[:, 0] < small[j].width)
            inside &= (pixel[:, 1] >= 0) & (pixel[:, 1] < small[j].height)
            column, row = pixel[inside, 0].astype(int), pixel[inside, 1].astype(int)
            same = np.abs(depth[j][row, column] - z[inside]) < settings.agreement * z[inside]
            confirmed[np.flatnonzero(inside)[same & (score[j][row, column] > settings.correlation - 0.15)]] = True
        positions.append(points[confirmed])
        sizes.append(d[confirmed] * stride / small[i].fx)
    if not positions:
        return np.zeros((0, 3)), np.zeros(0)
    return np.concatenate(positions), np.concatenate(sizes)
