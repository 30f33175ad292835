"""A focal length that the pictures do not tell is not told as if they did."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.solve.mapping.model import Lens, Model
from unveil_core.solve.mapping.turning import told_of_focal, turned_deg


def drive(yaw_deg: float, count: int = 21) -> Model:
    """Cameras along z whose views swing by so much to either side."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    for k, angle in enumerate(np.radians(yaw_deg) * np.sin(np.linspace(0, 2 * np.pi, count))):
        poses[k, :3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
        poses[k, :3, 3] = -poses[k, :3, :3] @ (0, 0, k)
    nothing = np.zeros(0, np.int64)
    lens = Lens("SIMPLE_RADIAL", 1920, 1080, (2050.0, 960.0, 540.0, 0.0))
    return Model(
        names=tuple(f"{k:04d}.png" for k in range(count)),
        lens=np.zeros(count, np.int64),
        lenses=(lens,),
        poses=poses,
        points=np.zeros((0, 3)),
        errors=np.zeros(0),
        seen_by=nothing,
        seen=nothing,
        pixels=np.zeros((0, 2)),
    )


@pytest.mark.parametrize("swing", [0.4, 3.0, 40.0])
def test_turning_is_measured_about_the_mean_view(swing: float) -> None:
    model = drive(swing)
    expected = swing * np.sqrt(np.mean(np.sin(np.linspace(0, 2 * np.pi, 21)) ** 2))
    assert turned_deg(model, list(range(21))) == pytest.approx(expected, rel=0.02)


def test_a_straight_way_is_told_with_the_mend() -> None:
    line = told_of_focal(drive(0.4), list(range(21)), 2050.0)
    assert line is not None and line.startswith(
        "the camera turns by 0.3 degrees alone, so the focal length of 2050 pixels"
    )
    assert line.endswith("give --focal where you know it")
    assert told_of_focal(drive(3.0), list(range(21)), 2050.0) is None
    assert told_of_focal(drive(3.0), [0, 10, 20], 2050.0) is not None  # those of one camera alone count
