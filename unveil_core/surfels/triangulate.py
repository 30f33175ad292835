"""Points beyond the LiDAR: dense two-view triangulation along the drive.

Optical flow between neighbouring frames of one camera, checked forwards and backwards, against the known epipolar
geometry, and between two baselines. It reaches upper facades and the far end of the street, which LiDAR and sparse SfM
points leave empty.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.geometry.camera import Camera
from unveil_core.progress import Progress, no_progress

__all__ = ["triangulate_flow"]


def _depth_from_flow(first: Camera, second: Camera, pixels: NDArray[np.float64], flow: NDArray[np.float64]):  # type: ignore[no-untyped-def]
    """Depth along the first camera's rays that best meets the rays of the second; residual in pixels, parallax angle."""
    relative = second.world_to_camera @ first.camera_to_world
    ray = np.stack([(pixels[:, 0] - first.cx) / first.fx, (pixels[:, 1] - first.cy) / first.fy, np.ones(len(pixels))], 1)
    turned = ray @ relative[:3, :3].T
    shift = relative[:3, 3]
    target = pixels + flow
    x, y = (target[:, 0] - second.cx) / second.fx, (target[:, 1] - second.cy) / second.fy
    # (d * turned + shift) must project to (x, y): two equations in d, solved by least squares.
    a = np.stack([turned[:, 0] - x * turned[:, 2], turned[:, 1] - y * turned[:, 2]], axis=1)
    b = np.stack([x * shift[2] - shift[0], y * shift[2] - shift[1]], axis=1)
    depth = (a * b).sum(1) / np.maximum((a * a).sum(1), 1e-18)
    local = depth[:, None] * turned + shift
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.hypot(
            (local[:, 0] / local[:, 2] - x) * second.fx, (local[:, 1] / local[:, 2] - y) * second.fy
        )
    cosine = (turned * local).sum(1) / np.maximum(np.linalg.norm(turned, axis=1) * np.linalg.norm(local, axis=1), 1e-18)
    parallax = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    return depth, np.where(local[:, 2] > 0, error, np.inf), parallax


def triangulate_flow(
    cameras: Sequence[Camera],
    image: Callable[[int], NDArray[np.uint8]],
    usable: Callable[[int], NDArray[np.bool_]],
    *,
    near: float,
    far: float,
    stride: int = 3,
    progress: Progress = no_progress,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Triangulate pixels of each frame against the next two.

    Args:
        cameras: of one track, in order of travel.
        image: gives (H, W, 3) uint8 of frame i.
        usable: gives (H, W) bool of frame i, False where no point should come from (sky).
        near, far: depth range, world units.
        stride: one pixel in so many per direction is used.
    Returns:
        points (P, 3) and the world size of their pixel footprint (P,).
    """
    flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    gray = [cv2.cvtColor(image(i), cv2.COLOR_RGB2GRAY) for i in range(len(cameras))]
    positions, sizes = [], []
    for i, camera in enumerate(cameras):
        rows, columns = np.mgrid[stride // 2 : camera.height : stride, stride // 2 : camera.width : stride]
        chosen = usable(i)[rows, columns]
        rows, columns = rows[chosen], columns[chosen]
        pixels = np.stack([columns + 0.5, rows + 0.5], axis=1)
        estimates = []
        # The last frames look back instead of ahead.
        steps = (1, 2) if i + 2 < len(cameras) else (-1, -2)
        for step in steps:
            j = i + step
            if not 0 <= j < len(cameras) or gray[j].shape != gray[i].shape:
                continue
            forward = flow.calc(gray[i], gray[j], None)
            backward = flow.calc(gray[j], gray[i], None)
            moved = forward[rows, columns].astype(np.float64)
            back = cv2.remap(
                backward, (columns + moved[:, 0]).astype(np.float32), (rows + moved[:, 1]).astype(np.float32),
                cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(1e6, 1e6),
            )[:, 0]  # fmt: skip
            depth, error, parallax = _depth_from_flow(camera, cameras[j], pixels, moved)
            good = (np.linalg.norm(back + moved, axis=1) < 1.0) & (error < 1.0) & (parallax > 0.4)
            good &= (depth > near) & (depth < far)
            estimates.append((depth, good))
        if len(estimates) == 2:
            (d1, g1), (d2, g2) = estimates
            good = g1 & g2 & (np.abs(d1 - d2) < 0.06 * d2)
            depth = d2[good]  # the longer baseline is the more exact one
            rays = camera.rays()[rows[good], columns[good]]
            positions.append(camera.centre + depth[:, None] * rays)
            sizes.append(depth * stride / camera.fx)
        progress(i + 1, len(cameras), "triangulating")
    if not positions:
        return np.zeros((0, 3)), np.zeros(0)
    return np.concatenate(positions), np.concatenate(sizes)
