"""Depth of a frame's pixels by optical flow to its neighbours, whose cameras are known.

Optical flow fails on the road: near the camera it moves by a tenth of the picture between two frames, and has little to hold on to.
So the neighbour is first brought to the frame as if all it showed were the ground's plane, and the flow finds what is left. Both
flows, with and without, are tried for each pixel: the one counts that lies nearer to the line on which the cameras allow it. A
depth is kept where two neighbours agree on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64, Mask
from unveil_core.geometry.camera import Camera

__all__ = ["Ground", "Looked", "depth_by_flow"]

EPIPOLAR_PX = 0.8
"""Distance of a match from its epipolar line, beyond which it is wrong: good flow has 0.2 to 0.3."""
AGREE_PX = 1.0
"""Distance between where two neighbours put a pixel in the one that sees less of its depth."""
LEAST_PARALLAX_PX = 6.0
"""Motion that follows from a pixel's depth, both neighbours together: at 0.3 pixels of noise the depth is known to 5 %."""
SMOOTH = 0.08
"""Share by which a depth may differ from the median of its surroundings."""


@dataclass(frozen=True, eq=False)
class Ground:
    """The ground below a camera: up (3,) unit in the world, and the camera's height above it, units of the cameras."""

    up: Float64
    height: float


@dataclass(frozen=True, eq=False)
class Looked:
    """A frame at the size at which it is compared: its pinhole camera, and its grey picture (H, W)."""

    camera: Camera
    grey: NDArray[np.uint8]


def depth_by_flow(
    frame: Looked, neighbours: list[Looked], ground: Ground | None, hidden: Mask | None, engine: cv2.DISOpticalFlow
) -> tuple[Float32, Float32]:
    """Depth of a frame's pixels.

    Args:
        neighbours: two or more, at distances that show depth.
        ground: below the frame's camera; None = unknown, then nothing is brought to it first.
        hidden: (H, W) pixels that are left out; None = none are.
    Returns:
        (H, W) depth along the optical axis, NaN = unknown, and (H, W) motion that it rests on, pixels.
    """
    camera = frame.camera
    found = [_by_neighbour(frame, other, ground, engine) for other in neighbours]
    total, weight = np.zeros((2, camera.height, camera.width))
    agreeing = np.zeros((camera.height, camera.width), np.int32)
    for k, (inverse, power) in enumerate(found):
        agrees = np.zeros_like(agreeing)
        for j, (other, other_power) in enumerate(found):
            if j != k:
                agrees += np.abs(inverse - other) * np.minimum(power, other_power) < AGREE_PX
        good = agrees > 0
        total += np.where(good, inverse * power**2, 0)
        weight += np.where(good, power**2, 0)
        agreeing += good
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = total / weight
        parallax = inverse * np.sqrt(weight)
        good = (agreeing > 1) & (inverse > 0) & (parallax > LEAST_PARALLAX_PX)
        depth = np.where(good, 1 / inverse, np.nan).astype(np.float32)
    if hidden is not None:
        depth[hidden] = np.nan
    filled = np.nan_to_num(depth)
    middle = cv2.medianBlur(filled, 5)
    depth[np.abs(filled - middle) > SMOOTH * np.maximum(middle, 1e-9)] = np.nan
    return depth, np.where(np.isfinite(depth), parallax, 0).astype(np.float32)


