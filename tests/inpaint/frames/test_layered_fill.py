"""Far holes in a picture of a street: asphalt up to the horizon, a meadow beside it, sky, and walls of brick."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from unveil_core.inpaint.frames.layered_fill import FAR_M, across, fill_in_layers

ROAD, SKY, BRICK = (90, 92, 95), (150, 180, 220), (150, 60, 40)
HORIZON, WIDTH = 60, 160


def street() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The picture (H, W, 3), its ground and what is below the horizon (H, W); brick on the left."""
    rng = np.random.default_rng(3)
    image = np.empty((120, WIDTH, 3))
    below = np.zeros((120, WIDTH), dtype=bool)
    below[HORIZON:] = True
    image[:] = SKY
    image[below] = ROAD
    ground = below.copy()
    image[20:90, :50], ground[20:90, :50] = BRICK, False
    image += rng.normal(0, 2, image.shape)
    return image.astype(np.uint8), ground, below


def hole_at(rows: slice, columns: slice) -> np.ndarray:
    mask = np.zeros((120, WIDTH), dtype=bool)
    mask[rows, columns] = True
    return mask


def filled(hole: np.ndarray, depth: float, *, wall_on_both_sides: bool = False) -> np.ndarray:
    """The picture with a hole filled that red shows through."""
    image, ground, below = street()
    if wall_on_both_sides:
        image[20:90, 110:], ground[20:90, 110:] = BRICK, False
    image[hole] = (255, 0, 0)
    found = fill_in_layers(
        image, hole, np.full(hole.shape, depth), ground=ground & ~hole, beside=~ground & ~hole, below_horizon=below
    )
    np.testing.assert_array_equal(found[~hole], image[~hole])
    return found.astype(float)


def test_a_far_hole_beside_a_wall_is_road_below_the_horizon_and_sky_above() -> None:
    hole = hole_at(slice(40, 75), slice(50, 90))
    found = filled(hole, 2 * FAR_M)
    assert np.abs(found[HORIZON:75, 50:90] - ROAD).mean() < 4
    # Beside the wall the sky may have some of its colour, and over the road of the road's.
    above = found[40:HORIZON, 70:90].mean(axis=(0, 1))
    assert np.abs(above - SKY).max() < np.abs(np.subtract(SKY, ROAD)).max() / 2


def test_a_wall_on_both_sides_goes_on_between() -> None:
    hole = hole_at(slice(65, 80), slice(50, 110))
    found = filled(hole, 2 * FAR_M, wall_on_both_sides=True)
    image, ground, below = street()
    left = np.abs(found[65:80, 52:60] - BRICK).mean()
    road = across(image, hole, ground & ~hole).astype(float)
    assert left < np.abs(road[65:80, 52:60] - BRICK).mean()


def test_near_holes_are_left_to_patches() -> None:
    hole = hole_at(slice(40, 75), slice(20, 40))
    assert np.abs(filled(hole, FAR_M / 2)[hole] - BRICK).mean() < 6


def test_without_any_ground_patches_fill_all() -> None:
    image, _, below = street()
    hole = hole_at(slice(65, 80), slice(80, 100))
    nothing = np.zeros_like(hole)
    found = fill_in_layers(
        image, hole, np.full(hole.shape, 90.0), ground=nothing, beside=nothing, below_horizon=below
    ).astype(float)
    assert np.abs(found[hole] - ROAD).mean() < 6


def test_rows_are_interpolated_between_their_two_sides() -> None:
    image = np.zeros((4, 101, 3), dtype=np.uint8)
    image[:, :20], image[:, 81:] = 50, 150
    wanted = hole = np.zeros((4, 101), dtype=bool)
    hole[:, 20:81] = True
    found = across(image, wanted, ~hole).astype(float)[..., 0]
    assert found[0, 20] < 55
    assert found[0, 80] > 145
    assert abs(found[0, 50] - 100) < 2
    assert (np.diff(found[:, 20:81], axis=1) >= 0).all()


def test_rows_without_a_source_take_over_the_nearest() -> None:
    image = np.zeros((6, 30, 3), dtype=np.uint8)
    source = np.zeros((6, 30), dtype=bool)
    source[3:, :10], image[3:, :10] = True, 80
    found = across(image, ~source, source)
    np.testing.assert_array_equal(found, 80)


@given(st.integers(0, 2**32 - 1))
def test_nothing_outside_changes_and_no_new_colours_come(seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (12, 20, 3)).astype(np.uint8)
    wanted = rng.random((12, 20)) < 0.4
    source = (rng.random((12, 20)) < 0.5) & ~wanted
    found = across(image, wanted, source)
    np.testing.assert_array_equal(found[~wanted], image[~wanted])
    if source.any():
        assert found[wanted].min(initial=255) >= image[source].min()
        assert found[wanted].max(initial=0) <= image[source].max()


def test_a_line_beside_one_row_makes_no_stripe() -> None:
    image, ground, _ = street()
    image[70, :60] = 250  # a stop line far off, one row high
    hole = hole_at(slice(62, 80), slice(60, 140))
    found = across(image, hole, ground & ~hole)[62:80, 60:100].astype(float).mean(axis=(1, 2))
    assert np.abs(np.diff(found)).max() < 12
    assert abs(found[:4].mean() - np.mean(ROAD)) < 4
