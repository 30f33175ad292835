"""Objects that some frames' labels overlook: these frames have no say there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.files import write_image_atomic
from unveil_core.drives.drive import Drive, Frame, PointCloud
from unveil_core.geometry.camera import Camera
from unveil_core.semantics.labels import find_labels, frame_labels
from unveil_core.semantics.overlooked import overlooked_pixels

ROAD, CAR = 0, 13
BLUE, GREY = (40, 60, 150), (120, 120, 120)
FRAMES, WIDTH, HEIGHT = 5, 192, 128


def camera(x: float) -> Camera:
    """Looks along x, 1.5 m over the road."""
    pose = np.eye(4)
    pose[:3, :3] = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
    pose[:3, 3] = -pose[:3, :3] @ np.array([x, 0.0, 1.5])
    return Camera(WIDTH, HEIGHT, 150.0, 150.0, WIDTH / 2, HEIGHT / 2, pose)


def points() -> tuple[np.ndarray, np.ndarray]:
    """Points of a road (P, 3) and of a car's back, a wall 2 m wide and 1.5 m high at x = 12."""
    x, y = (p.ravel() for p in np.meshgrid(np.arange(4, 12, 0.15), np.arange(-4, 4, 0.15)))
    y2, z2 = (p.ravel() for p in np.meshgrid(np.arange(-1, 1, 0.06), np.arange(0.05, 1.5, 0.06)))
    return np.c_[x, y, np.zeros_like(x)], np.c_[np.full_like(y2, 12.0), y2, z2]


def car_in(view: Camera) -> np.ndarray:
    """(H, W) where it shows the car."""
    pixel, _ = view.project(points()[1])
    (x0, y0), (x1, y1) = np.floor(pixel.min(axis=0)).astype(int), np.ceil(pixel.max(axis=0)).astype(int)
    mask = np.zeros((HEIGHT, WIDTH), dtype=bool)
    mask[max(y0, 0) : y1, max(x0, 0) : x1] = True
    return mask


def drive_of(folder: Path, label: Callable[[int, np.ndarray], np.ndarray], frames: int = FRAMES) -> Drive:
    """A drive towards the car; ``label`` makes of a frame's number and the car's pixels those that are called so."""
    made = []
    for i in range(frames):
        view, path = camera(0.8 * i * FRAMES / frames), folder / f"{i}.png"
        write_image_atomic(path, np.where(label(i, car_in(view)), CAR, ROAD).astype(np.uint8))
        made.append(Frame(f"{i}", "front", view, folder / "none.png", None, path))
    return Drive(folder, tuple(made), PointCloud(np.concatenate(points())))


def pictures(drive: Drive) -> list[np.ndarray]:
    return [np.where(car_in(f.camera)[..., None], BLUE, GREY).astype(np.uint8) for f in drive.frames]


@pytest.mark.parametrize("lost", [(2,), (1, 2), (0,)])
def test_a_car_that_a_frame_loses_is_found_there_and_only_there(tmp_path: Path, lost: tuple[int, ...]) -> None:
    drive = drive_of(tmp_path, lambda i, car: car & (i not in lost))
    found = overlooked_pixels(drive, find_labels(drive), pictures(drive))
    for i, frame in enumerate(drive.frames):
        car = car_in(frame.camera)
        if i in lost:
            assert (found[i] & car).sum() > 0.9 * car.sum() and (found[i] & ~car).sum() < 0.35 * car.sum()
        else:
            assert not found[i].any()


def test_its_label_does_not_count_there(tmp_path: Path) -> None:
    drive = drive_of(tmp_path, lambda i, car: car & (i != 2))
    scene = find_labels(drive)
    mask = overlooked_pixels(drive, scene, pictures(drive))[2]
    write_image_atomic(tmp_path / "overlooked/front/2.png", np.where(mask, 255, 0).astype(np.uint8))
    told = replace(scene, overlooked=tmp_path / "overlooked")
    assert (frame_labels(drive.frames[2], told) == np.where(mask, -1, 0)).all()
    assert (frame_labels(drive.frames[1], told) == frame_labels(drive.frames[1], scene)).all()


def test_what_drove_away_or_hides_it_is_not_overlooked(tmp_path: Path) -> None:
    drive = drive_of(tmp_path, lambda i, car: car & (i != 2))
    shown = pictures(drive)
    shown[2][:] = GREY
    assert not overlooked_pixels(drive, find_labels(drive), shown)[2].any()


def test_a_grey_car_that_left_is_not_overlooked(tmp_path: Path) -> None:
    """Colours alone do not tell a grey car from the road behind it."""
    drive = drive_of(tmp_path, lambda i, car: car & (i < 6), frames=10)
    shown = [np.full((HEIGHT, WIDTH, 3), GREY, np.uint8) for _ in drive.frames]
    assert not any(m.any() for m in overlooked_pixels(drive, find_labels(drive), shown))


def test_a_car_that_one_frame_alone_shows_is_that_frame_s_error(tmp_path: Path) -> None:
    drive = drive_of(tmp_path, lambda i, car: car & (i == 2))
    assert not any(m.any() for m in overlooked_pixels(drive, find_labels(drive), pictures(drive)))


@pytest.mark.parametrize("shift", [(1, 1), (-1, 2), (2, -1)])
def test_borders_that_are_off_overlook_nothing(tmp_path: Path, shift: tuple[int, int]) -> None:
    drive = drive_of(tmp_path, lambda i, car: np.roll(car, shift if i % 2 else (0, 0), axis=(0, 1)))
    assert not any(m.any() for m in overlooked_pixels(drive, find_labels(drive), pictures(drive)))


def test_a_drive_without_points_tells_nothing(tmp_path: Path) -> None:
    drive = replace(drive_of(tmp_path, lambda i, car: car), points=PointCloud(np.zeros((0, 3))))
    assert not any(m.any() for m in overlooked_pixels(drive, find_labels(drive), pictures(drive)))
