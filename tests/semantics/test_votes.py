"""Labels, colours and instances for points: only what a view really sees may vote."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from unveil_core.base.errors import SelectionError
from unveil_core.geometry.camera import Camera
from unveil_core.semantics.classes import CITYSCAPES, LabelSet, expand_names
from unveil_core.semantics.instances import cluster_points, fit_box, vote_instances
from unveil_core.semantics.visibility import PointsNear, points_in_view
from unveil_core.semantics.votes import sample_colors, vote_labels

CAMERA = Camera(80, 60, 70.0, 70.0, 40.0, 30.0, np.eye(4))


def two_walls() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A near wall at 4 m on the left half, a far wall at 8 m everywhere."""
    y, x = np.mgrid[-1.6:1.6:40j, -2.2:0.0:40j]
    near = np.stack([x, y, np.full_like(x, 4.0)], axis=-1).reshape(-1, 3)
    y, x = np.mgrid[-3.2:3.2:60j, -4.4:4.4:80j]
    far = np.stack([x, y, np.full_like(x, 8.0)], axis=-1).reshape(-1, 3)
    points = np.concatenate([near, far])
    which = np.repeat([0, 1], [len(near), len(far)])
    return points, which, np.full(len(points), 0.11)


def label_picture() -> np.ndarray:
    picture = np.ones((60, 80), dtype=np.int64)
    picture[:, :39] = 0
    return picture


def test_hidden_points_get_no_vote() -> None:
    points, which, spacing = two_walls()
    views = [points_in_view(points, spacing, CAMERA, near=0.1)]
    labels, share = vote_labels(len(points), views, lambda _: label_picture(), 2)
    x = points[:, 0] / points[:, 2] * 70 + 40
    border = np.abs(x - 39) < 3
    inside = (x > 3) & (x < 77) & (np.abs(points[:, 1] / points[:, 2] * 70) < 26)
    assert (labels[(which == 0) & inside & ~border] == 0).all()
    hidden = (which == 1) & (x < 35) & inside
    assert (labels[hidden] == -1).mean() > 0.95
    seen = (which == 1) & (x > 43) & inside
    assert (labels[seen] == 1).all()
    assert (share[seen] == 1).all()


def test_a_lonely_pixel_counts_less_than_a_thin_pole() -> None:
    point, spacing = np.array([[0.0, 0.0, 4.0]]), np.array([0.1])
    views = [points_in_view(point, spacing, CAMERA, near=0.1)] * 3
    salt, pole, wall = (np.zeros((60, 80), np.int64) for _ in range(3))
    salt[30, 40] = 1
    pole[:, 40:42] = 1
    assert vote_labels(1, views, lambda v: wall if v == 2 else salt, 2)[0][0] == 0
    assert vote_labels(1, views, lambda v: wall if v == 2 else pole, 2)[0][0] == 1
    assert vote_labels(1, views[:2], lambda v: salt, 2)[0][0] == 1, "where nothing else is known, it does count"


def test_noise_in_the_label_images_is_voted_away() -> None:
    points, which, spacing = two_walls()
    generator = np.random.default_rng(3)
    poses = [np.eye(4) for _ in range(5)]
    for i, pose in enumerate(poses):
        pose[0, 3] = 0.05 * (i - 2)
    views = [points_in_view(points, spacing, replace(CAMERA, world_to_camera=p), near=0.1) for p in poses]
    noisy = []
    for _ in poses:
        picture = label_picture()
        salt = generator.random(picture.shape) < 0.05
        picture[salt] = generator.integers(0, 4, salt.sum())
        noisy.append(picture)
    clean, _ = vote_labels(len(points), views, lambda _: label_picture(), 4)
    labels, _ = vote_labels(len(points), views, lambda v: noisy[v], 4)
    amid = np.abs(points[:, 0] / points[:, 2] * 70 + 40 - 39) > 5
    assert (labels != clean)[amid].mean() < 0.002


def test_void_does_not_vote() -> None:
    points, _, spacing = two_walls()
    views = [points_in_view(points, spacing, CAMERA, near=0.1)]
    labels, _ = vote_labels(len(points), views, lambda _: np.full((60, 80), -1), 3)
    assert (labels == -1).all()


def test_colours_come_from_the_visible_surface() -> None:
    points, which, spacing = two_walls()
    picture = np.zeros((60, 80, 3), dtype=np.uint8)
    picture[:, :39] = (200, 0, 0)
    picture[:, 39:] = (0, 0, 200)
    views = [points_in_view(points, spacing, CAMERA, near=0.1)]
    colors, known = sample_colors(len(points), views, lambda _: picture)
    x = points[:, 0] / points[:, 2] * 70 + 40
    assert (colors[known & (which == 0) & (x < 36)] == (200, 0, 0)).all()
    assert (colors[known & (which == 1) & (x > 43)] == (0, 0, 200)).all()


