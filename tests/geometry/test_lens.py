"""Lens distortion and its inverse, against OpenCV's formulas written out."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.geometry.lens import FISHEYE, distorted, undistorted

LENSES = {
    "barrel": ("OPENCV", (-0.28, 0.09, 0.0005, -0.0003, -0.012, 0.0, 0.0, 0.0)),
    "pincushion": ("OPENCV", (0.12, 0.03, -0.001, 0.002, 0.004, 0.0, 0.0, 0.0)),
    "rational": ("OPENCV", (0.6, 0.2, 0.0002, -0.0004, 0.01, 0.95, 0.35, 0.05)),
    "fisheye": (FISHEYE, (0.05, -0.012, 0.004, -0.001)),
}


def by_hand(model: str, k: tuple[float, ...], x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if model == FISHEYE:
        r = np.hypot(x, y)
        angle = np.arctan(r)
        bent = angle * (1 + k[0] * angle**2 + k[1] * angle**4 + k[2] * angle**6 + k[3] * angle**8)
        ratio = np.where(r > 0, bent / np.maximum(r, 1e-12), 1.0)
        return x * ratio, y * ratio
    k1, k2, p1, p2, k3, k4, k5, k6 = k
    r2 = x * x + y * y
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


@pytest.mark.parametrize("lens", LENSES)
def test_distorting_is_opencv_s_formula_and_undistorting_its_inverse(lens: str) -> None:
    model, coefficients = LENSES[lens]
    x, y = np.meshgrid(np.linspace(-0.7, 0.7, 41), np.linspace(-0.45, 0.45, 31))
    flat = np.stack([x.ravel(), y.ravel()], axis=1)
    bent = distorted(model, coefficients, flat)
    assert np.abs(bent - np.stack(by_hand(model, coefficients, *flat.T), axis=1)).max() < 1e-9
    assert np.abs(bent - flat).max() > 0.01
    assert np.abs(undistorted(model, coefficients, bent) - flat).max() < 1e-6


@pytest.mark.parametrize("lens", LENSES)
def test_no_places_at_all(lens: str) -> None:
    model, coefficients = LENSES[lens]
    assert distorted(model, coefficients, np.zeros((0, 2))).shape == (0, 2)
    assert undistorted(model, coefficients, np.zeros((0, 2))).shape == (0, 2)
