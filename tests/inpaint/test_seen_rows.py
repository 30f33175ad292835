"""What cameras show of the ground stays; what lies behind them all goes."""

from __future__ import annotations

import numpy as np
import pytest

from tests.inpaint.sunny_street import sunny_chart
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.chart.layer import GroundLayer
from unveil_core.inpaint.chart.street_chart import TEXEL_M, rows_of
from unveil_core.inpaint.stretches import seen_rows


def camera_at(x: float, *, yaw: float = 0.0, pitch: float = 0.1) -> Camera:
    """70 degrees wide, 1.6 m above the ground, ``yaw`` to the left of the street and ``pitch`` downward, radians."""
    forward = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = -pose[:3, :3] @ np.array([x, 0.5, 1.6])
    return Camera(96, 64, 68.0, 68.0, 48, 32, pose)


@pytest.mark.parametrize("yaw", [0.0, 0.6, np.pi / 2, np.pi])
@pytest.mark.parametrize("pitch", [0.0, 0.1, 0.6])
def test_pictures_of_what_is_left_are_those_of_all(yaw: float, pitch: float) -> None:
    chart = sunny_chart(None)[0]
    s = chart.coordinates()[0]
    camera = camera_at(float(s[0] + s[-1]) / 2, yaw=yaw, pitch=pitch)
    seen = seen_rows(chart.ground, [camera], 0, rows_of(chart.ground))
    first, end = (min(round(row * TEXEL_M / chart.texel), len(s)) for row in seen)  # this chart is coarser
    pixels = np.ones((camera.height, camera.width), dtype=bool)
    all_of_it, left = (GroundLayer(c).sample(camera, pixels) for c in (chart, chart.part(first, end)))
    np.testing.assert_allclose(left.color, all_of_it.color, atol=1e-6)
    np.testing.assert_array_equal(left.shadow, all_of_it.shadow)
    assert all_of_it.shadow.shape == pixels.shape
    if yaw in (0.0, np.pi):  # along the street: half of it lies behind
        assert end - first < 0.7 * len(s)


def test_where_nothing_is_seen_all_stays() -> None:
    chart = sunny_chart(None)[0]
    assert seen_rows(chart.ground, [camera_at(0.0, pitch=-1.2)], 0, 100) == (0, 100)
