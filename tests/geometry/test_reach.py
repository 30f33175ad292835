"""Which cameras come near some points."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from unveil_core.geometry.camera import Camera
from unveil_core.geometry.reach import CameraViews, cameras_near

PLACES = arrays(np.float64, st.tuples(st.integers(1, 12), st.just(3)), elements=st.floats(-50, 50))


@given(PLACES, PLACES, st.floats(0, 80))
def test_no_camera_that_is_near_a_point_is_missing(centres: np.ndarray, points: np.ndarray, reach: float) -> None:
    near = set(cameras_near(centres, points, reach).tolist())
    gap = np.linalg.norm(centres[:, None] - points[None], axis=2).min(axis=1)
    assert set(np.flatnonzero(gap < reach * (1 - 1e-12)).tolist()) <= near


def test_a_camera_far_off_is_not_asked() -> None:
    centres = np.array([[0.0, 0, 0], [500, 0, 0]])
    assert cameras_near(centres, np.array([[10.0, 3, 0], [30, -3, 0]]), 100.0).tolist() == [0]
    assert cameras_near(centres, np.zeros((0, 3)), 100.0).tolist() == []


def test_a_camera_that_looks_the_other_way_is_not_asked() -> None:
    ahead, back = np.eye(4), np.diag([-1.0, 1, -1, 1])
    cameras = [Camera(60, 40, 50.0, 50.0, 30.0, 20.0, pose) for pose in (ahead, back)]
    views = CameraViews(cameras, cameras)
    assert views.around(np.array([[0.0, 0, 10], [1, 0, 12]]), 100.0).tolist() == [0]
    assert views.around(np.zeros((0, 3)), 100.0).tolist() == []


@given(st.integers(0, 10_000))
def test_a_box_of_which_a_place_is_shown_may_be_shown(seed: int) -> None:
    generator = np.random.default_rng(seed)
    cameras = []
    for _ in range(4):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.random(random_state=generator.integers(1 << 30)).as_matrix()
        pose[:3, 3] = generator.uniform(-20, 20, 3)
        cameras.append(Camera(60, 40, 50.0, 40.0, 20.0, 25.0, pose))
    points = generator.uniform(-20, 20, (6, 1, 3)) + generator.uniform(0, 1, (6, 1, 1)) * generator.normal(
        size=(6, 9, 3)
    )
    views = CameraViews(cameras, cameras)
    may = views.may_show(np.arange(4), points.min(axis=1), points.max(axis=1), 15.0)
    for v, camera in enumerate(cameras):
        shown = camera.in_picture(*camera.project(points.reshape(-1, 3))).reshape(6, 9)
        near = np.linalg.norm(points - camera.centre, axis=2) < 15.0
        assert may[v][(shown & near).any(axis=1)].all()
        for k in np.flatnonzero((shown & near).any(axis=1)):
            assert v in views.around(points[k], 15.0)
    assert not views.may_show(np.arange(4), points.min(axis=1), points.max(axis=1), 0.0)[:, :3].all()