def _by_neighbour(
    frame: Looked, other: Looked, ground: Ground | None, engine: cv2.DISOpticalFlow
) -> tuple[Float64, Float64]:
    """(H, W) inverse depth of a frame's pixels by one neighbour, NaN = none, and (H, W) how many pixels the match moves for a unit
    of it."""
    columns, rows = np.meshgrid(
        np.arange(frame.camera.width, dtype=np.float32), np.arange(frame.camera.height, dtype=np.float32)
    )
    flow = np.asarray(engine.calc(frame.grey, other.grey, None), np.float32)
    best = _along_lines(frame.camera, other.camera, columns + flow[..., 0], rows + flow[..., 1])
    if ground is not None and (homography := _of_plane(frame.camera, other.camera, ground)) is not None:
        at_x, at_y = _moved(homography, columns, rows)
        brought = cv2.remap(other.grey, at_x, at_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        seen = (at_x >= 0) & (at_y >= 0) & (at_x < other.camera.width) & (at_y < other.camera.height)
        # What lies outside would draw the flow of what lies beside it.
        brought = np.where(seen, brought, frame.grey)
        flow = np.asarray(engine.calc(frame.grey, brought, None), np.float32)
        there = _moved(homography, columns + flow[..., 0], rows + flow[..., 1])
        second = _along_lines(frame.camera, other.camera, *there)
        nearer = np.nan_to_num(second[2], nan=np.inf) < np.nan_to_num(best[2], nan=np.inf)
        nearer &= seen
        best = (
            np.where(nearer, second[0], best[0]),
            np.where(nearer, second[1], best[1]),
            np.where(nearer, second[2], best[2]),
        )
    inverse, power, off = best
    inverse = np.where((off < EPIPOLAR_PX) & (inverse > 0), inverse, np.nan)
    return inverse, power


def _of_plane(camera: Camera, other: Camera, ground: Ground) -> Float64 | None:
    """(3, 3) from where a camera shows the ground to where another one does, pixels with centres at whole numbers."""
    down = -(camera.world_to_camera[:3, :3] @ ground.up)
    if ground.height <= 0:
        return None
    return camera.homography(other, down, ground.height)


def _moved(homography: Float64, columns: Float32, rows: Float32) -> tuple[Float32, Float32]:
    h = homography
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = h[2, 0] * columns + h[2, 1] * rows + h[2, 2]
        x = (h[0, 0] * columns + h[0, 1] * rows + h[0, 2]) / depth
        y = (h[1, 0] * columns + h[1, 1] * rows + h[1, 2]) / depth
        behind = depth <= 0.05  # above the horizon, where no ground is
    return np.where(behind, -1e4, x).astype(np.float32), np.where(behind, -1e4, y).astype(np.float32)


def _along_lines(camera: Camera, other: Camera, there_x: Float32, there_y: Float32) -> tuple[Float64, Float64, Float64]:
    """(H, W) inverse depth of a camera's pixels that fits best to where another one shows them, how many pixels the match moves for
    a unit of it, and its distance from the epipolar line in pixels; NaN outside of the other picture."""
    to_other = other.world_to_camera @ camera.camera_to_world
    turn, shift = to_other[:3, :3], to_other[:3, 3]
    x = ((np.arange(camera.width) + 0.5 - camera.cx) / camera.fx)[None, :]
    y = ((np.arange(camera.height) + 0.5 - camera.cy) / camera.fy)[:, None]
    far = [turn[k, 0] * x + turn[k, 1] * y + turn[k, 2] for k in range(3)]
    u = (there_x.astype(np.float64) + 0.5 - other.cx) / other.fx
    v = (there_y.astype(np.float64) + 0.5 - other.cy) / other.fy
    a = (u * shift[2] - shift[0], v * shift[2] - shift[1])
    b = (u * far[2] - far[0], v * far[2] - far[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        square = a[0] ** 2 + a[1] ** 2
        inverse = -(a[0] * b[0] + a[1] * b[1]) / square
        depth = far[2] + shift[2] * inverse
        px = np.where(depth > 1e-3, other.fx / depth, np.nan)
        off = np.abs(a[0] * b[1] - a[1] * b[0]) / np.sqrt(square) * px
        power = np.sqrt(square) * px
    inside = (there_x >= 0) & (there_y >= 0) & (there_x < other.width) & (there_y < other.height)
    return np.where(inside, inverse, np.nan), np.where(inside, power, 0), np.where(inside, off, np.nan)
