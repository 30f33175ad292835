"""Where one street ends and the next begins: at corners, not in bends."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.ground.path import StreetPath
from unveil_core.inpaint.chart.street_parts import parts_between_corners

STEP = 0.5


def driven(*legs: tuple[float, float]) -> StreetPath:
    """A path of legs, each a length in metres and a turn in degrees."""
    turns = np.concatenate([np.full(round(length / STEP), np.radians(turn) * STEP / length) for length, turn in legs])
    heading = np.concatenate([[0.0], np.cumsum(turns)])
    steps = STEP * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return StreetPath(np.eye(3), np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)[:-1]]), heading, 0.0, STEP)


def places(path: StreetPath, texel: float = 0.1) -> np.ndarray:
    return np.arange(0, path.step * (len(path.heading) - 1), texel)


@pytest.mark.parametrize("turn", [90.0, -70.0])
@pytest.mark.parametrize("radius", [7.5, 12.0])
def test_a_corner_parts_two_streets(turn: float, radius: float) -> None:
    corner = radius * np.radians(abs(turn))
    path = driven((30.0, 0.0), (corner, turn), (40.0, 0.0))
    s = places(path)
    parts = parts_between_corners(path, s)
    assert len(parts) == 2
    assert s[parts[0]][0] == 0 and s[parts[0]][-1] == pytest.approx(30, abs=1.5)
    assert s[parts[1]][0] == pytest.approx(30 + corner, abs=1.5) and s[parts[1]][-1] == s[-1]


@pytest.mark.parametrize(("radius", "turn"), [(40.0, 120.0), (28.0, 60.0), (10.0, 30.0), (1e6, 0.0)])
def test_bends_and_small_turns_are_of_one_street(radius: float, turn: float) -> None:
    path = driven((30.0, 0.0), (max(1.0, radius * np.radians(turn)) if turn else 10.0, turn), (30.0, 0.0))
    s = places(path)
    assert parts_between_corners(path, s) == [slice(0, len(s))]


def test_a_corner_right_and_one_left_are_two() -> None:
    corner = 10 * np.pi / 2
    path = driven((20.0, 0.0), (corner, 90.0), (corner, -90.0), (20.0, 0.0))
    s = places(path)
    parts = parts_between_corners(path, s)
    assert s[parts[0]][-1] == pytest.approx(20, abs=1.5)
    assert s[parts[-1]][0] == pytest.approx(20 + 2 * corner, abs=1.5)
    assert all(p.stop - p.start > 5 / 0.1 for p in parts)
