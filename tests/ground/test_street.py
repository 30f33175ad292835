"""Street coordinates on curved, sloped and standing drives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unveil_core.geometry.camera import Camera
from unveil_core.ground.path import fit_path, shift_path
from unveil_core.ground.street import as_far_as_shown
from unveil_core.ground.street_fit import fit_street_heights

UP = np.array([0.0, 0.0, 1.0])


def look(position: np.ndarray, heading: float, pitch: float = 0.1) -> Camera:
    """A camera at ``position`` that looks along ``heading``, a little down."""
    forward = np.array([np.cos(heading) * np.cos(pitch), np.sin(heading) * np.cos(pitch), -np.sin(pitch)])
    right = np.array([np.sin(heading), -np.cos(heading), 0.0])
    down = np.cross(forward, right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, down, forward])
    pose[:3, 3] = -pose[:3, :3] @ position
    return Camera(96, 64, 60.0, 60.0, 48.0, 32.0, pose)


def drive_on_circle(radius: float, slope: float, frames: int = 24, step: float = 1.1) -> list[Camera]:
    """A forward drive on a circle (or straight for radius inf) with a constant slope."""
    cameras = []
    for i in range(frames):
        s = i * step
        if np.isfinite(radius):
            angle = s / radius
            xy = radius * np.array([np.sin(angle), 1 - np.cos(angle)])
        else:
            angle, xy = 0.0, np.array([s, 0.0])
        cameras.append(look(np.array([*xy, 1.6 + slope * s]), angle))
    return cameras


def true_street(radius: float, s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """World x, y of true street coordinates on the circle."""
    if not np.isfinite(radius):
        return np.stack([s, t], axis=1)
    angle = s / radius
    centre = np.stack([radius * np.sin(angle), radius * (1 - np.cos(angle))], axis=1)
    return centre + t[:, None] * np.stack([-np.sin(angle), np.cos(angle)], axis=1)


@pytest.mark.parametrize("radius", [np.inf, 60.0, -80.0])
def test_path_follows_the_circle(radius: float) -> None:
    path = fit_path(drive_on_circle(radius, 0.0))
    generator = np.random.default_rng(0)
    s, t = generator.uniform(0, 25, 400), generator.uniform(-6, 6, 400)
    world = np.concatenate([true_street(radius, s, t), np.zeros((400, 1))], axis=1)
    street = path.to_street(world)
    assert np.abs(street[:, 1] - t).max() < 0.12
    assert np.abs(street[:, 0] - s).max() < 0.8


@given(s=st.floats(-40, 70), t=st.floats(-8, 8), h=st.floats(-3, 9))
@settings(max_examples=60, deadline=None)
def test_round_trip(s: float, t: float, h: float) -> None:
    street = np.array([[s, t, h]])
    back = PATH.to_street(PATH.to_world(street))
    assert abs(back[0, 2] - h) < 1e-9
    assert np.abs(PATH.to_world(back) - PATH.to_world(street)).max() < 0.05


PATH = fit_path(drive_on_circle(60.0, 0.0))


def test_standing_camera_looks_along_the_street() -> None:
    camera = look(np.array([3.0, 4.0, 1.6]), 0.7)
    path = fit_path([camera] * 5)
    ahead = camera.centre + 10 * np.array([np.cos(0.7), np.sin(0.7), 0.0])
    street = path.to_street(ahead[None])[0]
    assert abs(street[1]) < 1e-6
    assert abs(street[0] - 10) < 1e-6


def street_points(radius: float, slope: float, seed: int = 0) -> np.ndarray:
    """Ground points with a 12 cm kerb at 4 m on both sides, and a hole under parked cars."""
    generator = np.random.default_rng(seed)
    s, t = generator.uniform(-5, 45, 60_000), generator.uniform(-7, 7, 60_000)
    hole = (s > 8) & (s < 20) & (t < -1.5) & (t > -5)
    s, t = s[~hole], t[~hole]
    h = slope * s + np.where(np.abs(t) > 4, 0.12, 0.0) + generator.normal(0, 0.005, len(s))
    return np.concatenate([true_street(radius, s, t), h[:, None]], axis=1)


@pytest.mark.parametrize(("radius", "slope"), [(np.inf, 0.0), (60.0, 0.03), (-80.0, -0.05)])
def test_ground_continues_the_kerb_under_the_car(radius: float, slope: float) -> None:
    path = fit_path(drive_on_circle(radius, slope))
    ground = fit_street_heights(path, street_points(radius, slope))
    s = np.repeat(np.linspace(9, 19, 21), 2)
    t = np.tile([-3.0, -4.6], 21)
    world = np.concatenate([true_street(radius, s, t), np.zeros((42, 1))], axis=1)
    street = path.to_street(world)
    height = ground.height_at(street[:, 0], street[:, 1])
    expected = slope * s + np.where(np.abs(t) > 4, 0.12, 0.0)
    assert np.abs(height - expected).max() < 0.04
    assert ground.inside(street[:, 0], street[:, 1]).all()


def test_rays_meet_the_ground_where_they_should() -> None:
    cameras = drive_on_circle(60.0, 0.03)
    path = fit_path(cameras)
    ground = fit_street_heights(path, street_points(60.0, 0.03))
    camera = cameras[5]
    rays = camera.rays().reshape(-1, 3)
    depth, street = ground.intersect(camera, rays)
    hit = np.isfinite(depth) & (depth < 25)
    assert hit.sum() > 500
    points = camera.centre + depth[hit, None] * rays[hit]
    assert np.abs(points[:, 2] - ground.height_at(street[hit, 0], street[hit, 1])).max() < 0.09
    upward = rays[:, 2] > 0.05
    assert not np.isfinite(depth[upward]).any()


@pytest.mark.parametrize("radius", [np.inf, 60.0, -80.0])
def test_a_path_is_moved_onto_a_line_beside_it(radius: float) -> None:
    """The car weaves about the street's middle; once its path is moved by what it was off, the middle lies at offset 0."""
    cameras = drive_on_circle(radius, 0.0)
    path = fit_path(cameras)
    s = np.arange(0.0, 25.0, 0.04)
    middle = np.concatenate([true_street(radius, s, 0.3 * np.sin(s / 3.5) - 0.5), np.zeros((len(s), 1))], axis=1)
    aside = path.to_street(middle)
    moved = shift_path(path, aside[:, 0], aside[:, 1])
    amid = (s > 3) & (s < 22)
    assert np.abs(path.to_street(middle)[amid, 1]).max() > 0.5
    assert np.abs(moved.to_street(middle)[amid, 1]).max() < 0.05
    # Half way between two nodes either may be meant.
    assert np.abs(moved.to_world(moved.to_street(middle)) - middle).max() < 1e-3


