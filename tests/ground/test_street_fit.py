"""The foot of walls beside a street, row by row, as if each row looked at all points; and ground under what stands on it."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import median_filter

from unveil_core.base.types import Float64
from unveil_core.geometry.camera import Camera
from unveil_core.ground import street_fit
from unveil_core.ground.path import StreetPath, fit_path


def by_looking_at_all(side: Float64, fallback: Float64) -> Float64:
    row = np.round(side[:, 0] / street_fit.S_CELL_M)
    near = [side[np.abs(row - r) <= 3, 1] for r in range(len(fallback))]
    known = {r: max(fallback[r], street_fit.UNDER_WALL * np.median(t)) for r, t in enumerate(near) if len(t) >= 15}
    if not known:
        return fallback
    limit = [known[min(known, key=lambda k, r=r: abs(k - r))] for r in range(len(fallback))]  # type: ignore[misc]
    return median_filter(np.maximum(limit, fallback), 5, mode="nearest")


@given(st.integers(0, 2**32 - 1), st.integers(0, 300), st.integers(1, 60), st.integers(0, 2))
def test_walls_are_where_the_points_around_a_row_are(seed: int, points: int, rows: int, crowded: int) -> None:
    generator = np.random.default_rng(seed)
    along = generator.uniform(-5, 1.1 * rows * street_fit.S_CELL_M, points) * generator.random(points) ** crowded
    side, fallback = np.stack([along, generator.uniform(2, 9, points)], axis=1), generator.uniform(1, 5, rows)
    np.testing.assert_array_equal(street_fit._wall_limit(side, 0.0, fallback), by_looking_at_all(side, fallback))


def straight_path() -> StreetPath:
    pose = np.eye(4)
    pose[:3, :3] = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
    cameras = []
    for x in np.arange(0.0, 40.0):
        there = pose.copy()
        there[:3, 3] = -pose[:3, :3] @ (x, 0.0, 1.6)
        cameras.append(Camera(96, 64, 80.0, 80.0, 48.0, 32.0, there))
    return fit_path(cameras)


def test_the_ground_goes_on_under_what_stands_on_it() -> None:
    generator = np.random.default_rng(0)
    lane = np.stack([generator.uniform(0, 40, 9000), generator.uniform(-2, 2, 9000), np.zeros(9000)], axis=1)
    # A row of cars on the left, seen from the side; leaves high over the right.
    cars = np.stack(
        [generator.uniform(10, 30, 4000), generator.uniform(2.1, 4.0, 4000), generator.random(4000)], axis=1
    )
    leaves = np.stack([generator.uniform(0, 40, 4000), generator.uniform(-6, -3, 4000), np.full(4000, 3.0)], axis=1)
    path = straight_path()
    plain = street_fit.fit_street_heights(path, lane)
    under = street_fit.fit_street_heights(path, lane, standing=np.concatenate([cars, leaves]))
    s = np.array([15.0, 20.0, 25.0])
    assert not plain.inside(s, np.full(3, 3.5)).any()
    assert under.inside(s, np.full(3, 3.9)).all() and not under.inside(s, np.full(3, 5.0)).any()
    assert not under.inside(s, np.full(3, -3.5)).any()
    assert not under.inside(np.array([3.0, 36.0]), np.full(2, 3.5)).any()
    assert np.abs(under.height_at(s, np.full(3, 3.9))).max() < 0.02


def test_the_kerb_lies_where_each_stretch_has_it() -> None:
    generator = np.random.default_rng(3)
    path = straight_path()
    s, t = generator.uniform(0, 40, 40000), generator.uniform(-6, 6, 40000)
    # A sidewalk 12 cm high that is two metres wider from the middle on, as beyond a corner; a car parked on its kerb.
    height = np.where(t > np.where(s < 20, 4.5, 2.5), 0.12, 0.0)
    hidden = (np.abs(s - 9) < 2.5) & (np.abs(t - 4) < 1.2)
    points = np.stack([s, t, height], axis=1)[~hidden]
    ground = street_fit.fit_street_heights(path, points)
    fitted = ground.height_at(s, t)
    clear = np.abs(t - np.where(s < 20, 4.5, 2.5)) > 0.15
    # Where it changes one profile turns into the other.
    clear &= np.abs(s - 20) > 0.6 * street_fit.HOP_M
    assert np.abs(fitted - height)[clear].max() < 0.02
    assert hidden.any() and np.abs(fitted - height)[clear & hidden].max() < 0.02


def test_a_few_wrong_labels_under_parked_cars_are_no_ground() -> None:
    """Where a row of cars hides the ground all along, what is named for it there are pieces of the cars."""
    generator = np.random.default_rng(5)
    s, t = generator.uniform(0, 40, 20000), generator.uniform(-6, 6, 20000)
    shown = (t < 2) | (t > 4)
    pieces = np.stack([generator.uniform(0, 40, 30), generator.uniform(2.2, 3.8, 30), np.full(30, -0.17)], axis=1)
    points = np.stack([s, t, np.zeros(len(s))], axis=1)[shown]
    ground = street_fit.fit_street_heights(straight_path(), np.concatenate([points, pieces]))
    assert np.abs(ground.height_at(s, t)).max() < 0.03


def test_what_stands_beside_one_stretch_is_no_ground_of_it() -> None:
    generator = np.random.default_rng(4)
    s, t = generator.uniform(0, 40, 30000), generator.uniform(-6, 6, 30000)
    hedge = (s > 28) & (t > 5)
    ground = street_fit.fit_street_heights(straight_path(), np.stack([s, t, np.where(hedge, 0.6, 0.0)], axis=1))
    assert np.abs(ground.height_at(s, t)[hedge]).max() < 0.05


def test_wrong_labels_on_a_garden_wall_do_not_raise_the_ground_at_its_foot() -> None:
    generator = np.random.default_rng(6)
    s, t = generator.uniform(0, 40, 20000), generator.uniform(-8, 8, 20000)
    height = np.where(t > 4, 0.12, 0.0) + generator.normal(0, 0.01, len(s))
    wall = np.stack(
        [generator.uniform(0, 40, 2000), generator.uniform(5.9, 6.15, 2000), generator.uniform(0.1, 1.5, 2000)], axis=1
    )
    ground = street_fit.fit_street_heights(straight_path(), np.concatenate([np.stack([s, t, height], axis=1), wall]))
    clear = np.abs(t - 4) > 0.15
    assert np.abs(ground.height_at(s, t) - np.where(t > 4, 0.12, 0.0))[clear].max() < 0.12


def test_the_profile_has_kerbs_but_no_teeth() -> None:
    generator = np.random.default_rng(8)
    s, t = generator.uniform(0, 40, 8000), generator.uniform(-6, 6, 8000)
    height = np.where(t > 4, 0.12, 0.0) + generator.normal(0, 0.04, len(s))
    ground = street_fit.fit_street_heights(straight_path(), np.stack([s, t, height], axis=1))
    across = np.arange(-5.5, 3.5, 0.1)
    rise = np.diff(ground.height_at(np.full_like(across, 20.0), across))
    assert np.abs(rise).max() < 0.008
    foot, top = ground.height_at(np.array([20.0, 20.0]), np.array([3.8, 4.2]))
    assert top - foot > 0.09
