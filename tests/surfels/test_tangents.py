"""Surfels follow the lines of the points that they start from."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.tangents import ASPECT, tangent_frames


def axes(quats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first two columns of the rotations."""
    w, x, y, z = quats.T
    first = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1)
    second = np.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], axis=1)
    return first, second


@pytest.mark.parametrize("gap", [0.1, 0.15, 0.3])
@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.3, -0.5, 0.8)])
def test_a_plane_sampled_in_lines_gets_surfels_across_them(normal: tuple[float, float, float], gap: float) -> None:
    true = np.array(normal) / np.linalg.norm(normal)
    line = np.cross(true, (0.2, 1.0, 0.1))
    line /= np.linalg.norm(line)
    across = np.cross(true, line)
    along = np.arange(40) * 0.05
    grid = along[:, None, None] * line + (np.arange(12) * gap)[None, :, None] * across
    points = grid.reshape(-1, 3)
    quats, factors = tangent_frames(points, np.repeat(true[None], len(points), axis=0))
    inner = np.zeros((40, 12), bool)
    inner[4:-4, 2:-2] = True
    inner = inner.ravel()
    first, second = axes(quats)
    assert np.abs(np.cross(first, second) - true).max() < 1e-9
    narrow = np.where((factors[:, 0] < factors[:, 1])[:, None], first, second)
    assert np.abs(narrow[inner] @ line).min() > 0.99
    ratio = factors.max(axis=1) / factors.min(axis=1)
    if gap <= 0.15:
        assert ratio[inner] == pytest.approx(gap / 0.05, rel=0.05)
    assert ratio.max() <= ASPECT * (1 + 1e-9)
    assert factors.prod(axis=1) == pytest.approx(1.0)


def test_axes_and_sizes_reach_the_surfels() -> None:
    x, y = np.meshgrid(np.arange(20) * 0.05, np.arange(8) * 0.15)
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    up = np.repeat([[0.0, 0.0, 1.0]], len(points), axis=0)
    quats, factors = tangent_frames(points, up)
    made = surfels_from_points(
        points,
        np.zeros((len(points), 3), np.uint8),
        np.zeros(len(points), np.int64),
        up,
        0.1 * factors,
        quats=quats,
        scale_factor=1.0,
    )
    assert torch.allclose(made.normals(), torch.from_numpy(up).float(), atol=1e-6)
    assert torch.allclose(made.log_scales.exp(), torch.from_numpy(0.1 * factors).float())


@pytest.mark.parametrize("points", [np.zeros((9, 3)), np.arange(6.0).reshape(2, 3)])
def test_coinciding_or_few_points_are_no_failure(points: np.ndarray) -> None:
    quats, factors = tangent_frames(points, np.repeat([[0.0, 0.0, 1.0]], len(points), axis=0))
    assert np.isfinite(quats).all() and (factors == 1).all()


def test_a_single_line_says_nothing_of_its_width() -> None:
    pole = np.stack([np.zeros(30), np.zeros(30), np.arange(30) * 0.05], axis=1)
    _, factors = tangent_frames(pole, np.repeat([[1.0, 0.0, 0.0]], 30, axis=0))
    assert factors == pytest.approx(1.0)
