"""Which points a view sees, at any size of the picture: a wall of points is a wall."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.geometry.camera import Camera
from unveil_core.semantics import visibility
from unveil_core.semantics.visibility import points_in_view

SPACING = 0.25


def view(width: int) -> Camera:
    """70 degrees wide."""
    focal = width / 1.4
    return Camera(width, width * 2 // 3, focal, focal, width / 2, width / 3, np.eye(4))


def wall(distance: float, spacing: float) -> np.ndarray:
    """(N, 3) points on a plane before the camera, all in the picture."""
    half = 0.65 * distance
    x, y = np.meshgrid(np.arange(-half, half, spacing), np.arange(-half / 1.6, half / 1.6, spacing))
    return np.stack([x, y, np.full_like(x, distance)], axis=-1).reshape(-1, 3)


@pytest.mark.parametrize("width", [96, 384, 768, 1600, 1920, 3840])
@pytest.mark.parametrize("turned", [False, True], ids=["facing the camera", "with normals"])
def test_a_wall_of_points_hides_what_is_behind_it(width: int, turned: bool) -> None:
    near, far = wall(5.0, SPACING), wall(8.0, 0.11)
    points, camera = np.concatenate([near, far]), view(width)
    normals = np.tile([0.0, 0.0, -1.0], (len(points), 1)) if turned else None
    seen = points_in_view(points, np.repeat([SPACING, 0.11], [len(near), len(far)]), camera, near=0.1, normals=normals)
    found = np.zeros(len(points), bool)
    found[seen.index] = True
    assert found[: len(near)].all()
    # What the wall covers, seen from the camera.
    behind = (np.abs(far[:, :2]) / 8.0 < np.array([0.62, 0.62 / 1.6])).all(axis=1)
    assert behind.sum() > 1500 and not found[len(near) :][behind].any()


@pytest.mark.parametrize("width", [384, 1920])
def test_beside_a_wall_everything_is_seen(width: int) -> None:
    near, far = wall(5.0, SPACING), wall(8.0, 0.11)
    near = near[near[:, 0] < 0]
    points = np.concatenate([near, far])
    seen = points_in_view(points, np.full(len(points), SPACING), view(width), near=0.1)
    beside = far[:, 0] / 8.0 > SPACING / 5.0
    assert np.isin(len(near) + np.flatnonzero(beside), seen.index).all()


def test_no_point_costs_more_than_a_small_square(monkeypatch: pytest.MonkeyPatch) -> None:
    """However large it is in the picture: points a metre apart half a metre away, and ground seen from just above it."""
    drawn = []

    def draw(x, y, depth, half_x, half_y, buffer):  # type: ignore[no-untyped-def]
        drawn.append(float((2 * half_x.max() + 1) * (2 * half_y.max() + 1)))
        return original(x, y, depth, half_x, half_y, buffer)

    original = visibility._draw
    monkeypatch.setattr(visibility, "_draw", draw)
    points = np.random.default_rng(0).uniform((-0.3, -0.2, 0.3), (0.3, 0.2, 0.7), (500, 3))
    normals = np.tile([0.0, -1.0, 0.0], (500, 1))
    points_in_view(points, np.full(500, 1.0), view(3840), near=0.1, normals=normals)
    assert drawn and max(drawn) <= 49**2
