"""Distances between surfaces: known shapes have known ones."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.evaluate.geometry import depth_points, surface_distances
from unveil_core.geometry.camera import Camera


def plane(height: float, step: float = 0.1, size: float = 4.0) -> np.ndarray:
    x, y = np.meshgrid(np.arange(0, size, step), np.arange(0, size, step))
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, height)], 1)


def test_a_shifted_plane_is_as_far_as_it_was_shifted() -> None:
    d = surface_distances(plane(0.2), plane(0.0))
    assert d.chamfer == pytest.approx(0.2)
    assert d.f_score(0.25) == 1.0 and d.f_score(0.15) == 0.0


def test_what_is_missing_costs_recall_and_what_is_too_much_precision() -> None:
    true = plane(0.0)
    half = true[true[:, 0] < 2.0]
    missing = surface_distances(half, true)
    assert missing.precision(0.01) == 1.0 and missing.recall(0.01) == pytest.approx(0.5, abs=0.03)
    much = surface_distances(true, half)
    assert much.recall(0.01) == 1.0 and much.precision(0.01) == pytest.approx(0.5, abs=0.03)
    assert missing.f_score(0.01) == pytest.approx(2 / 3, abs=0.03)
    # Where the truth says nothing, nothing counts against what was found.
    assert surface_distances(true, half, crop=0.3).precision(0.31) == 1.0
    assert surface_distances(true, half, reference=true).precision(0.01) == 1.0


def test_nothing_found_is_no_crash() -> None:
    d = surface_distances(np.zeros((0, 3)), plane(0.0))
    assert d.chamfer == float("inf") and d.f_score(1.0) == 0.0


def test_depth_of_fewer_pixels_lies_on_the_same_plane() -> None:
    camera = Camera(40, 20, 30.0, 30.0, 20.0, 10.0, np.eye(4))
    points = depth_points(camera, np.full((10, 20), 5.0), np.ones((10, 20), bool))
    np.testing.assert_allclose(points[:, 2], 5.0)
    # The outer pixels' centres, seen from the middle.
    assert np.abs(points[:, 0]).max() == pytest.approx(5 * 19 / 30)
    assert not len(depth_points(camera, np.full((20, 40), np.inf), np.ones((20, 40), bool)))
