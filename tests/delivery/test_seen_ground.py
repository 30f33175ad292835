"""The ground between a few rays: as rays of their own would meet it, on bends and slopes, over kerbs and to its end."""

from __future__ import annotations

import numpy as np
import pytest

from tests.ground.test_street import drive_on_circle, look, street_points
from unveil_core.delivery.moved_ground import ground_points
from unveil_core.delivery.seen_ground import seen_ground
from unveil_core.geometry.camera import Camera
from unveil_core.ground.path import fit_path
from unveil_core.ground.street import Ground
from unveil_core.ground.street_fit import fit_street_heights


def street(radius: float, slope: float) -> Ground:
    """A street with kerbs of 12 cm, see ``street_points``."""
    path = fit_path(drive_on_circle(radius, slope))
    points = street_points(radius, slope)
    return fit_street_heights(path, points)


def camera() -> Camera:
    return look(np.array([0.0, 0.0, 1.6]), 0.0).resized(240, 160)


@pytest.mark.parametrize(("radius", "slope"), [(np.inf, 0.0), (60.0, 0.0), (np.inf, 0.04)])
def test_between_rays_the_ground_is_where_a_ray_would_meet_it(radius: float, slope: float) -> None:
    ground, here = street(radius, slope), camera()
    asked = np.zeros((here.height, here.width), bool)
    asked[60:150, 20:220] = True
    generator = np.random.default_rng(0)
    at = generator.uniform((20.5, 60.5), (219.5, 149.5), (20_000, 2))
    found = seen_ground(here, asked, ground).met(at)
    depth, coordinates = ground.intersect(here, here.rays_at(at))
    known = np.isfinite(depth)
    assert 0.3 < known.mean() < 1.0
    both = known & (found[:, 0] > 0)
    assert both.sum() > 0.995 * max(known.sum(), (found[:, 0] > 0).sum())
    # Across a kerb of 12 cm both hit another face of it: there they may lie apart by its height over the slope of the ray.
    apart = np.abs(found[both, 0] - depth[both]) / depth[both]
    assert np.median(apart) < 1e-3 and np.quantile(apart, 0.95) < 0.02
    aside = np.abs(found[both, 1:] - coordinates[both, :2]) / depth[both, None]
    assert np.median(aside) < 1e-3 and np.quantile(aside, 0.95) < 0.02
    assert (found[~known & (found[:, 0] == 0)] == 0).all()


def test_pixels_of_their_own_are_as_near_at_the_borders_of_the_picture() -> None:
    ground, here = street(np.inf, 0.0), camera()
    asked = np.ones((here.height, here.width), bool)
    at = np.array([[0.1, 159.9], [239.9, 159.9], [120.0, 159.9], [0.1, 120.0]])
    found, depth = seen_ground(here, asked, ground).met(at), ground.intersect(here, here.rays_at(at))[0]
    known = np.isfinite(depth)
    assert known.sum() >= 2
    assert np.abs(found[known, 0] / depth[known] - 1).max() < 2e-3


def test_without_ground_nothing_is_met() -> None:
    here = camera()
    assert not seen_ground(here, np.ones((160, 240), bool), None).met(np.array([[100.0, 150.0]])).any()


@pytest.mark.parametrize("radius", [np.inf, 60.0, -80.0])
def test_points_of_the_ground_are_those_of_path_and_heights(radius: float) -> None:
    ground = street(radius, 0.02)
    generator = np.random.default_rng(1)
    s, t = generator.uniform(-60, 90, 5000), generator.uniform(-12, 12, 5000)
    wanted = ground.path.to_world(np.stack([s, t, ground.height_at(s, t)], axis=1))
    assert np.abs(ground_points(ground, np.stack([s, t], axis=1)) - wanted).max() < 1e-9
