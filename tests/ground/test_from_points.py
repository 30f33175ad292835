"""The ground that points alone tell of, before there is a scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.ground.test_street import look
from unveil_core.drives.drive import Drive, Frame, PointCloud
from unveil_core.ground import from_points
from unveil_core.ground.from_points import find_ground


def hill(horizontal: np.ndarray) -> np.ndarray:
    """Flat for 10 m, then up at 15 %, over a crest at 30 m, and down again."""
    along = horizontal[:, 0]
    return np.interp(along, [-20, 10, 30, 60], [0, 0, 3, -1.5])


def drive(noise: float, seed: int = 0) -> Drive:
    rng = np.random.default_rng(seed)
    horizontal = rng.uniform((-5, -8), (60, 8), (20_000, 2))
    points = np.column_stack([horizontal, hill(horizontal) + rng.normal(0, noise, len(horizontal))])
    # Things that stand and hang over the ground: low points of their cells are the ground all the same.
    things = rng.uniform((5, 3, 0.3), (9, 5, 1.8), (3000, 3))
    at = np.column_stack([np.arange(0.0, 56, 2), np.zeros(28), 1.6 + hill(np.arange(0.0, 56, 2)[:, None])])
    frames = tuple(Frame(f"{i}", "camera", look(place, 0.0), Path("none.png")) for i, place in enumerate(at))
    return Drive(Path("."), frames, PointCloud(np.concatenate([points, things])))


def test_a_hill_is_met_on_its_near_side() -> None:
    """Iterations towards the depth of the ground fail where it rises; the walk does not."""
    street = drive(0.01)
    ground = find_ground(street, [np.zeros((64, 96), np.int8)] * len(street.frames), (), ())
    assert ground is not None
    places = np.column_stack([np.random.default_rng(1).uniform((0, -6), (55, 6), (500, 2)), np.zeros(500)])
    assert np.percentile(np.abs(ground.over(places) + hill(places)), 95) < 0.12
    camera = street.frames[0].camera
    pixels = np.column_stack(
        [np.random.default_rng(2).uniform(20, 76, 400), np.random.default_rng(3).uniform(20, 63, 400)]
    )
    rays = camera.rays_at(pixels)
    depth = ground.first_met(camera.centre, rays, near=0.2, far=300.0)
    steps = np.linspace(0.5, 58, 6000)
    x = camera.centre[0] + steps[:, None] * rays[:, 0]
    over = camera.centre[2] + steps[:, None] * rays[:, 2] - hill(x.reshape(-1, 1)).reshape(x.shape)
    aside = np.abs(steps[:, None] * rays[:, 1])
    under = (over < 0) & (aside < 8)
    expected = np.where(under.any(axis=0), steps[under.argmax(axis=0)], np.inf)
    amid = (expected < 40) & (np.take_along_axis(aside, under.argmax(axis=0)[None], axis=0)[0] < 7)
    assert amid.sum() > 200 and np.isfinite(depth[amid]).mean() > 0.98
    found = amid & np.isfinite(depth)
    uphill = found & (expected > 12)
    assert uphill.sum() > 50
    assert (np.abs(depth[found] - expected[found]) < 0.05 * expected[found] + 0.1).mean() > 0.95


def test_too_few_points_are_no_ground() -> None:
    street = drive(0.0)
    few = Drive(street.root, street.frames, PointCloud(street.points.positions[:10]))
    assert find_ground(few, [np.zeros((64, 96), np.int8)] * 28, (), ()) is None


def test_each_cell_has_its_low_point() -> None:
    """As sorting by cells finds it, one of equal heights by its turn, too."""
    generator = np.random.default_rng(3)
    local = generator.uniform(-9, 9, (3000, 3)).round(1)
    _, group = np.unique(np.floor(local[:, :2] / 0.5).astype(np.int64), axis=0, return_inverse=True)
    expected = []
    for k in range(int(group.max()) + 1):
        own = local[group.ravel() == k]
        rank = (from_points.LOW_PERCENT * (len(own) - 1)) // 100
        expected.append(own[np.argsort(own[:, 2], kind="stable")[rank]])
    assert np.array_equal(from_points._one_per_cell(local, 0.5), np.array(expected))
