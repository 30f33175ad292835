"""The ground goes on where no point lies on it, and rays find it."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.geometry.camera import Camera
from unveil_core.ground.terrain import fit_terrain, ground_points

AXES = np.eye(3)
GAP = (np.array([6.0, -1.2]), np.array([11.0, 1.2]))
"""Corners of the place under a car that no point shows."""


def camera(height: float, pitch: float) -> Camera:
    """At (0, 0, height), looking along x, downwards by ``pitch`` radians; z is up."""
    forward = np.array([np.cos(pitch), 0.0, -np.sin(pitch)])
    rotation = np.stack([np.array([0.0, -1.0, 0.0]), np.cross(forward, [0.0, -1.0, 0.0]), forward])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ np.array([0.0, 0.0, height])
    return Camera(64, 48, 40.0, 40.0, 32.0, 24.0, pose)


def scattered(surface, *, noise: float = 0.012, gap: bool = True) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Points of a LiDAR on ``surface``, without those under the car."""
    rng = np.random.default_rng(1)
    horizontal = rng.uniform((-2, -8), (24, 8), (9000, 2))
    if gap:
        horizontal = horizontal[~((horizontal > GAP[0]) & (horizontal < GAP[1])).all(axis=1)]
    height = surface(horizontal) + rng.normal(0, noise, len(horizontal))
    return np.column_stack([horizontal, height])


def bank(horizontal: np.ndarray) -> np.ndarray:
    """A road uphill, with a camber, between a bank that rises to the left and a meadow that falls to the right."""
    along, left = horizontal.T
    return 0.05 * along - 0.02 * np.abs(left) + 0.4 * np.maximum(left - 4, 0) + 0.15 * np.minimum(left + 4, 0)


def test_it_is_as_good_as_its_points() -> None:
    terrain = fit_terrain(scattered(bank), AXES)
    assert terrain is not None
    asked = np.random.default_rng(2).uniform((0, -7), (22, 7), (2000, 2))
    error = terrain.height_at(asked) - bank(asked)
    under = ((asked > GAP[0]) & (asked < GAP[1])).all(axis=1)
    assert np.sqrt(np.mean(error[~under] ** 2)) < 0.015
    # The camber's ridge, 2.4 cm higher than the gap's sides, is all that can be missed.
    assert np.abs(error[under]).max() < 0.06


def test_a_guess_carries_a_kerb_beneath_a_car() -> None:
    def kerb(places: np.ndarray) -> np.ndarray:
        return np.where(places[:, 1] > 0.3, 0.12, 0.0)

    points = scattered(lambda horizontal: 0.05 * horizontal[:, 0] + kerb(horizontal))
    under = np.array([[8.5, 0.0], [8.5, 0.6]])
    step = []
    for guess in (None, kerb):
        terrain = fit_terrain(points, AXES, guess=guess)
        assert terrain is not None
        step.append(float(np.diff(terrain.height_at(under))[0]))
    assert step[0] < 0.08 and step[1] == pytest.approx(0.12, abs=0.01)


def test_a_bush_is_no_hill() -> None:
    rng = np.random.default_rng(3)
    bush = np.column_stack([rng.uniform((14, 2), (15.2, 3.2), (60, 2)), rng.uniform(0.5, 1.2, 60)])
    flat = scattered(lambda horizontal: np.zeros(len(horizontal)))
    bare = flat[~((flat[:, :2] > (14, 2)) & (flat[:, :2] < (15.2, 3.2))).all(axis=1)]
    terrain = fit_terrain(np.concatenate([bare, bush]), AXES)
    assert terrain is not None
    assert np.abs(terrain.height_at(rng.uniform((13, 1), (16, 4), (500, 2)))).max() < 0.05


def test_nobody_knows_it_beyond_all_points() -> None:
    points = scattered(bank)
    terrain = fit_terrain(points, AXES)
    assert terrain is not None
    assert np.isnan(terrain.height_at(np.array([[40.0, 0.0], [10.0, 9.5], [-3.5, 0.0]]))).all()
    assert fit_terrain(points[:0], AXES) is None


def test_rays_meet_it_where_it_is() -> None:
    terrain = fit_terrain(scattered(bank, noise=0), AXES)
    assert terrain is not None
    view = camera(1.6, 0.1)
    asked = np.zeros((48, 64), dtype=bool)
    asked[4:44, 4:60] = True
    depth = terrain.depth(view, asked, near=0.2, far=100.0)
    assert np.isinf(depth[~asked]).all()
    rays = view.rays()
    found = np.isfinite(depth)
    place = view.centre + depth[found][:, None] * rays[found]
    # The cells round off the foot of the bank, and linear steps a little more.
    assert np.abs(place[:, 2] - bank(place[:, :2])).max() < 0.06
    # The bank on the left (and only it) reaches above the horizon; a ray that is flat falls on neither road nor meadow.
    above = found & (rays[..., 2] > 0)
    assert above.any() and (np.nonzero(above)[1] < 32).all()
    assert found[30:44, 10:54].all()


def test_what_hides_first_counts() -> None:
    def crest(horizontal: np.ndarray) -> np.ndarray:
        return 1.2 * np.exp(-((horizontal[:, 0] - 10) ** 2) / 8)

    terrain = fit_terrain(scattered(crest, noise=0, gap=False), AXES)
    assert terrain is not None
    depth = terrain.depth(camera(1.6, 0.0), np.ones((48, 64), dtype=bool), near=0.2, far=100.0)
    # A ray that falls by a tenth of its way meets the crest on its near side, not the ground 6 m behind it.
    assert 7.5 < depth[28, 32] < 8.5


def test_points_lie_on_the_ground_when_all_about_them_does() -> None:
    means = np.array([[x, 0.0, 0.0] for x in range(10)])
    on_ground = np.array([True] * 5 + [False] * 5)
    points = np.array([[1.0, 0.1, 0.0], [4.4, 0.0, 0.0], [8.0, 0.1, 0.0], [1.0, 0.0, 3.0]])
    # Amid ground; at its end; on something else; far from every surfel.
    assert np.array_equal(ground_points(points, means, on_ground), points[:1])
    assert len(ground_points(points, means[:0], on_ground[:0])) == 0
