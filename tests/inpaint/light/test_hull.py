"""The shadow of what nobody saw of a removed object."""

from __future__ import annotations

import numpy as np

from tests.inpaint.sunny_street import blocked
from unveil_core.geometry.camera import Camera
from unveil_core.inpaint.light.hull import in_shadow_of_hull

LORRY = np.array([[15.0, -1.2, 0.3], [24.0, 1.2, 3.2]])
TOWARDS = np.array([0.1, 0.75, 0.65]) / np.linalg.norm([0.1, 0.75, 0.65])
UP = np.array([0.0, 0.0, 1.0])


def views() -> tuple[list[Camera], list[np.ndarray]]:
    """Cameras that come up behind a lorry, and the pixels that it covers."""
    cameras, masks = [], []
    for x in (0.0, 3.0, 6.0):
        pose = np.array([[0.0, -1, 0, 0], [0, 0, -1, 1.5], [1, 0, 0, -x], [0, 0, 0, 1]])
        camera = Camera(384, 256, 274.0, 274.0, 192.0, 128.0, pose)
        rays = camera.rays().reshape(-1, 3)
        hit = np.zeros(len(rays), dtype=bool)
        for distance in np.arange(5.0, 26.0, 0.1):
            at = camera.centre + distance * rays
            hit |= ((at > LORRY[0]) & (at < LORRY[1])).all(axis=1)
        cameras.append(camera)
        masks.append(hit.reshape(256, 384))
    return cameras, masks


def ground(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def test_the_whole_shadow_of_a_lorry_of_which_only_the_rear_is_seen() -> None:
    points = ground(*np.meshgrid(np.arange(8.0, 24.0, 0.25), np.arange(-6.0, -1.3, 0.25)))
    found = in_shadow_of_hull(points, TOWARDS, UP, *views())
    true = blocked(points, LORRY, TOWARDS)
    assert true.sum() > 300
    assert found[true].mean() > 0.9
    # Towards the cameras the hull tapers off.
    before = points[:, 0] < LORRY[0, 0] - 5.0
    assert found[before & ~true].mean() < 0.1


def test_nothing_lies_in_the_shadow_of_what_no_picture_hides() -> None:
    cameras, masks = views()
    points = ground(*np.meshgrid(np.arange(8.0, 24.0, 0.5), np.arange(-6.0, 6.0, 0.5)))
    assert not in_shadow_of_hull(points, TOWARDS, UP, cameras, [np.zeros_like(m) for m in masks]).any()
    # Nor on the side that the sun shines on.
    lit = points[points[:, 1] > 1.5]
    assert not in_shadow_of_hull(lit, TOWARDS, UP, cameras, masks).any()
    assert not in_shadow_of_hull(points + [0, 0, -500.0], TOWARDS, UP, cameras, masks).any(), "out of every picture"
