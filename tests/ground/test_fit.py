"""The street's ground from a scene's surfels."""

from __future__ import annotations

import numpy as np

from tests.ground.test_street import look
from unveil_core.drives.drive import PointCloud
from unveil_core.ground.fit import GroundEvidence, measured_ground
from unveil_core.ground.path import fit_path
from unveil_core.semantics.classes import LabelSet
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels, concatenate

LABELS = LabelSet(("road", "building"), (0, 2))


def road(points: np.ndarray) -> Surfels:
    return surface(points, 0, (0.0, 0.0, 1.0))


def surface(points: np.ndarray, label: int, normal: tuple[float, float, float]) -> Surfels:
    count = len(points)
    grey = np.full((count, 3), 120, np.uint8)
    normals = np.repeat([normal], count, axis=0)
    return surfels_from_points(points, grey, np.full(count, label), normals, np.full(count, 0.1), opacity=0.9)


def test_strays_before_a_side_camera_s_lens_do_not_lift_the_street() -> None:
    """Where the car's first frames hide the road beside them they are all that is called road there."""
    cameras = [look(np.array([x, 0.0, 1.6 + 0.05 * x]), 0.0) for x in np.arange(20.0)]
    path = fit_path(cameras)
    generator = np.random.default_rng(0)
    x = generator.uniform(4.0, 40.0, 4000)
    seen = np.c_[x, generator.uniform(-5, 5, 4000), 0.05 * x + generator.normal(0, 0.02, 4000)]
    strays = np.c_[generator.uniform(0, 2, 15), generator.uniform(0.7, 1.1, 15), np.full(15, 1.2)]
    clean, mixed = (GroundEvidence(road(p), LABELS, cameras).fit(path) for p in (seen, np.r_[seen, strays]))
    assert clean is not None and mixed is not None
    s, t = (p.ravel() for p in np.meshgrid(np.arange(4.5, 35.0), (-3.0, 0.0, 3.0)))
    assert np.abs(mixed.height_at(s, t) - clean.height_at(s, t)).max() < 1e-9
    assert np.abs(clean.height_at(s, t) - 0.05 * s).max() < 0.06


def test_a_street_that_falls_beyond_the_way_is_followed() -> None:
    """Far ahead the road may lie lower or higher than under the cameras."""
    cameras = [look(np.array([x, 0.0, 1.6]), 0.0) for x in np.arange(10.0)]
    generator = np.random.default_rng(0)
    x = generator.uniform(0.0, 40.0, 4000)
    hill = np.where(x > 15, 0.1 * (x - 15), 0.0)
    ground = GroundEvidence(road(np.c_[x, generator.uniform(-5, 5, 4000), hill]), LABELS, cameras).fit(
        fit_path(cameras)
    )
    assert ground is not None
    assert abs(float(ground.height_at(np.array([35.0]), np.array([0.0]))[0]) - 2.0) < 0.1


def test_a_surface_far_under_the_road_makes_no_pit() -> None:
    """Too few frames tell depth badly: behind a kerb or ahead of the way ground was put metres under the road."""
    cameras = [look(np.array([x, 0.0, 1.6 + 0.05 * x]), 0.0) for x in np.arange(12.0)]
    path = fit_path(cameras)
    generator = np.random.default_rng(0)
    x, y = generator.uniform(0, 40, 6000), generator.uniform(-6, 6, 6000)
    kept = (x < 20) | (generator.uniform(size=6000) < 0.1)
    seen = np.c_[x, y, 0.05 * x][kept]
    deep = np.c_[generator.uniform(20, 28, 3000), generator.uniform(-6, 6, 3000), np.full(3000, -10.0)]
    ground = GroundEvidence(road(np.r_[seen, deep]), LABELS, cameras).fit(path)
    assert ground is not None
    s, t = (p.ravel() for p in np.meshgrid(np.arange(1.0, 38.0), (-4.0, 0.0, 4.0)))
    assert np.abs(ground.height_at(s, t) - 0.05 * s).max() < 0.25


def test_a_bank_beside_the_road_is_ground() -> None:
    cameras = [look(np.array([x, 0.0, 1.6]), 0.0) for x in np.arange(12.0)]
    generator = np.random.default_rng(0)
    x, y = generator.uniform(0, 20, 8000), generator.uniform(-7, 7, 8000)
    bank = np.maximum(np.abs(y) - 3.5, 0) * 0.7
    ground = GroundEvidence(road(np.c_[x, y, bank]), LABELS, cameras).fit(fit_path(cameras))
    assert ground is not None
    assert abs(float(ground.height_at(np.array([8.0]), np.array([6.0]))[0]) - 1.75) < 0.15


