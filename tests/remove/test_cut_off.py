"""What a mask drawn by hand cuts off of an object, and what it rightly leaves out."""

from __future__ import annotations

import numpy as np
import pytest

from unveil_core.geometry.axes import UP
from unveil_core.geometry.camera import Camera
from unveil_core.ground.path import fit_path
from unveil_core.ground.street import Ground
from unveil_core.remove.cut_off import cut_off_pixels

HEIGHT_M = 1.6


def camera_at(x: float, scale: int = 1) -> Camera:
    pose = np.eye(4)
    pose[:3, :3] = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
    pose[:3, 3] = -pose[:3, :3] @ (x, 0.0, HEIGHT_M)
    return Camera(384 * scale, 256 * scale, 300.0 * scale, 300.0 * scale, 192.0 * scale, 128.0 * scale, pose)


def street() -> Ground:
    path = fit_path([camera_at(x) for x in np.arange(0.0, 10.0)])
    side = np.full(200, 20.0)
    return Ground(path, -40.0, -20.0, 1.0, 0.5, np.zeros((200, 81)), side, -side)


def scene(scale: int) -> tuple[Camera, np.ndarray, np.ndarray, np.ndarray]:
    """A red car 8 m ahead on a grey road, before a green hedge 2 m behind it: photograph, depth and what is the car (H, W)."""
    camera = camera_at(0.0, scale)
    rng = np.random.default_rng(0)
    rays = camera.rays()
    down = -(rays @ UP)
    depth = np.where(down > HEIGHT_M / 10, HEIGHT_M / np.maximum(down, 1e-6), 10.0)
    hedge = down <= HEIGHT_M / 10
    y, x = (rays @ axis * 8.0 for axis in (np.array([0.0, -1.0, 0.0]), UP))
    car = (np.abs(y) < 0.9) & (x + HEIGHT_M > 0) & (x + HEIGHT_M < 1.4)
    depth = np.where(car, 8.0, depth)
    color = np.where(hedge[..., None], (40, 110, 40), (120, 120, 125))
    color = np.where(car[..., None], (180, 25, 30), color)
    photograph = np.clip(color + rng.normal(0, 8, (*car.shape, 3)), 0, 255).astype(np.uint8)
    return camera, photograph, depth, car


@pytest.mark.parametrize("scale", [1, 2])
def test_a_cut_side_is_found_and_nothing_else(scale: int) -> None:
    camera, photograph, depth, car = scene(scale)
    own = car.copy()
    own[:, : np.flatnonzero(car.any(axis=0))[0] + 7 * scale] = False
    found = cut_off_pixels(photograph, camera, depth, own, street())
    over = car & ~own & (depth * -(camera.rays() @ UP) < HEIGHT_M - 0.2)
    assert over.sum() > 100
    assert (found & over).sum() > 0.95 * over.sum()
    assert (found & ~car).sum() < 0.05 * over.sum()
    assert not (found & own).any()


def test_a_whole_mask_stays_as_it_is() -> None:
    camera, photograph, depth, car = scene(1)
    found = cut_off_pixels(photograph, camera, depth, car, street())
    assert found.sum() < 0.01 * car.sum()
    assert not cut_off_pixels(photograph, camera, depth, np.zeros_like(car), street()).any()
    assert not cut_off_pixels(photograph, camera, depth, np.ones_like(car), street()).any()


def test_a_shadow_on_the_road_is_no_piece() -> None:
    camera, photograph, depth, car = scene(1)
    dark = photograph.copy()
    foot = np.flatnonzero(car.any(axis=1))[-1]
    dark[foot - 3 : foot + 8, 150:235] = (180, 25, 30)
    found = cut_off_pixels(dark, camera, depth, car, street())
    assert not found[foot + 1 :].any()


def test_a_person_behind_is_another_one() -> None:
    camera, photograph, depth, car = scene(1)
    rows, columns = np.flatnonzero(car.any(axis=1)), np.flatnonzero(car.any(axis=0))
    person = np.zeros_like(car)
    person[rows[0] - 10 : rows[0] + 20, columns[-1] + 2 : columns[-1] + 10] = True
    photograph[person] = (230, 200, 60)
    found = cut_off_pixels(photograph, camera, depth, car, street())
    assert not (found & person).any()


def test_it_draws_the_same_each_time() -> None:
    camera, photograph, depth, car = scene(1)
    own = car.copy()
    own[:, : np.flatnonzero(car.any(axis=0))[0] + 5] = False
    first = cut_off_pixels(photograph, camera, depth, own, street())
    np.random.default_rng().random(3)
    assert np.array_equal(first, cut_off_pixels(photograph, camera, depth, own, street()))
