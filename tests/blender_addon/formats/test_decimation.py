"""Meshes decimated for the view: few enough triangles, in the same place and colours, and without holes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blender_addon.formats import decimation
from blender_addon.formats.decimation import decimated


def sheet(rows: int, columns: int, *, cell: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a level rectangle."""
    i, j = np.meshgrid(np.arange(rows + 1), np.arange(columns + 1), indexing="ij")
    places = np.stack([i.ravel() * cell, j.ravel() * cell, np.zeros(i.size)], axis=1)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    right, below, both = corner + 1, corner + columns + 1, corner + columns + 2
    return places, np.stack([corner, below, both, corner, both, right], axis=1).reshape(-1, 3)


def ball(rings: int, segments: int) -> tuple[np.ndarray, np.ndarray]:
    """A closed ball of radius 1."""
    down, around = np.arange(1, rings) * np.pi / rings, np.arange(segments) * 2 * np.pi / segments
    a, b = np.meshgrid(down, around, indexing="ij")
    belt = np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], axis=2).reshape(-1, 3)
    places = np.concatenate([belt, [[0, 0, 1.0], [0, 0, -1.0]]])
    triangles = []
    for k in range(segments):
        n = (k + 1) % segments
        triangles += [(len(belt), k, n), (len(belt) + 1, len(belt) - segments + n, len(belt) - segments + k)]
        for r in range(rings - 2):
            p, q = r * segments, (r + 1) * segments
            triangles += [(p + k, q + k, q + n), (p + k, q + n, p + n)]
    return places, np.array(triangles)


def area_and_volume(places: np.ndarray, triangles: np.ndarray) -> tuple[float, float]:
    a, b, c = (places[triangles[:, i]] for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2), float((a * np.cross(b, c)).sum() / 6)


def without_flaps(triangles: np.ndarray) -> np.ndarray:
    """What is left when triangles with an edge of their own go, again and again: nothing, where there is a hole."""
    while len(triangles):
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        _, which, counts = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
        shared = (counts[which.reshape(-1, 3)] > 1).all(axis=1)
        if shared.all():
            break
        triangles = triangles[shared]
    return triangles


meshes = st.builds(
    lambda seed, count, faces, scale, far: _soup(seed, count, faces, scale, far),
    st.integers(0, 2**32 - 1),
    st.integers(1, 80),
    st.integers(1, 300),
    st.sampled_from((1e-6, 1.0, 1e4)),
    st.sampled_from((0.0, 1e3, 1e12)),
)


