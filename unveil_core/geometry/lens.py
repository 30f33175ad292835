"""Lens distortion, as OpenCV models it: from normalized pinhole coordinates to those of a distorted picture, and back."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from unveil_core.base.types import Float64

__all__ = ["FISHEYE", "distorted", "undistorted"]

FISHEYE = "OPENCV_FISHEYE"
"""Name of the model with four coefficients of the angle; all others are OpenCV's rational model."""
ROUNDS, CLOSE = 40, 1e-10
"""Steps of undistorting at most, and the change at which they end, of normalized coordinates: a thousandth of a pixel is 1e-6."""
IDENTITY = np.eye(3)


def distorted(model: str, coefficients: Sequence[float], normalized: Float64) -> Float64:
    """(N, 2) distorted coordinates of pinhole ones (N, 2), both as x/z and y/z; NaN stays NaN."""
    if not len(normalized):
        return normalized
    k = np.asarray(coefficients, dtype=np.float64)
    if model == FISHEYE:
        return cv2.fisheye.distortPoints(normalized[:, None], IDENTITY, k)[:, 0].astype(np.float64)
    points = np.concatenate([normalized, np.ones((len(normalized), 1))], axis=1)
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), IDENTITY, k)[0][:, 0].astype(np.float64)


def undistorted(model: str, coefficients: Sequence[float], positions: Float64) -> Float64:
    """(N, 2) pinhole coordinates of distorted ones (N, 2): the inverse of :func:`distorted`."""
    if not len(positions):
        return positions
    k = np.asarray(coefficients, dtype=np.float64)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, ROUNDS, CLOSE)
    if model == FISHEYE:
        return cv2.fisheye.undistortPoints(positions[:, None], IDENTITY, k, criteria=criteria)[:, 0].astype(np.float64)
    return cv2.undistortPointsIter(positions[:, None], IDENTITY, k, None, None, criteria)[:, 0].astype(np.float64)
