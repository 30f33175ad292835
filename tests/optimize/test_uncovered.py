"""What no point covers gets surfels; the sky gets none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from unveil_core.drives.depth_range import FAR_M, NEAR_M
from unveil_core.geometry.camera import Camera
from unveil_core.optimize.uncovered import cover_uncovered
from unveil_core.raster import render
from unveil_core.surfels.initialize import surfels_from_points
from unveil_core.surfels.surfels import Surfels

CAMERA = Camera(96, 64, 80.0, 80.0, 48.0, 32.0, np.eye(4))
UP = np.array([0.0, -1.0, 0.0])
WALL, SKY, TREE = 0, 1, 2


def lower_wall() -> Surfels:
    """A wall at 10 m that covers the image below row 32."""
    x, y = np.meshgrid(np.arange(-6.5, 6.5, 0.125), np.arange(0.1, 4.5, 0.125))
    points = np.stack([x, y, np.full_like(x, 10.0)], axis=-1).reshape(-1, 3)
    return surfels_from_points(
        points,
        np.full((len(points), 3), 90, np.uint8),
        np.full(len(points), WALL),
        np.repeat([[0.0, 0.0, -1.0]], len(points), axis=0),
        np.full(len(points), 0.15),
        opacity=0.9,
    )


def picture() -> tuple[np.ndarray, np.ndarray]:
    """The wall goes on up to row 16, with a far tree on the left beside it; above is sky."""
    labels = np.full((64, 96), WALL)
    labels[:32, :40] = TREE
    labels[:16] = SKY
    image = np.full((64, 96, 3), 90, np.uint8)
    image[labels == TREE] = (20, 120, 20)
    return image, labels


def alpha(surfels: Surfels) -> np.ndarray:
    with torch.no_grad():
        out = render(surfels, CAMERA, ("alpha",), near=NEAR_M, far=FAR_M).alpha
    assert out is not None
    return out.numpy()


def test_uncovered_pixels_get_surfels_of_their_label_at_the_depth_beside_them() -> None:
    image, labels = picture()
    wall = lower_wall()
    assert (alpha(wall)[18:30] < 0.5).all()
    full = cover_uncovered(wall, [CAMERA], [image], [labels], 3, SKY, UP)
    new = full.select(torch.arange(len(wall), len(full)))
    depth, kind = new.means[:, 2].numpy(), new.labels.numpy()
    assert set(kind) == {WALL, TREE}
    assert np.abs(depth[kind == WALL] - 10).max() < 0.2
    assert (depth[kind == TREE] > 80).all(), "of the tree nothing is known but that it is far"
    after = alpha(full)
    assert (after[20:30, 4:36] > 0.5).mean() > 0.95 and (after[20:30, 44:92] > 0.5).mean() > 0.95
    assert after[:12].max() < 0.05, "the sky stays open"


def test_views_that_show_the_same_plant_once() -> None:
    image, labels = picture()
    wall = lower_wall()
    once = cover_uncovered(wall, [CAMERA], [image], [labels], 3, SKY, UP)
    twice = cover_uncovered(wall, [CAMERA] * 2, [image] * 2, [labels] * 2, 3, SKY, UP)
    assert len(twice) - len(wall) < 1.2 * (len(once) - len(wall))


def test_noise_unknown_labels_and_pixels_above_the_horizon_plant_nothing() -> None:
    image, labels = picture()
    wall = lower_wall()
    noisy = np.where(labels == WALL, labels, SKY)
    noisy[:32] = SKY
    noisy[np.random.default_rng(0).random(noisy.shape) < 0.05] = TREE
    assert len(cover_uncovered(wall, [CAMERA], [image], [noisy], 3, SKY, UP)) == len(wall)
    assert len(cover_uncovered(wall, [CAMERA], [image], [np.full_like(labels, -1)], 3, SKY, UP)) == len(wall)
    assert len(cover_uncovered(wall, [CAMERA], [image], [np.zeros_like(labels)], 3, None, UP)) == len(wall)


def test_a_patch_that_one_view_of_three_labels_wrong_plants_nothing() -> None:
    image, labels = picture()
    wall = lower_wall()
    labels[:32] = SKY
    wrong = labels.copy()
    wrong[4:16, 60:72] = TREE
    poses = [np.eye(4) for _ in range(3)]
    for i, pose in enumerate(poses):
        pose[0, 3] = 0.1 * i
    cameras = [replace(CAMERA, world_to_camera=p) for p in poses]
    full = cover_uncovered(wall, cameras, [image] * 3, [labels, wrong, labels], 3, SKY, UP)
    assert len(full) == len(wall)
    assert len(cover_uncovered(wall, cameras[1:2], [image], [wrong], 3, SKY, UP)) > len(wall)