def test_rays_go_over_a_crest_and_up_a_hill() -> None:
    """The street falls behind a crest at 20 m and rises, above the camera's horizon, from 60 m on."""

    def height(s: np.ndarray) -> np.ndarray:
        return np.where(s < 20, 0.05 * s, 1.0 - 0.06 * (s - 20)) + 0.28 * np.maximum(s - 55, 0)

    cameras = [look(np.array([x, 0.0, float(height(np.array(x))) + 1.6]), 0.0, 0.0) for x in np.arange(0.0, 24.0)]
    path = fit_path(cameras)
    rng = np.random.default_rng(4)
    s, t = rng.uniform(-5, 80, 90_000), rng.uniform(-7, 7, 90_000)
    ground = fit_street_heights(path, np.column_stack([s, t, height(s)]))
    camera = cameras[0]
    rays = np.column_stack([np.ones(200), rng.uniform(-0.02, 0.02, 200), np.linspace(-0.3, 0.06, 200)])
    depth, street = ground.intersect(camera, rays)
    steps = np.linspace(0.5, 79, 16_000)
    over = camera.centre[2] + steps[:, None] * rays[:, 2] - height(steps)[:, None]
    expected = np.where((over < 0).any(axis=0), steps[(over < 0).argmax(axis=0)], np.inf)
    assert (np.isinf(expected) == np.isinf(depth)).mean() > 0.97
    met = np.isfinite(expected) & np.isfinite(depth)
    assert (rays[met, 2] > 0).sum() > 10
    assert (np.abs(depth[met] - expected[met]) < 0.05 * expected[met]).mean() > 0.95
    # Nothing is found between the crest and the hill that it hides.
    assert not ((depth > 26) & (depth < 55)).any()
    assert np.abs(street[met, 0] - depth[met]).max() < 0.5


ROAD, CAR, HOUSE, SKY = range(4)


def labels_of(camera: Camera, slope: float, until: float, cars: float = np.inf) -> np.ndarray:
    """(H, W) of a straight street with a slope that ends before a house, and of a row of cars across it."""
    rays = camera.rays()
    with np.errstate(divide="ignore"):
        depth = (camera.centre[2] - slope * camera.centre[0]) / (slope * rays[..., 0] - rays[..., 2])
    away = np.where(depth > 0, camera.centre[0] + depth * rays[..., 0], np.inf)
    label = np.where(away < until, ROAD, np.where(rays[..., 2] < 0.2, HOUSE, SKY))
    return np.where((away > cars) & (label == ROAD), CAR, label)


@pytest.mark.parametrize("slope", [0.0, 0.03])
def test_the_ground_goes_on_as_far_as_labels_show_the_street(slope: float) -> None:
    cameras = [look(np.array([x, 0.0, 1.6 + slope * x]), 0.0) for x in np.arange(0.0, 24.0)]
    cameras = [c.resized(384, 256) for c in cameras]
    path = fit_path(cameras)
    rng = np.random.default_rng(1)
    s, t = rng.uniform(-2, 35, 30_000), rng.uniform(-6, 6, 30_000)
    ground = fit_street_heights(path, np.column_stack([s, t, slope * s]))

    def end(until: float, cars: float = np.inf) -> float:
        labels = [labels_of(c, slope, until, cars) for c in cameras]
        longer = as_far_as_shown(ground, cameras, labels, (ROAD,), (CAR,), 45.0)
        last = longer.s_start + longer.s_cell * (len(longer.t_max) - 1)
        assert abs(longer.height_at(np.array([last - 1]), np.array([2.0]))[0] - slope * (last - 1)) < 0.1
        return last

    assert end(200.0) == pytest.approx(68, abs=1.5), "as far as frames are read"
    assert end(50.0) == pytest.approx(50, abs=2)
    assert end(200.0, cars=45.0) == pytest.approx(45, abs=2), "where cars hide it nobody knows how far it goes"
    assert end(20.0) == pytest.approx(35, abs=1.5), "what was measured stays"
    assert as_far_as_shown(ground, cameras, [], (), (CAR,), 45.0) is ground
