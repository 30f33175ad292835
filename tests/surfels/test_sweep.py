"""The plane sweep against the true depth of a slanted, textured plane."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from unveil_core.base.parallel import threads
from unveil_core.geometry.camera import Camera
from unveil_core.surfels.sweep import SweepSettings, sweep_depth, sweep_points

NORMAL, OFFSET = np.array([0.45, 0.1, 1.0]), 6.0
"""The plane NORMAL . x = OFFSET: its depth falls from left to right."""


def camera_at(x: float) -> Camera:
    pose = np.eye(4)
    pose[0, 3] = -x
    return Camera(120, 80, 100.0, 100.0, 60.0, 40.0, pose)


def true_depth(camera: Camera) -> np.ndarray:
    return (OFFSET - camera.centre @ NORMAL) / (camera.rays() @ NORMAL)


def photograph(camera: Camera) -> np.ndarray:
    """(H, W) float32 levels: waves in several directions, none of which repeats over the baseline."""
    p = camera.unproject(true_depth(camera))
    waves = [(5.0, 1.3, 0.2), (-2.1, 6.3, 1.0), (8.7, -5.9, 2.0), (1.7, 2.9, 0.5), (13.1, 9.7, 0.1)]
    total = sum(np.sin(a * p[..., 0] + b * p[..., 1] + c) for a, b, c in waves)
    return (128 + 22 * total).astype(np.float32)


def test_depth_of_a_slanted_plane() -> None:
    cameras = [camera_at(x) for x in (0.0, -0.3, 0.3, 0.6)]
    ladder = 1.0 / np.linspace(1 / 2.0, 1 / 40.0, 72)
    depth, score = sweep_depth(
        cameras[0], photograph(cameras[0]), [(c, photograph(c)) for c in cameras[1:]], ladder, SweepSettings()
    )
    error = np.abs(depth / true_depth(cameras[0]) - 1)
    sure = score > SweepSettings().correlation
    assert sure[8:-8, 16:-16].mean() > 0.95
    assert np.median(error[sure]) < 0.005
    assert (error[sure] < 0.03).mean() > 0.97


def test_what_is_not_asked_for_or_plain_has_no_depth() -> None:
    cameras = [camera_at(x) for x in (0.0, -0.3, 0.3)]
    pictures = [photograph(c) for c in cameras]
    for picture in pictures:
        picture[50:] = 90.0
    asked = np.zeros(pictures[0].shape, bool)
    asked[:, :60] = True
    ladder = 1.0 / np.linspace(1 / 2.0, 1 / 40.0, 72)
    others = list(zip(cameras[1:], pictures[1:], strict=True))
    _, score = sweep_depth(cameras[0], pictures[0], others, ladder, SweepSettings(), usable=asked)
    assert (score[:, 60:] < 0).all() and (score[54:] < 0).all()
    assert (score[10:40, 16:56] > 0.75).mean() > 0.9


def test_any_number_of_threads_finds_the_same() -> None:
    cameras = [camera_at(x) for x in (0.0, -0.3, 0.3)]
    pictures = [photograph(c) for c in cameras]
    # Other columns are asked for in each band of rows.
    row, column = np.mgrid[:80, :120]
    asked = (column > 10 + row // 3) & (column < 100 - row // 5)
    ladder = 1.0 / np.linspace(1 / 2.0, 1 / 40.0, 72)
    found = []
    for count in (1, 3):
        with threads(count):
            others = list(zip(cameras[1:], pictures[1:], strict=True))
            found.append(sweep_depth(cameras[0], pictures[0], others, ladder, SweepSettings(), usable=asked))
    assert all(np.array_equal(a, b) for a, b in zip(*found, strict=True))


def test_swept_points_lie_on_the_plane() -> None:
    cameras = [camera_at(0.3 * i) for i in range(4)]
    images = [np.repeat(np.clip(photograph(c), 0, 255).round().astype(np.uint8)[..., None], 3, 2) for c in cameras]
    usable = [np.ones(i.shape[:2], bool) for i in images]
    points, size = sweep_points(cameras, images, usable, SweepSettings(), near=2.0, far=40.0)
    off = np.abs(points @ NORMAL - OFFSET) / np.linalg.norm(NORMAL)
    assert len(points) > 2000 and len(size) == len(points)
    assert np.median(off) < 0.03 and (off < 0.2).mean() > 0.97


def test_a_frame_of_another_size_is_compared_with_none_but_its_like() -> None:
    cameras = [camera_at(x) for x in (0.0, 0.3, 0.6)]
    pictures = [np.repeat(photograph(c).clip(0, 255).astype(np.uint8)[..., None], 3, axis=2) for c in cameras]
    alike = sweep_points(cameras[:2], pictures[:2], [np.ones((80, 120), bool)] * 2, SweepSettings(), near=1.0, far=60.0)
    cameras[2], pictures[2] = replace(cameras[2], height=60), pictures[2][:60]
    usable = [np.ones(p.shape[:2], bool) for p in pictures]
    mixed = sweep_points(cameras, pictures, usable, SweepSettings(), near=1.0, far=60.0)
    assert len(alike[0]) > 300 and len(mixed[0]) >= len(alike[0])
