"""What lies in a camera's picture."""

from __future__ import annotations

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