def test_instances_by_vote_and_by_cluster() -> None:
    points, which, spacing = two_walls()
    picture = np.zeros((60, 80), dtype=np.int64)
    picture[:, :39] = 700
    picture[:, 39:] = 31
    ids = vote_instances(points, spacing, which, [CAMERA], lambda _: picture, near=0.1)
    assert set(np.unique(ids)) <= {0, 31, 700}
    assert (ids[which == 0] == 700).mean() > 0.9
    clusters = cluster_points(points, 0.2)
    assert (clusters[which == 1] == 1).all() and (clusters[which == 0] == 2).all()
    assert (cluster_points(points[:5], 0.2) == 0).all()
    assert len(cluster_points(np.zeros((0, 3)), 0.2)) == 0


def test_a_point_that_no_view_shows_goes_to_what_is_beside_it_and_of_its_class() -> None:
    """What lies out of sight is of the object of its class close by; a stray far off, or one of another class, is of none."""
    points, which, spacing = two_walls()
    picture = np.zeros((60, 80), dtype=np.int64)
    picture[:, :39] = 700
    behind = points[which == 0].mean(axis=0) + np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 4.0]])
    beside = np.array([0, 1, 0])
    ids = vote_instances(
        np.concatenate([points, behind]),
        np.concatenate([spacing, np.full(3, spacing.mean())]),
        np.concatenate([np.where(which == 0, 0, 2), beside]),
        [CAMERA],
        lambda _: picture,
        near=0.1,
    )
    assert ids[-3:].tolist() == [700, 0, 0]


def test_views_are_asked_about_the_points_near_them() -> None:
    """Two places of a long drive: each is as its own views make it, and a view near neither sees nothing."""
    points, _, spacing = two_walls()
    away = np.array([5000.0, 0.0, 0.0])
    pose = CAMERA.world_to_camera.copy()
    pose[:3, 3] -= pose[:3, :3] @ away
    between = CAMERA.world_to_camera.copy()
    between[:3, 3] -= between[:3, :3] @ away / 2
    cameras = [CAMERA, replace(CAMERA, world_to_camera=between), replace(CAMERA, world_to_camera=pose)]
    both, twice = np.concatenate([points, points + away]), np.tile(spacing, 2)
    placed = PointsNear(both, twice)
    here, nothing, there = (placed.seen_by(camera, near=0.1) for camera in cameras)
    alone = points_in_view(points, spacing, CAMERA, near=0.1)
    assert np.array_equal(here.index, alone.index) and np.array_equal(here.depth, alone.depth)
    assert there.index.min() >= len(points) and not len(nothing.index)
    pictures = [np.full((60, 80), number) for number in (3, 4, 5)]
    ids = vote_instances(both, twice, np.zeros(len(both), int), cameras, lambda v: pictures[v], near=0.1)
    assert (ids[here.index] == 3).all() and (ids[there.index] == 5).all()
    assert np.isin(ids[: len(points)], (0, 3)).all() and np.isin(ids[len(points) :], (0, 5)).all()


def test_box_of_a_turned_car() -> None:
    generator = np.random.default_rng(0)
    local = generator.uniform(-0.5, 0.5, (4000, 3)) * (4.4, 1.8, 1.5)
    yaw = 0.4
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    box = fit_box(local @ turn.T + (10, -3, 0.75), np.eye(3))
    assert np.allclose(box.centre, (10, -3, 0.75), atol=0.1)
    assert np.allclose(box.size, (4.4, 1.8, 1.5), atol=0.15)
    assert abs(box.yaw - yaw) < 0.03


def test_names_and_groups() -> None:
    assert expand_names(["vehicle"]) == ("car", "truck", "bus", "train", "motorcycle", "bicycle")
    assert expand_names(["Human", "car"]) == ("person", "rider", "car")
    with pytest.raises(SelectionError, match="Not a class: 'cars'"):
        expand_names(["cars"])


def test_label_set_maps_there_and_void_away() -> None:
    labels = LabelSet.cityscapes([13, 0, 255, 10])
    assert labels.names == ("road", "sky", "car")
    image = np.array([[0, 10, 13, 255, 5]], dtype=np.uint8)
    assert labels.compact(image).tolist() == [[0, 1, 2, -1, -1]]
    assert CITYSCAPES[labels.disk_ids[2]] == "car"
