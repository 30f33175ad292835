"""What of a long scene a camera is given."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.geometry.camera import Camera
from unveil_core.raster.near_camera import CELL_M, REACH_M, near_camera, near_cameras, near_runs
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels


def scene(extent: float, count: int = 3000, size: float = 0.1) -> Surfels:
    """Surfels of a size strewn over a square about the origin."""
    generator = np.random.default_rng(0)
    points = np.column_stack([generator.uniform(-extent, extent, (count, 2)), generator.uniform(0, 5, count)])
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    return surfels_from_points(points, np.zeros((count, 3), np.uint8), np.arange(count) % 5, up, np.full(count, size))


def camera_at(east: float, north: float) -> Camera:
    pose = np.eye(4)
    pose[:3, 3] = (-east, -north, -1.5)
    return Camera(8, 8, 8.0, 8.0, 4.0, 4.0, pose)


LONG = scene(600.0)


@given(st.floats(-650, 650), st.floats(-650, 650))
def test_all_within_reach_are_given_and_nothing_far_beyond(east: float, north: float) -> None:
    distance = np.linalg.norm(LONG.means.numpy()[:, :2] - (east, north), axis=1)
    found = near_camera(LONG, camera_at(east, north))
    where = {tuple(m) for m in found.means.numpy().tolist()}
    inside = [tuple(m) in where for m in LONG.means.numpy().tolist()]
    assert np.all(np.array(inside)[distance < REACH_M])
    assert distance[inside].max(initial=0) < REACH_M + CELL_M * 2**0.5 + 1e-3
    assert len(found) == sum(inside)


def test_what_stands_for_a_skyline_is_given_however_far_it_is() -> None:
    speck, wide = scene(2000.0, 300, size=0.5), scene(2000.0, 300, size=5.0)
    far = np.linalg.norm(speck.means.numpy()[:, :2], axis=1) > 1000
    given_of = [len(near_camera(part.select(torch.from_numpy(far)), camera_at(0, 0))) for part in (speck, wide)]
    assert given_of == [0, int(far.sum())]


def test_a_short_drive_is_given_whole_and_cameras_side_by_side_the_same() -> None:
    short = scene(100.0)
    assert near_camera(short, camera_at(3, 4)) is short is near_camera(short, camera_at(4, 3))
    assert near_camera(LONG, camera_at(3, 4)) is near_camera(LONG, camera_at(9, 20))
    assert near_camera(LONG, camera_at(3, 4)) is not near_camera(LONG, camera_at(300, 4))


@given(st.lists(st.tuples(st.floats(-650, 650), st.floats(-650, 650)), max_size=4))
def test_of_what_some_cameras_are_given_each_is_given_the_same(places: list[tuple[float, float]]) -> None:
    cameras = [camera_at(*place) for place in places]
    together = near_cameras(LONG, cameras)
    assert len(together) <= sum(len(near_camera(LONG, c)) for c in cameras)
    for camera in cameras:
        a, b = near_camera(LONG, camera), near_camera(together, camera)
        assert torch.equal(a.means, b.means) and torch.equal(a.labels, b.labels)
    short = scene(100.0)
    assert near_cameras(short, [camera_at(3, 4)]) is short


@given(st.lists(st.tuples(st.floats(-650, 650), st.floats(-650, 650)), max_size=6))
def test_cameras_in_runs_keep_their_order_and_what_each_is_given(places: list[tuple[float, float]]) -> None:
    cameras = [camera_at(*place) for place in places for _ in range(2)]
    runs = list(near_runs(LONG, cameras))
    assert [camera for run, _ in runs for camera in run] == cameras and len(runs) <= len(places)
    for run, near in runs:
        for camera in run:
            assert torch.equal(LONG.select(near).means, near_camera(LONG, camera).means)


def test_a_scene_is_not_kept_alive() -> None:
    for extent in (50.0, 400.0):
        surfels = scene(extent, 200)
        near_camera(surfels, camera_at(0, 0))
        gone = weakref.ref(surfels)
        del surfels
        gc.collect()
        assert gone() is None


def test_nothing_gives_nothing() -> None:
    empty = LONG.select(torch.zeros(len(LONG), dtype=torch.bool))
    assert len(near_camera(empty, camera_at(0, 0))) == 0