def _soup(seed: int, count: int, faces: int, scale: float, far: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Any triangles at all, with a vertex far away."""
    generator = np.random.default_rng(seed)
    places = generator.normal(0, scale, (count, 3)).astype(np.float32).astype(np.float64)
    places[0, seed % 3] += far
    colors = generator.integers(0, 256, (count, 3)).astype(np.uint8)
    return places, generator.integers(0, count, (faces, 3)).astype(np.int32), colors


@given(meshes, st.integers(0, 320))
def test_any_mesh_gets_few_enough_triangles_that_are_sound(mesh, most: int) -> None:  # type: ignore[no-untyped-def]
    places, triangles, colors = mesh
    found = decimated(places, triangles, colors, most)
    assert len(found.triangles) <= max(most, 0) or len(triangles) <= most
    if len(triangles) <= most:
        assert found.vertices is places and found.triangles is triangles and found.cell == 0
        return
    assert found.colors is not None and len(found.colors) == len(found.vertices)
    assert found.triangles.dtype == np.int32 and np.isfinite(found.vertices).all()
    assert set(found.triangles.ravel()) == set(range(len(found.vertices)))  # none is missing, none is left over
    ordered = np.sort(found.triangles, axis=1)
    assert (ordered[:, 0] < ordered[:, 1]).all() and (ordered[:, 1] < ordered[:, 2]).all()
    assert len(np.unique(ordered, axis=0)) == len(ordered)
    rounding = 1e-9 * np.abs(places).max()
    for vertex, color in zip(found.vertices, found.colors, strict=True):
        near = (np.abs(places - vertex) <= found.cell + rounding).all(axis=1)
        assert near.any()  # in place and in colour between vertices that are not farther than a cell
        assert (colors[near].min(axis=0) <= color).all() and (color <= colors[near].max(axis=0)).all()


@given(st.integers(20, 60), st.integers(20, 60), st.floats(0.05, 0.6))
def test_a_road_stays_flat_and_whole(rows: int, columns: int, share: float) -> None:
    places, triangles = sheet(rows, columns)
    colors = np.full((len(places), 3), (90, 80, 70), np.uint8)
    most = int(share * len(triangles))
    found = decimated(places, triangles, colors, most)
    assert most / 3 < len(found.triangles) <= most
    assert (found.vertices[:, 2] == 0).all() and (found.colors == (90, 80, 70)).all()
    for end in ("min", "max"):
        moved = getattr(places, end)(axis=0) - getattr(found.vertices, end)(axis=0)
        assert (np.abs(moved) <= found.cell).all()
    # Without holes or folds: what is there is the rectangle, less up to half of a cell at its edges.
    area, _ = area_and_volume(found.vertices, found.triangles)
    length, width = (v - found.cell for v in (rows * 0.1, columns * 0.1))
    assert max(length, 0) * max(width, 0) <= area * (1 + 1e-9) and area <= rows * columns * 0.01 * (1 + 1e-9)
    a, b, c = (found.vertices[found.triangles[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()  # nothing is turned over


@given(st.integers(20, 35), st.floats(0.1, 0.5), st.tuples(*[st.floats(-50, 50)] * 3))
def test_what_is_closed_stays_closed(rings: int, share: float, middle: tuple[float, float, float]) -> None:
    places, triangles = ball(rings, 2 * rings)
    found = decimated(places + np.array(middle), triangles, None, int(share * len(triangles)))
    assert found.colors is None and len(without_flaps(triangles)) == len(triangles)
    assert len(without_flaps(found.triangles)) > 0.85 * len(found.triangles)
    local = found.vertices - np.array(middle)
    assert np.abs(np.linalg.norm(local, axis=1) - 1).max() < found.cell
    (area, volume), (was, filled) = (area_and_volume(*m) for m in ((local, found.triangles), (places, triangles)))
    assert 0.75 * was < area <= 1.02 * was and 0.8 * filled < volume <= filled


def test_a_hole_is_told() -> None:
    """By the yardstick of the test above."""
    _, triangles = ball(10, 20)
    assert len(without_flaps(triangles)) == len(triangles) and len(without_flaps(triangles[1:])) == 0


def test_a_thin_wall_is_no_hole() -> None:
    """Its sides are nearer to each other than cells are large: one of them is left."""
    front, triangles = sheet(100, 100)
    places = np.concatenate([front, front + (0, 0, 0.004)])
    both = np.concatenate([triangles, triangles[:, ::-1] + len(front)])
    found = decimated(places, both, None, 2000)
    area, _ = area_and_volume(found.vertices, found.triangles)
    assert found.cell > 0.2 and area > 0.9 * 100


def test_one_that_lies_far_outside_costs_no_detail_elsewhere() -> None:
    places, triangles = sheet(100, 100)
    places = np.concatenate([places, [[1e9, -1e9, 1e9]]])
    found = decimated(places, triangles, None, 5000)
    assert len(found.triangles) > 2000 and 0.1 < found.cell < 0.4


@pytest.mark.parametrize("slots", [8, 1 << 10])
def test_the_way_of_counting_is_none_of_the_result_s_business(monkeypatch: pytest.MonkeyPatch, slots: int) -> None:
    places, triangles = sheet(60, 60)
    found = decimated(places, triangles, None, 1500)
    monkeypatch.setattr(decimation, "_numbered", lambda cells: np.unique(cells, return_inverse=True)[1])
    other = decimated(places, triangles, None, 1500)
    assert np.array_equal(found.vertices, other.vertices) and np.array_equal(found.triangles, other.triangles)
    monkeypatch.setattr(decimation, "SLOTS", slots)
    assert 0 < len(decimated(places, triangles, None, 1500).triangles) <= 1500
