"""Clusters of points, against a list of all pairs."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from unveil_core.geometry.clusters import FEW_PAIRS, connected_points


def by_all_pairs(positions: np.ndarray, radius: float) -> np.ndarray:
    """(P,) clusters in the order of first occurrence."""
    pairs = cKDTree(positions).query_pairs(radius, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(positions),) * 2)
    return renumbered(connected_components(graph, directed=False)[1])


def renumbered(clusters: np.ndarray) -> np.ndarray:
    _, first, group = np.unique(clusters, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[group]


def refines(fine: np.ndarray, coarse: np.ndarray) -> bool:
    """Whether no cluster of the first is in two of the second."""
    return len(np.unique(np.stack([fine, coarse]), axis=1).T) == len(np.unique(fine))


@settings(max_examples=300, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 400),
    dimensions=st.sampled_from([2, 3]),
    radius=st.sampled_from([1e-3, 0.4, 1.0, 70.0]),
    extent=st.floats(0.1, 30.0),
    clumps=st.integers(0, 20),
    thick=st.floats(0.0, 0.5),
    offset=st.sampled_from([0.0, -17.3, 6e6]),
    stray=st.booleans(),
)
def test_the_same_clusters_as_by_all_pairs(
    seed: int,
    count: int,
    dimensions: int,
    radius: float,
    extent: float,
    clumps: int,
    thick: float,
    offset: float,
    stray: bool,
) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, extent, (count, dimensions))
    if clumps:  # dense about few places
        points = points[rng.integers(0, min(clumps, count), count)] + thick * rng.uniform(-1, 1, points.shape)
    points = points * radius + offset
    if stray:
        points[rng.integers(count)] = -6e6
    found = connected_points(points, radius)
    assert np.array_equal(found, renumbered(found))
    # Far off, coordinates are rounded.
    tolerance = 1e-9 + 8 * np.spacing(np.abs(points).max()) / radius
    assert refines(by_all_pairs(points, radius * (1 - tolerance)), found)
    assert refines(found, by_all_pairs(points, radius * (1 + tolerance)))


@pytest.mark.parametrize("gap", [0.97, 0.999, 1.001, 1.03])
@pytest.mark.parametrize("shape", ["plates", "shells", "slanted", "sticks"])
def test_dense_parts_about_a_radius_apart(shape: str, gap: float) -> None:
    rng = np.random.default_rng(3)
    count = 4000
    assert count**2 > 1000 * FEW_PAIRS
    half = np.arange(count) % 2 == 1
    points = rng.uniform(0, 1, (count, 3)) * (1.3, 1.1, 0)
    if shape == "shells":
        points = rng.normal(size=(count, 3))
        points *= (np.where(half, 0.6 + gap, 0.6) / np.linalg.norm(points, axis=1))[:, None]
    else:
        points *= {"plates": 1.0, "slanted": 1.0, "sticks": (1.0, 0.0, 0.0)}[shape]
        points[half, 2] += gap
        if shape == "slanted":
            points = points @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    expected = by_all_pairs(points, 1.0)
    # The nearest two points may be a little farther apart than the surfaces.
    assert gap == 0.999 or expected.max() == (gap > 1)
    assert np.array_equal(connected_points(points, 1.0), expected)


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize(("distance", "clusters"), [(1 - 1e-7, [0, 0]), (1 + 1e-7, [0, 1]), (1.01, [0, 1])])
def test_pairs_in_all_directions(dimensions: int, distance: float, clusters: list[int]) -> None:
    rng = np.random.default_rng(5)
    way = rng.normal(size=(400, dimensions))
    way[:50] = np.sign(way[:50])  # from corner to corner of a cell
    way *= distance / np.linalg.norm(way, axis=1, keepdims=True)
    for start, step in zip(rng.uniform(-9, 9, way.shape), way, strict=True):
        assert connected_points(np.stack([start, start + step]), 1.0).tolist() == clusters


def test_coordinates_that_differ_by_their_rounding() -> None:
    rng = np.random.default_rng(0)
    lattice = np.repeat(rng.integers(0, 24, (300, 3)), 40, axis=0)
    points = 6e6 + lattice * np.spacing(6e6)
    expected = by_all_pairs(lattice.astype(float), 3.3)
    assert 5 < expected.max() < 290
    assert np.array_equal(connected_points(points, 3.3 * np.spacing(6e6)), expected)
    # Between these there is no middle, and the mean of an odd and an even one is the larger.
    apart = np.repeat([[1, 2], [2, 1], [2, 5]], 40, axis=0)
    found = connected_points(6e6 + apart * np.spacing(6e6), 3.05 * np.spacing(6e6))
    assert np.array_equal(found, np.repeat([0, 0, 1], 40))


def test_cells_that_touch_at_a_corner() -> None:
    grid = np.array([[0, 0], [1, 1], [2, 1], [4, 1], [4, 3], [5, 4], [0, 9], [0, 0]], dtype=float)
    assert connected_points(grid, 1.5).tolist() == [0, 0, 0, 1, 2, 2, 3, 0]
    rng = np.random.default_rng(0)
    scattered = np.unique(rng.integers(0, 60, (900, 2)), axis=0).astype(float)
    assert np.array_equal(connected_points(scattered, 1.5), by_all_pairs(scattered, 1.5))


def test_few_points_and_many_at_one_place() -> None:
    for dimensions in (2, 3):
        assert connected_points(np.zeros((0, dimensions)), 1.0).shape == (0,)
        assert connected_points(np.full((1, dimensions), 6e6), 1.0).tolist() == [0]
        assert connected_points(np.full((5000, dimensions), -6e6), 1e-3).tolist() == [0] * 5000
    twice = np.repeat([[0.0, 0, 0], [1.0001, 0, 0]], 3000, axis=0)
    assert np.array_equal(connected_points(twice, 1.0), np.repeat([0, 1], 3000))
    with pytest.raises(ValueError, match="radius is 0"):
        connected_points(twice, 0.0)


def test_what_is_given_stays_as_it_is() -> None:
    points = np.random.default_rng(0).uniform(0, 3, (20_000, 3))
    before = points.copy()
    first = connected_points(points, 0.05)
    assert np.array_equal(points, before)
    assert np.array_equal(first, connected_points(points, 0.05))
    turn = np.random.default_rng(1).permutation(len(points))
    assert np.array_equal(renumbered(first[turn]), connected_points(points[turn], 0.05))


MILLIONS = """
import sys, time
import numpy as np
from unveil_core.base.process_memory import peak_memory_mb
from unveil_core.semantics.instances import cluster_points, fit_box

