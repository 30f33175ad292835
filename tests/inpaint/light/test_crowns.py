"""Trees of which the drive saw one side."""

from __future__ import annotations

import numpy as np

from tests.inpaint.sunny_street import sunny_chart
from unveil_core.inpaint.light.crowns import complete_crowns
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels, rotations

GROUND = sunny_chart(None)[0].ground


def plants(points: np.ndarray, normals: np.ndarray | None = None) -> Surfels:
    normal = np.tile([0.6, 0.0, 0.8], (len(points), 1)) if normals is None else normals
    return surfels_from_points(
        points,
        np.zeros((len(points), 3), np.uint8),
        np.zeros(len(points), np.int64),
        normal,
        np.full(len(points), 0.1),
        sh_degree=0,
        opacity=0.9,
        scale_factor=0.7,
    )


def half_tree(x: float, y: float, seed: int = 0) -> np.ndarray:
    """The side of a tree towards -x: a trunk and half a ball."""
    rng = np.random.default_rng(seed)
    angle, height = rng.uniform(np.pi / 2, 3 * np.pi / 2, 60), rng.uniform(0.2, 2.0, 60)
    trunk = np.stack([x + 0.15 * np.cos(angle), y + 0.15 * np.sin(angle), height], axis=1)
    ball = rng.normal(size=(400, 3))
    ball *= 1.3 / np.linalg.norm(ball, axis=1, keepdims=True)
    ball[:, 0] = -np.abs(ball[:, 0])
    return np.concatenate([trunk, ball + [x, y, 3.2]])


def test_the_far_side_is_as_deep_as_the_near_one() -> None:
    points = np.concatenate([half_tree(10.0, 4.0), half_tree(16.0, -4.0, 1)])
    added = complete_crowns(plants(points), GROUND)
    means = added.means.numpy()
    assert 700 < len(added) < 900
    for x, y in ((10.0, 4.0), (16.0, -4.0)):
        own = means[np.hypot(means[:, 0] - x, means[:, 1] - y) < 1.6]
        assert len(own) > 350
        # The trunk's middle is the middle of its near face.
        assert abs(own[:, 0].max() - (x + 1.3)) < 0.3
        assert abs(own[:, 0].mean() - (x + 0.65)) < 0.3
        assert abs(own[:, 2].mean() - 3.2) < 0.2


def test_normals_turn_with_it() -> None:
    tree = half_tree(10.0, 4.0)
    normal = np.tile([-0.8, 0.0, 0.6], (len(tree), 1))
    added = complete_crowns(plants(tree, normal), GROUND)
    turned = rotations(added.quats)[:, :, 2].numpy()
    assert np.allclose(np.abs(turned @ np.array([0.8, 0.0, 0.6])), 1.0, atol=1e-5)


def test_bushes_stumps_and_nothing_stay_as_they_are() -> None:
    rng = np.random.default_rng(0)
    bush = rng.uniform((8.0, 3.0, 0.1), (12.0, 5.0, 2.2), (800, 3))
    stump = half_tree(10.0, 4.0)[:60]
    for points in (bush, stump, np.zeros((0, 3))):
        assert len(complete_crowns(plants(points), GROUND)) == 0
