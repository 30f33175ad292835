"""Points: normals, spacing, thinning."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from unveil_core.base.parallel import threads
from unveil_core.geometry.cloud import AT_ONCE, estimate_normals, neighbours_of, quats_from_normals, thin_points
from unveil_core.surfels.surfels import rotations


def test_normals_of_a_tilted_plane_face_the_viewer() -> None:
    generator = np.random.default_rng(0)
    true = np.array([0.3, -0.2, 0.9])
    true /= np.linalg.norm(true)
    basis = np.linalg.svd(true[None])[2][1:]
    points = generator.uniform(-2, 2, (2000, 2)) @ basis + generator.normal(0, 0.002, (2000, 3))
    normal, spacing = estimate_normals(points, 5 * true[None])
    assert np.median(normal @ true) > 0.99
    assert (normal @ true > 0).all()
    assert 0.02 < np.median(spacing) < 0.15


@pytest.mark.parametrize("several", [1, 3])
def test_neighbours_are_those_of_the_tree_and_an_error_in_any_thread_arrives(several: int) -> None:
    points = np.random.default_rng(0).uniform(-5, 5, (2 * AT_ONCE + 5, 3))
    tree = cKDTree(points[::4])
    with threads(several):
        for found, expected in zip(neighbours_of(points, tree, 3), tree.query(points, k=3), strict=True):
            assert (found == expected).all() and found.dtype == expected.dtype
        assert neighbours_of(points[:0], tree, 3)[1].shape == (0, 3)
        points[-1] = np.nan
        with pytest.raises(ValueError, match="finite"):
            neighbours_of(points, tree, 3)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_handful_of_points_is_no_failure(count: int) -> None:
    normal, spacing = estimate_normals(np.arange(3.0 * count).reshape(count, 3), np.array([[0.0, 0.0, 9.0]]))
    assert np.isfinite(normal).all() and (spacing > 0).all()


def test_quats_turn_z_to_the_normal() -> None:
    generator = np.random.default_rng(1)
    wanted = generator.normal(size=(200, 3))
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    wanted[0] = (0, 0, -1)
    wanted[1] = (0, 0, 1)
    got = rotations(torch.from_numpy(quats_from_normals(wanted)))[..., 2].numpy()
    assert np.abs(got - wanted).max() < 1e-6


def test_thinning_keeps_one_point_per_cell() -> None:
    generator = np.random.default_rng(2)
    points = generator.uniform(0, 1, (5000, 3))
    keep = thin_points(points, 0.25)
    assert len(keep) == 64
    assert len({tuple(c) for c in np.floor(points[keep] / 0.25).astype(int)}) == 64
    finer = thin_points(points, np.where(points[:, 0] < 0.5, 0.125, 0.25))
    assert len(keep) < len(finer) < 5000


@given(st.integers(0, 400), st.floats(0.02, 3.0), st.integers(0, 2**32 - 1))
def test_thinning_keeps_the_first_point_of_each_cell(count: int, side: float, seed: int) -> None:
    """Against sorting, for cells of several sizes and on both sides of the origin."""
    generator = np.random.default_rng(seed)
    points, cell = generator.normal(0, 2, (count, 3)), side * 2.0 ** generator.integers(0, 3, count)
    smallest = cell.min(initial=np.inf)
    level = np.round(np.log2(np.maximum(cell / smallest, 1.0)))
    key = np.column_stack([np.floor(points / (smallest * 2.0**level)[:, None]), level])
    expected = np.sort(np.unique(key, axis=0, return_index=True)[1]) if count else np.zeros(0, dtype=np.int64)
    np.testing.assert_array_equal(thin_points(points, cell), expected)