def car(rng, count, x):
    points = rng.uniform(-0.5, 0.5, (count, 3)).astype(np.float32)
    side = rng.integers(0, 3, count, dtype=np.uint8)
    for k in range(3):
        points[side == k, k] = np.sign(points[side == k, k]) / 2
    points *= (4.4, 1.8, 1.5)
    points += rng.normal(0, 0.01, points.shape).astype(np.float32)
    return points + np.array([x, 0.0, 0.75])

def street(rng, count):
    points = np.empty((count, 3))
    half = count // 2
    for k, extent in enumerate((500.0, 30.0, 0.02)):
        points[:half, k] = rng.uniform(0, extent, half)
    for parked in np.array_split(np.arange(half, count), 60):
        points[parked] = car(rng, len(parked), 8.0 * parked[0] / len(parked)) + (0.0, 35.0, 0.0)
    return points

def work(kind, count):
    rng = np.random.default_rng(0)
    if kind == "object":
        points = car(rng, count, 6e5)
        size = fit_box(points, np.eye(3), gap=1.0).size
        assert np.allclose(size, (4.4, 1.8, 1.5), atol=0.1), size
    else:
        points = street(rng, count)
        found = cluster_points(points, 0.4)
        assert count < 1e6 or found.max() == 61, found.max()

work(sys.argv[1], 50_000)  # compiles
before = peak_memory_mb()
work(sys.argv[1], int(sys.argv[2]) * 1_000_000)
print(peak_memory_mb() - before)
"""


@pytest.mark.parametrize(("kind", "millions"), [("object", 1), ("street", 1)])
def test_millions_of_points_take_two_hundred_bytes_each_and_come_to_an_end(kind: str, millions: int) -> None:
    """By pairs of points it would take hours, and all memory."""
    done = subprocess.run(
        [sys.executable, "-c", MILLIONS, kind, str(millions)], capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 200 * millions, done.stdout  # the points themselves are 24 bytes each of it
