"""What photographs show of the same places: features, and which of two photographs match."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unveil_core.base.types import Float32, Float64
from unveil_core.geometry.camera import Camera

__all__ = ["Features", "alike", "find_features", "matched", "off_epipolar_line", "on_one_motion"]

MOST = 2000
"""Features of a photograph at most, those of the highest contrast: 200 matched ones tell a pose to a tenth of a pixel."""
RATIO = 0.8
"""Of the distances to the best and the second best candidate: Lowe, *Distinctive image features from scale-invariant keypoints*
(2004), section 7.1."""
SEARCH_SHARE = 0.03
"""How far from the epipolar line of the given poses a match may lie, as a share of the picture's longer side: an inertial pose that
is wrong by a degree moves it by 2 % with a lens of 60 degrees."""
INLIER_PX = 1.0
"""From the epipolar line that most matches agree on."""
FEWEST = 16
"""Matches that two photographs must share to tell anything."""


@dataclass(frozen=True, eq=False)
class Features:
    """Of one photograph.

    Attributes:
        pixels: (F, 2) float64, counted from the edge of the first pixel.
        descriptors: (F, 128) float32.
    """

    pixels: Float64
    descriptors: Float32


def find_features(gray: NDArray[np.uint8], usable: NDArray[np.bool_] | None = None) -> Features:
    """Features of a photograph (H, W), of the pixels ``usable`` (H, W) only: SIFT, with square roots of its histograms
    (Arandjelović and Zisserman, *Three things everyone should know to improve object retrieval*, 2012)."""
    mask = None if usable is None else usable.astype(np.uint8) * 255
    sift: Any = cv2.SIFT_create  # type: ignore[attr-defined]  # of OpenCV since 4.4, unknown to its stubs
    points, descriptors = sift(MOST).detectAndCompute(gray, mask)
    if descriptors is None:
        return Features(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    roots = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)).astype(np.float32)
    return Features(np.array([p.pt for p in points]) + 0.5, roots)


def matched(a: Features, b: Features, first: Camera, second: Camera) -> NDArray[np.int64]:
    """(M, 2) indices of features of two photographs that show the same place: each the other's best candidate, clearly better than
    the next, near the epipolar line of the given poses, and on that which most of them agree on."""
    pairs = alike(a, b)
    if len(pairs) < FEWEST:
        return NO_PAIRS
    side = max(first.width, first.height)
    off = off_epipolar_line(a.pixels[pairs[:, 0]], b.pixels[pairs[:, 1]], first, second)
    return on_one_motion(a, b, pairs[off < SEARCH_SHARE * side])


NO_PAIRS = np.zeros((0, 2), dtype=np.int64)
NO_PAIRS.flags.writeable = False


def alike(a: Features, b: Features) -> NDArray[np.int64]:
    """(M, 2) indices of features of two photographs that look alike: each the other's best, clearly better than the next."""
    if min(len(a.pixels), len(b.pixels)) < FEWEST:
        return NO_PAIRS
    cosines = a.descriptors @ b.descriptors.T
    order = np.argpartition(-cosines, 1, axis=1)[:, :2]
    two = np.take_along_axis(cosines, order, axis=1)
    best = order[np.arange(len(order)), two.argmax(axis=1)]
    # Of unit vectors the squared distance is 2 - 2 cos.
    near, next_ = (np.sqrt(np.maximum(2 - 2 * v, 0)) for v in (two.max(axis=1), two.min(axis=1)))
    mutual = cosines.argmax(axis=0)[best] == np.arange(len(best))
    return np.stack([np.arange(len(best)), best], axis=1)[mutual & (near < RATIO * next_)]


def on_one_motion(a: Features, b: Features, pairs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of pairs (M, 2) those that one motion of the camera explains, whatever it is; none where too few agree on one."""
    if len(pairs) < FEWEST:
        return NO_PAIRS
    one, two = a.pixels[pairs[:, 0]], b.pixels[pairs[:, 1]]
    moved = np.linalg.norm(one - two, axis=1)
    if np.median(moved) < INLIER_PX:  # of a camera that stands no epipolar line can be found, and none is needed
        return pairs[moved < 2 * INLIER_PX]
    cv2.setRNGSeed(0)
    try:
        inside = cv2.findFundamentalMat(one, two, cv2.USAC_FAST, INLIER_PX, 0.999, 2000)[1]
    except cv2.error:  # where every sample that it draws is degenerate
        return NO_PAIRS
    if inside is None or int(inside.sum()) < FEWEST:
        return NO_PAIRS
    return pairs[inside.ravel() > 0]


def off_epipolar_line(a: Float64, b: Float64, first: Camera, second: Camera) -> Float64:
    """(M,) distance of matches (M, 2), (M, 2) from the epipolar lines of two cameras, pixels (Sampson); of cameras in one place
    from the pixel that only a turn would move them to."""
    relative = second.world_to_camera @ first.camera_to_world
    rotation, shift = relative[:3, :3], relative[:3, 3]
    away = float(np.linalg.norm(shift))
    if away < 1e-3:
        turned = _rays(a, first) @ rotation.T
        there = turned[:, :2] / turned[:, 2:] * (second.fx, second.fy) + (second.cx, second.cy)
        return np.asarray(np.linalg.norm(there - b, axis=1))
    x, y, z = shift / away
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ rotation
    fundamental = _inverse_intrinsics(second).T @ essential @ _inverse_intrinsics(first)
    one, two = (np.concatenate([p, np.ones((len(p), 1))], axis=1) for p in (a, b))
    line, back = one @ fundamental.T, two @ fundamental
    above = np.abs((two * line).sum(axis=1))
    below = np.sqrt((line[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1))
    return np.asarray(above / np.maximum(below, 1e-12))


def _inverse_intrinsics(camera: Camera) -> Float64:
    return np.linalg.inv(np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]))


def _rays(pixels: Float64, camera: Camera) -> Float64:
    """(M, 3) directions in the camera's own axes."""
    return np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) @ _inverse_intrinsics(camera).T
