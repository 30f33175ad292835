"""The map between a drive's own coordinates and those inside, at the sizes that surveyed drives have."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.base.types import Float64
from unveil_core.geometry.axes import upright
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.similarity import Similarity
from unveil_core.geometry.transforms import quat_to_rotation

TOLERANCE = 1e-9
"""Relative to the largest number that takes part."""


def vectors(size: float, count: int = 3) -> st.SearchStrategy[Float64]:
    number = st.floats(-size, size, allow_nan=False, allow_subnormal=False)
    return st.lists(number, min_size=count, max_size=count).map(np.array)


rotations = vectors(1.0, 4).filter(lambda q: np.linalg.norm(q) > 0.1).map(quat_to_rotation)
similarities = st.builds(
    Similarity, st.floats(1e-3, 1e3), rotations | st.just(np.eye(3)), vectors(6e6) | st.just(np.zeros(3))
)
local_points = vectors(5e3)


def reach(similarity: Similarity, point: Float64) -> float:
    return float(np.abs(similarity.translation).max() + similarity.scale * np.abs(point).max() + 1.0)


@given(similarities, local_points)
def test_points_come_back(similarity: Similarity, point: Float64) -> None:
    world = similarity.to_world(point)
    error = np.abs(similarity.to_local(world) - point).max() * similarity.scale
    assert error < TOLERANCE * reach(similarity, point)
    matrix = similarity.matrix @ [*point, 1.0]
    assert np.abs(matrix[:3] - world).max() < TOLERANCE * reach(similarity, point)


@given(similarities, local_points)
def test_the_inverse_goes_back(similarity: Similarity, point: Float64) -> None:
    error = np.abs(similarity.inverse.to_world(similarity.to_world(point)) - point).max() * similarity.scale
    assert error < TOLERANCE * reach(similarity, point)


@given(similarities, similarities, local_points)
def test_one_after_another(outer: Similarity, inner: Similarity, point: Float64) -> None:
    both = outer.after(inner)
    stepwise = outer.to_world(inner.to_world(point))
    assert np.abs(both.to_world(point) - stepwise).max() < TOLERANCE * reach(outer, np.array([reach(inner, point)]))


@given(similarities, vectors(1.0).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_directions_keep_their_length(similarity: Similarity, direction: Float64) -> None:
    turned = similarity.directions_to_world(direction)
    assert np.linalg.norm(turned) == pytest.approx(np.linalg.norm(direction), rel=1e-12)
    assert np.allclose(similarity.directions_to_local(turned), direction, atol=1e-12)


@given(similarities, rotations, vectors(100.0), vectors(50.0))
def test_a_camera_sees_the_same_picture(
    similarity: Similarity, rotation: Float64, centre: Float64, point: Float64
) -> None:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ centre
    camera = Camera(640, 480, 500.0, 500.0, 320.0, 240.0, pose)
    placed = similarity.camera_to_world(camera)
    # What the pose's translation, as large as the coordinates, rounds away.
    slack = 1e-15 * reach(similarity, centre) * 10
    depth, there = camera.project(point[None])[1][0], placed.project(similarity.to_world(point)[None])[1][0]
    assert there == pytest.approx(similarity.scale * depth, abs=slack + 1e-9 * similarity.scale)
    again = similarity.camera_to_local(placed)
    assert np.abs(again.centre - centre).max() * similarity.scale < slack + 1e-9 * similarity.scale
    assert np.abs(again.world_to_camera[:3, :3] - rotation).max() < 1e-12


@given(similarities)
def test_json_keeps_every_bit(similarity: Similarity) -> None:
    again = Similarity.from_json(json.loads(json.dumps(similarity.to_json())))
    assert again.scale == similarity.scale and np.array_equal(again.matrix, similarity.matrix)


@given(vectors(6e6), vectors(5e3))
def test_metres_with_z_up_are_shifted_and_nothing_else(shift: Float64, point: Float64) -> None:
    similarity = Similarity(1.0, upright(np.array([0.0, 0.0, 1.0])), shift)
    assert similarity.shifts_only
    assert np.array_equal(similarity.to_world(point), point + shift)
    assert np.array_equal(similarity.to_local(point), point - shift)


@given(vectors(1.0).filter(lambda v: np.linalg.norm(v) > 1e-3))
def test_upright_axes(up: Float64) -> None:
    rotation = upright(up)
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-12) and np.linalg.det(rotation) > 0
    assert np.allclose(rotation[:, 2], up / np.linalg.norm(up), atol=1e-12)


@pytest.mark.parametrize(
    ("scale", "rotation", "translation"),
    [
        (0.0, np.eye(3), np.zeros(3)),
        (-1.0, np.eye(3), np.zeros(3)),
        (float("nan"), np.eye(3), np.zeros(3)),
        (1.0, 2 * np.eye(3), np.zeros(3)),
        (1.0, np.diag([1.0, 1, -1]), np.zeros(3)),
        (1.0, np.eye(2), np.zeros(3)),
        (1.0, np.eye(3), np.array([0, np.inf, 0])),
    ],
)
def test_what_is_no_similarity_says_so(scale: float, rotation: Float64, translation: Float64) -> None:
    with pytest.raises(ValueError):
        Similarity(scale, rotation, translation)
