"""The panorama of the sky with more rows."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from unveil_core.geometry.camera import Camera
from unveil_core.surfels.sky import Sky


@pytest.mark.parametrize("turn", [0, 90, 180, 200, 270])  # the seam of the panorama lies behind, at 180 degrees
def test_with_more_rows_it_shows_the_same(turn: float) -> None:
    pose = np.eye(4)
    # The camera looks along +x and turns around the panorama's up axis, z.
    ahead = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    pose[:3, :3] = ahead @ Rotation.from_euler("z", turn, degrees=True).as_matrix()
    camera = Camera(120, 80, 60.0, 60.0, 60.0, 40.0, pose)
    coarse = Sky(torch.rand(3, 8, 16, generator=torch.Generator().manual_seed(0)), np.eye(3))
    fine = coarse.with_rows(128)
    assert fine.texture.shape == (3, 128, 256)
    # Between the centres of the fine one's texels a kink of the coarse one is cut: by a 16th of its step and less.
    assert (fine.render(camera) - coarse.render(camera)).abs().max() < 1 / 16


def test_with_its_own_rows_it_is_itself() -> None:
    sky = Sky(torch.zeros(3, 8, 16), np.eye(3))
    assert sky.with_rows(8) is sky