def test_measured_points_tell_the_height_that_surfels_tell_too_low() -> None:
    """Surfels in the depth of the ground show through those above: medians of them lie below it, points of a LiDAR on it."""
    cameras = [look(np.array([x, 0.0, 1.6]), 0.0) for x in np.arange(20.0)]
    generator = np.random.default_rng(0)
    x, y = generator.uniform(0.0, 40.0, 6000), generator.uniform(-6, 6, 6000)
    height = np.where(y > 3.03, 0.12, 0.0)
    seen = np.c_[x, y, height - np.abs(generator.normal(0, 0.05, 6000))]
    measured = np.c_[x, y, height + generator.normal(0, 0.01, 6000)][::3]
    of_car = np.c_[generator.uniform(0, 40, 100), generator.uniform(1, 3, 100), generator.uniform(0.6, 1.4, 100)]
    points = PointCloud(np.r_[measured, of_car], None, True)
    path = fit_path(cameras)
    measured_there = measured_ground(points, road(seen), LABELS)
    ground, bare = (GroundEvidence(road(seen), LABELS, cameras, p).fit(path) for p in (measured_there, None))
    assert ground is not None and bare is not None
    s, t = (p.ravel() for p in np.meshgrid(np.arange(2.0, 38.0), (-4.0, -1.0, 1.5, 2.9, 3.2, 5.0)))
    true = np.where(t > 3.03, 0.12, 0.0)
    assert np.abs(ground.height_at(s, t) - true).max() < 0.02
    assert np.median(true - bare.height_at(s, t)) > 0.02


def test_labelled_points_tell_the_sidewalk_that_no_camera_sees() -> None:
    """Behind parked cars no surfel lies; a LiDAR measures the sidewalk there, and the wall that ends it."""
    cameras = [look(np.array([x, 0.0, 1.6]), 0.0) for x in np.arange(20.0)]
    path = fit_path(cameras)
    generator = np.random.default_rng(0)
    x = generator.uniform(0.0, 30.0, 4000)
    seen = np.c_[x, generator.uniform(-3, 5, 4000), np.zeros(4000)]
    sidewalk = np.c_[x, generator.uniform(-7, -4, 4000), np.full(4000, 0.2)]
    wall = np.c_[x, np.full(4000, -7.0), generator.uniform(0.2, 3, 4000)]
    passing = np.c_[x[:500], generator.uniform(-6, -5, 500), np.full(500, 1.5)]
    positions = np.r_[sidewalk, wall, passing]
    classes = np.repeat([1, 2, 1], [4000, 4000, 500]).astype(np.uint8)  # sidewalk, building, and what moved
    moving = np.arange(len(positions)) >= 8000
    measured = measured_ground(PointCloud(positions, None, True, classes, moving), road(seen), LABELS)
    ground = GroundEvidence(road(seen), LABELS, cameras, measured).fit(path)
    bare = GroundEvidence(road(seen), LABELS, cameras).fit(path)
    assert ground is not None and bare is not None
    s = np.arange(2.0, 28.0)
    assert np.abs(ground.height_at(s, np.full(len(s), -6.0)) - 0.2).max() < 0.03
    assert np.abs(ground.t_min[2:28] + 7.0).max() < 0.4 < np.abs(bare.t_min[2:28] + 7.0).min()


def test_a_wall_across_the_street_does_not_narrow_it() -> None:
    """At the end of a courtyard: what a car hides beside the wall is ground up to the wall at the side, and a little under it."""
    cameras = [look(np.array([x, 0.0, 1.6]), 0.0) for x in np.arange(8.0)]
    generator = np.random.default_rng(0)
    places = np.c_[generator.uniform(0, 14, 6000), generator.uniform(-6, 6, 6000), np.zeros(6000)]
    places = places[~((places[:, 0] > 6) & (places[:, 1] < -1))]
    side = np.c_[generator.uniform(0, 14, 1000), np.full(1000, -6.0), generator.uniform(1.5, 4, 1000)]
    end = np.c_[np.full(3000, 14.0), generator.uniform(-6, 6, 3000), generator.uniform(0.5, 4, 3000)]
    parts = [road(places), surface(side, 1, (0.0, 1.0, 0.0)), surface(end, 1, (-1.0, 0.0, 0.0))]
    ground = GroundEvidence(concatenate(parts), LABELS, cameras).fit(fit_path(cameras))
    assert ground is not None
    assert ((ground.t_min <= -6.0) & (ground.t_min > -6.5)).all()


def test_a_few_strays_behind_a_wall_do_not_lead_the_street_on() -> None:
    """They lie on the rays to the foot of the wall, so behind it they lie below the ground."""
    cameras = [look(np.array([x, 0.0, 1.6]), 0.0) for x in np.arange(8.0)]
    path = fit_path(cameras)
    generator = np.random.default_rng(0)
    seen = np.c_[generator.uniform(0, 14, 3000), generator.uniform(-5, 5, 3000), np.zeros(3000)]
    behind = np.c_[np.full(5, 19.0), np.linspace(-1, 1, 5), np.full(5, -0.9)]
    clean, mixed = (GroundEvidence(road(p), LABELS, cameras).fit(path) for p in (seen, np.r_[seen, behind]))
    assert clean is not None and mixed is not None
    assert mixed.height.shape == clean.height.shape
    assert np.abs(mixed.height).max() < 0.01
    beyond = np.c_[generator.uniform(19, 22, 60), generator.uniform(-5, 5, 60), np.zeros(60)]
    far = GroundEvidence(road(np.r_[seen, beyond]), LABELS, cameras).fit(path)
    assert far is not None and bool(far.inside(np.array([21.0]), np.array([0.0]))[0])
