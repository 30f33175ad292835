"""Objects whose instance ids are the ids of the dataset's boxes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.files import write_image_atomic
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import Drive, Frame, PointCloud
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.geometry.camera import Camera
from unveil_core.semantics.labels import find_labels
from unveil_core.semantics.objects import FoundObjects, find_objects

ROAD, SKY, CAR = 0, 10, 13
STATIC = TrackedBox(4, "car", (10.0, 2.0, 0.8), (4.2, 1.8, 1.6), 0.4)


def camera() -> Camera:
    pose = np.eye(4)
    pose[:3, :3] = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
    pose[:3, 3] = -pose[:3, :3] @ np.array([0.0, 0.0, 1.5])
    return Camera(96, 64, 60.0, 60.0, 48.0, 32.0, pose)


def drive_of(folder: Path, boxes: list[tuple[TrackedBox, ...]], ids: list[np.ndarray]) -> Drive:
    """A drive that stands still; its pictures show ids as cars."""
    frames = []
    for i, (own, image) in enumerate(zip(boxes, ids, strict=True)):
        semantic = np.where(image > 0, CAR, ROAD).astype(np.uint8)
        semantic[:16] = SKY
        paths = [folder / f"{n}{i}.png" for n in ("semantic", "instance")]
        write_image_atomic(paths[0], semantic)
        write_image_atomic(paths[1], image.astype(np.uint16))
        frames.append(Frame(f"{i}", "front", camera(), folder / "none.png", None, *paths, boxes=own))
    points = np.random.default_rng(0).uniform((5, -4, 0), (14, 4, 1.5), (3000, 3))
    return Drive(folder, tuple(frames), PointCloud(points))


def shown(box: TrackedBox) -> np.ndarray:
    """(H, W) its id in the rectangle that it spans."""
    pixel = np.clip(camera().project(box.corners())[0], 0, (96, 64))
    (x0, y0), (x1, y1) = np.floor(pixel.min(axis=0)).astype(int), np.ceil(pixel.max(axis=0)).astype(int)
    image = np.zeros((64, 96), np.uint16)
    image[y0:y1, x0:x1] = box.id
    return image


def found_in(drive: Drive) -> FoundObjects:
    return find_objects(drive, find_labels(drive))


def test_a_static_object_has_the_median_of_its_boxes(tmp_path: Path) -> None:
    boxes = [STATIC, replace(STATIC, size=(9.0, 1.8, 1.6)), replace(STATIC, centre=(10.1, 2.0, 0.8), yaw=0.4 - np.pi)]
    drive = drive_of(tmp_path, [(b,) for b in boxes], [shown(STATIC)] * 3)
    (car,) = found_in(drive).objects
    assert (car.id, car.class_name, car.source) == (4, "car", "boxes")
    assert car.box is not None
    assert car.box.size == pytest.approx((4.2, 1.8, 1.6))
    got = np.sort(car.box.corners(up_frame(UP)), axis=0)
    np.testing.assert_allclose(got, np.sort(STATIC.corners(), axis=0), atol=1e-6)


def test_a_moved_object_has_the_box_of_the_frame_that_shows_it_best(tmp_path: Path) -> None:
    near = replace(STATIC, centre=(7.0, 1.0, 0.8))
    drive = drive_of(tmp_path, [(STATIC,), (near,)], [shown(STATIC), shown(near)])
    (car,) = found_in(drive).objects
    assert car.box is not None
    assert car.box.centre == pytest.approx(near.centre)


def test_numbers_that_are_alike_by_chance_are_no_boxes(tmp_path: Path) -> None:
    elsewhere = replace(STATIC, centre=(10.0, -3.0, 0.8))
    drive = drive_of(tmp_path, [(elsewhere,)] * 2, [shown(STATIC)] * 2)
    (car,) = found_in(drive).objects
    assert car.source == "images"


def test_only_what_some_frame_shows_is_listed(tmp_path: Path) -> None:
    other = replace(STATIC, id=5, centre=(12.0, -3.0, 0.8))
    speck = np.zeros((64, 96), np.uint16)
    speck[40, 80:84] = 9
    drive = drive_of(tmp_path, [(STATIC, other)] * 2, [shown(STATIC) + speck] * 2)
    found = found_in(drive)
    assert [o.id for o in found.objects] == [4]
    assert set(np.unique(found.point_objects)) <= {0, 4}
