"""A chart is read robustly: what covered a place in a few frames, a shadow that passed or a car, does not colour it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ground.test_street import drive_on_circle, street_points
from unveil_core.geometry.camera import Camera
from unveil_core.ground.path import fit_path
from unveil_core.ground.street import Ground
from unveil_core.ground.street_fit import fit_street_heights
from unveil_core.inpaint.chart.street_chart import TEXEL_M, read_chart

GREY, SHADED = 120, 60
PLACE = (14.0, 15.0, -1.5, 1.5)
"""A piece of road: first and last s, first and last t, metres."""


Road = tuple[Ground, list[Camera]]


@pytest.fixture(scope="module")
def road() -> Road:
    cameras = [c.resized(288, 192) for c in drive_on_circle(np.inf, 0.0, frames=14)]
    return fit_street_heights(fit_path(cameras), street_points(np.inf, 0.0)), cameras


def shown_of(road: Road, shaded_looks: int) -> np.ndarray:
    """(N, 3) what the chart shows of a piece of a grey road, over which a shadow lies in the nearest frames."""
    ground, cameras = road
    low, high, right, left = PLACE
    images, usable, depths = [], [], []
    for camera in cameras:
        met, at = ground.intersect(camera, camera.rays().reshape(-1, 3))
        there = (at[:, 0] > low - 0.5) & (at[:, 0] < high + 0.5) & (at[:, 1] > right - 0.5) & (at[:, 1] < left + 0.5)
        shape = (camera.height, camera.width)
        images.append(there.reshape(shape))
        usable.append(np.isfinite(met).reshape(shape))
        depths.append(met[there].min() if there.sum() > 1000 else np.inf)
    nearest = np.argsort(depths)[:shaded_looks]
    noise = np.random.default_rng(0)
    pictures = []
    for v, there in enumerate(images):
        level = np.where(there & (v in nearest), SHADED, GREY) + noise.integers(-2, 3, there.shape)
        pictures.append(np.repeat(level.astype(np.uint8)[..., None], 3, axis=2))
    labels = [np.zeros(there.shape, np.int64) for there in images]
    rows = (int((low - ground.s_start) / TEXEL_M), int((high - ground.s_start) / TEXEL_M))
    chart = read_chart(ground, cameras, pictures, labels, usable, rows=rows, robust=True)
    s, t = np.meshgrid(*chart.coordinates(), indexing="ij")
    inside = (s > low) & (s < high) & (t > right) & (t < left) & (chart.source > 0)
    return 255 * chart.color[inside]


@pytest.mark.parametrize("shaded_looks", [0, 1, 2, 3])
def test_a_shadow_that_lies_there_in_the_nearest_frames_leaves_nothing(road: Road, shaded_looks: int) -> None:
    shown = shown_of(road, shaded_looks)
    assert len(shown) > 1000
    assert np.abs(shown - GREY).max() < 4


def test_what_lies_there_in_most_of_the_nearest_frames_is_the_street(road: Road) -> None:
    shown = shown_of(road, 12)
    assert np.abs(np.median(shown) - SHADED) < 3
