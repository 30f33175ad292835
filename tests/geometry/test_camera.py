"""What lies in a camera's picture."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.geometry.camera import Camera

CAMERA = Camera(96, 64, 60.0, 50.0, 48.0, 32.0, np.eye(4))


@given(st.floats(-20, 120), st.floats(-20, 90), st.floats(-5, 50).filter(lambda z: abs(z) > 0.1))
def test_a_point_is_in_the_picture_where_its_pixel_exists(x: float, y: float, z: float) -> None:
    point = np.array([[(x - 48.0) / 60.0 * z, (y - 32.0) / 50.0 * z, z]])
    pixels, depth = CAMERA.project(point)
    inside = bool(CAMERA.in_picture(pixels, depth)[0])
    assert inside == (z > 0 and 0 <= pixels[0, 0] < 96 and 0 <= pixels[0, 1] < 64)
    assert not CAMERA.in_picture(pixels, depth, nearest=z).any()


def test_borders_belong_to_the_picture_on_two_sides() -> None:
    pixels = np.array([[0.0, 0.0], [95.99, 63.99], [96.0, 10.0], [10.0, 64.0], [-1e-9, 10.0], [np.nan, 10.0]])
    assert CAMERA.in_picture(pixels, np.ones(6)).tolist() == [True, True, False, False, False, False]


def test_beside_the_plane_of_the_camera_no_number_is_too_large() -> None:
    pixels, depth = CAMERA.project(np.array([[1.0, -1.0, 1e-307], [1.0, -1.0, 0.0]]))
    assert (pixels[:, 0] == np.inf).all() and (pixels[:, 1] == -np.inf).all() and depth.tolist() == [1e-307, 0.0]
    assert not CAMERA.in_picture(pixels, depth).any()


@given(st.integers(0, 2**32 - 1), st.integers(0, 300))
def test_shown_points_are_those_that_fall_into_the_picture(seed: int, count: int) -> None:
    """Points around, behind and in the plane of the camera: the same as by :meth:`Camera.project`, in the same order."""
    generator = np.random.default_rng(seed)
    pose = np.eye(4)
    pose[:3, :3] = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    pose[:3, 3] = generator.normal(0, 5, 3)
    camera = Camera(64, 48, 50.0, 45.0, 30.0, 25.0, pose)
    points = generator.normal(0, 8, (count, 3))
    points[::7] = camera.centre
    pixels, depth = camera.project(points)
    expected = np.flatnonzero(camera.in_picture(pixels, depth, nearest=0.2) & (depth < 9.0))
    index, found, away = camera.shown(points, nearest=0.2, furthest=9.0)
    np.testing.assert_array_equal(index, expected)
    np.testing.assert_allclose(found, pixels[expected], atol=1e-9)
    np.testing.assert_allclose(away, depth[expected], atol=1e-12)


def test_a_homography_takes_what_lies_on_a_plane_to_where_another_camera_shows_it() -> None:
    here = Camera(64, 48, 50.0, 55.0, 31.0, 25.5, np.eye(4))
    there = replace(here.moved(right=0.4, up=-0.2, ahead=1.0), fx=60.0, cx=30.0)
    normal, distance = np.array([0.0, 0.6, 0.8]), 4.0
    found = here.homography(there, normal, distance)
    assert found is not None
    pixels = np.array([[10.0, 12.0], [50.0, 30.0], [33.0, 41.0]])
    rays = here.rays_at(pixels)
    at, depth = there.project(here.centre + rays * (distance / (rays @ normal))[:, None])
    assert (depth > 0).all()
    moved = np.column_stack([pixels - 0.5, np.ones(3)]) @ found.T
    np.testing.assert_allclose(moved[:, :2] / moved[:, 2:] + 0.5, at, atol=1e-9)


def test_intrinsics_for_pixels_by_the_field_and_by_opencv() -> None:
    """K and viewmat project as :meth:`Camera.project`; functions of cv2 count from the centre of the first pixel."""
    camera = replace(CAMERA.moved(right=0.3, up=-0.2, ahead=0.5), cx=47.3)
    points = np.array([[0.5, -0.4, 3.0], [-1.0, 0.8, 6.0]])
    expected, depth = camera.project(points)
    local = np.column_stack([points, np.ones(2)]) @ camera.viewmat.T
    pixels = local[:, :3] @ camera.K.T
    np.testing.assert_allclose(pixels[:, :2] / pixels[:, 2:], expected)
    np.testing.assert_allclose(local[:, 2], depth)
    by_opencv = cv2.projectPoints(local[:, :3].copy(), np.zeros(3), np.zeros(3), camera.opencv_matrix, None)[0][:, 0]
    np.testing.assert_allclose(by_opencv + 0.5, expected)
