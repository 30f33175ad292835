"""What the optimization compares with: photographs as bytes, and what does not fit into these."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from unveil_core.geometry.camera import Camera
from unveil_core.optimize.training.views import training_view
from unveil_core.surfels.sky import Sky

CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0, np.eye(4))
SKY = Sky(torch.zeros(3, 8, 16), np.eye(3))


@pytest.mark.parametrize("factor", [1.0, 0.5])
@pytest.mark.parametrize(("brightest", "kept_as"), [(250.0, torch.uint8), (360.0, torch.float16)])
def test_highlights_beyond_white_are_compared_with(factor: float, brightest: float, kept_as: torch.dtype) -> None:
    levels = np.linspace(0, brightest, 64, dtype=np.float32)[None, :, None].repeat(48, axis=0).repeat(3, axis=2)
    view = training_view(CAMERA, levels, None, None, SKY, factor=factor)
    assert view.photograph.dtype == kept_as
    seen = levels.reshape(48, -1, round(1 / factor), 3).mean(axis=2)[:: round(1 / factor)] / 255
    assert np.abs(view.image.numpy() - seen).max() < 0.51 / 255
