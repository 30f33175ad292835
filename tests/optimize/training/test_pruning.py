"""Which surfels the optimization takes out: faint ones, and those that are wider than what a camera sees of a street."""

from __future__ import annotations

import math

import numpy as np
import torch

from unveil_core.optimize.training.parameters import LearningRates
from unveil_core.optimize.training.trainer import Optimization, TrainSettings
from unveil_core.surfels.sky import Sky
from unveil_core.surfels.surfels import Surfels

OPAQUE, FAINT = 3.0, -3.0


def test_faint_and_boundless_surfels_go() -> None:
    """The fourth is faint, but of a label that is spared; the fifth is of that label, and a kilometre long."""
    count = 5
    opacity = torch.tensor([OPAQUE, FAINT, OPAQUE, FAINT, OPAQUE])
    long = torch.tensor([1.0, 1.0, 900.0, 1.0, 900.0])
    surfels = Surfels(
        torch.arange(3 * count, dtype=torch.float32).reshape(count, 3),
        torch.tensor([[1.0, 0, 0, 0]]).repeat(count, 1),
        torch.stack([long.log(), torch.full((count,), math.log(0.1))], dim=1),
        opacity,
        torch.zeros(count, 1, 3),
        torch.tensor([0, 0, 0, 1, 1]),
    )
    settings = TrainSettings(prune_opacity=0.3)
    sky = Sky(torch.zeros(3, 4, 8), np.eye(3))
    state = Optimization(
        surfels, sky, settings, LearningRates(means=1e-3), label_count=2, sky_label=None, spared_labels=(1,)
    )
    state.prune()
    left = state.result()[0]
    assert left.means[:, 0].tolist() == [0.0, 9.0]
