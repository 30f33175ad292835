"""A plinth with a person before it, and gaps that are no plinth."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.inpaint.facade.bridges import WIDE_M, bridge_gaps
from unveil_core.inpaint.facade.facade_fill import fill_facade

PER_M = 10.0
PLINTH, WALL, DOOR = (0.4, 0.4, 0.42), (0.7, 0.6, 0.5), (0.2, 0.12, 0.08)


def facade(length: int = 200) -> np.ndarray:
    """(A, B, 3) a plinth of 0.6 m, a wall over it, and doors."""
    color = np.empty((length, 30, 3), dtype=np.float32)
    color[:], color[:, :6] = WALL, PLINTH
    color[20:30, :20] = DOOR
    return color


def test_the_plinth_goes_on_behind_a_person() -> None:
    color = facade()
    wanted = np.zeros(color.shape[:2], dtype=bool)
    wanted[100:106, :17] = True
    seen = np.where(wanted[..., None], 0, color).astype(np.float32)
    result, bridged = bridge_gaps(seen, ~wanted, wanted, PER_M)
    np.testing.assert_array_equal(bridged, wanted)
    np.testing.assert_allclose(result, color, atol=1e-6)
    fill = fill_facade(seen, ~wanted, wanted, texels_per_m=PER_M)
    np.testing.assert_array_equal(fill.filled, wanted)
    np.testing.assert_allclose(fill.color, color, atol=1e-6)
    assert not fill.copied.any()


def test_long_gaps_and_different_sides_are_no_bridges() -> None:
    color = facade()
    wanted = np.zeros(color.shape[:2], dtype=bool)
    wanted[60 : 60 + int(WIDE_M * PER_M) + 2] = True  # a car
    wanted[26:34, 8:16] = True  # a person before a door's edge
    wanted[-5:] = True  # the end of the facade
    assert not bridge_gaps(color, ~wanted, wanted, PER_M)[1].any()


def test_what_is_not_asked_for_is_left() -> None:
    color = facade()
    known = np.ones(color.shape[:2], dtype=bool)
    known[100:106] = False
    wanted = ~known
    wanted[:, 10:] = False
    result, bridged = bridge_gaps(np.where(known[..., None], color, 0), known, wanted, PER_M)
    np.testing.assert_array_equal(bridged, wanted)
    np.testing.assert_array_equal(result[100:106, 10:], 0)


def test_the_roof_of_a_car_is_part_of_a_long_gap() -> None:
    color = facade()
    wanted = np.zeros(color.shape[:2], dtype=bool)
    wanted[60:105, :8] = True
    wanted[75:90, :14] = True
    assert not bridge_gaps(color, ~wanted, wanted, PER_M)[1].any()


@given(st.integers(0, 2**32 - 1))
def test_bridges_lie_between_their_sides(seed: int) -> None:
    rng = np.random.default_rng(seed)
    color = rng.random((40, 5, 3)).astype(np.float32) * 0.05 + 0.5
    known = rng.random((40, 5)) < 0.6
    result, bridged = bridge_gaps(color, known, ~known, PER_M)
    assert not (bridged & known).any()
    np.testing.assert_array_equal(result[~bridged], color[~bridged])
    assert (result[bridged] >= color.min() - 1e-6).all()
    assert (result[bridged] <= color.max() + 1e-6).all()
