"""Where street coordinates name a place twice: sharp bends, half turns and orbits, against the geometry of circles."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ground.test_street import drive_on_circle
from unveil_core.geometry.camera import Camera
from unveil_core.ground.one_place import LEAST_OWN, goes_round, limited_to_own, share_of_own
from unveil_core.ground.path import EXTENSION_M, StreetPath, fit_path


def turning(radius: float, degrees: float, straight: float = 25.0) -> list[Camera]:
    """A straight, a turn to the left and a straight, a camera each metre."""
    turn = np.radians(degrees)
    cameras = []
    for s in np.arange(0, 2 * straight + turn * radius):
        angle = np.clip((s - straight) / radius, 0, turn)
        beyond = max(s - straight - turn * radius, 0)
        x = min(s, straight) + radius * np.sin(angle) + beyond * np.cos(angle)
        y = radius * (1 - np.cos(angle)) + beyond * np.sin(angle)
        forward, right = np.array([np.cos(angle), np.sin(angle), 0]), np.array([np.sin(angle), -np.cos(angle), 0])
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, [0, 0, -1], forward])
        pose[:3, 3] = -pose[:3, :3] @ [x, y, 1.6]
        cameras.append(Camera(64, 48, 40.0, 40.0, 32.0, 24.0, pose))
    return cameras


def test_coordinates_come_back_beside_a_sharp_bend() -> None:
    """Without a jump between nodes: 8 m aside of a bend of 10 m frames of single nodes are 20 cm apart."""
    path = fit_path(turning(10, 90))
    generator = np.random.default_rng(0)
    street = np.stack([generator.uniform(-20, 80, 5000), generator.uniform(-8, 8, 5000), np.zeros(5000)], axis=1)
    assert np.abs(path.to_street(path.to_world(street)) - street).max() < 1e-3
    beside = np.linspace(20, 45, 2000)
    rail = path.to_world(np.stack([beside, np.full(2000, -8.0), np.zeros(2000)], axis=1))
    legs = np.linalg.norm(np.diff(rail, axis=0), axis=1)
    assert legs.max() < 2.0 * (beside[1] - beside[0])  # 1 + 8 / 10, and no jumps


def orbit(radius: float, laps: float = 1.0) -> list[Camera]:
    return turning(radius, 360 * laps, straight=0.0)


def test_a_street_is_its_own() -> None:
    assert share_of_own(fit_path(drive_on_circle(np.inf, 0.0))) == 1.0
    assert share_of_own(fit_path(drive_on_circle(60.0, 0.0))) == 1.0


@pytest.mark.parametrize(("radius", "degrees"), [(6, 90), (10, 90), (6, 180)])
def test_turns_at_junctions_are_streets(radius: float, degrees: float) -> None:
    path = fit_path(turning(radius, degrees))
    assert share_of_own(path) > LEAST_OWN
    assert not goes_round(path)


@pytest.mark.parametrize(("radius", "laps"), [(4, 1), (8, 2), (15, 1)])
def test_orbits_are_none(radius: float, laps: float) -> None:
    assert goes_round(fit_path(orbit(radius, laps)))


def test_a_half_turn_on_the_spot_is_none() -> None:
    assert share_of_own(fit_path(turning(3, 180))) < LEAST_OWN


def limits(path: StreetPath, width: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    s = path.start + EXTENSION_M + np.arange(0, path.step * len(path.nodes) - 2 * EXTENSION_M)
    low, high = limited_to_own(path, s, np.full(len(s), -width), np.full(len(s), width))
    return s, low, high


def test_limits_are_drawn_in_inside_of_a_bend_only() -> None:
    s, low, high = limits(fit_path(turning(6, 90)), 12.0)
    assert np.allclose(low, -12.0)
    # Beyond the centre of the turn, 6 m to the left, the opposite side begins; off the turn the whole width stays.
    turn = (s > 26) & (s < 33)
    assert (high[turn] < 9.5).all()
    assert (high[turn] > 3.0).all()
    assert np.allclose(high[s < 10], 12.0)
    assert np.allclose(high[-10:], 12.0)


def test_between_the_limits_all_places_are_their_own() -> None:
    path = fit_path(turning(5, 120))
    s, low, high = limits(path, 10.0)
    for share in np.linspace(0, 1, 21):
        street = np.stack([s, low + share * (high - low), np.zeros_like(s)], axis=1)
        assert np.abs(path.to_street(path.to_world(street)) - street)[:, :2].max() < 0.75


def test_a_way_that_comes_back_begins_at_its_first_camera() -> None:
    path = fit_path(orbit(15))
    assert abs(path.start + EXTENSION_M) < 1.0
