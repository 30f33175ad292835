"""Which pixels the ground is asked for, at every size of the picture."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.inpaint.sunny_street import sunny_chart
from unveil_core.geometry.camera import Camera
from unveil_core.geometry.images import border_px, grow
from unveil_core.inpaint.chart.layer import GroundLayer
from unveil_core.inpaint.chart.street_chart import StreetChart


def camera_of(width: int) -> Camera:
    """70 degrees wide, 1.6 m above the ground, level, along the street."""
    pose = np.eye(4)
    pose[:3, :3] = [[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]
    pose[:3, 3] = -pose[:3, :3] @ np.array([-0.5, 0.5, 1.6])
    return Camera(width, width * 2 // 3, width / 1.4, width / 1.4, width / 2, width / 3, pose)


def shadowed() -> StreetChart:
    """A street with a shadow along it, patches of it, and a strip that was given up."""
    chart = sunny_chart(None)[0]
    rows, columns = np.indices(chart.source.shape)
    dark = (np.abs(columns - 140) < 25) | ((rows // 40 + columns // 30) % 5 == 0)
    gain = np.where(dark[..., None], 1.8, 1.0).astype(np.float32) * np.ones(3, np.float32)
    return replace(chart, gain=gain, replaced=np.abs(columns - 60) < 10)


@pytest.mark.parametrize("width", [384, 768, 1920, 3840])
def test_all_ground_in_shadow_is_asked_for(width: int) -> None:
    chart, camera = shadowed(), camera_of(width)
    layer = GroundLayer(chart)
    asked = grow(layer.shadow_pixels(camera), border_px(width))
    looked = np.random.default_rng(0).random(asked.shape) < min(1.0, 1e5 / asked.size)
    truth = layer.sample(camera, looked)
    for near, far in ((3, 4), (4, 5), (5, 8), (8, 40)):
        here = truth.shadow & (truth.depth >= near) & (truth.depth < far)
        assert here.sum() > 500
        assert asked[here].mean() >= 0.995, (near, far)
    # And not much besides: the sky and sunlit ground are left alone.
    assert (
        asked[looked].sum() < 1.5 * truth.shadow.sum() and not asked[: camera.height // 2 - 3 * border_px(width)].any()
    )
