"""Points shared out to boxes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import Drive, PointCloud, Sweep, SweepPoints
from unveil_core.labelling.object_points import from_own_axes, gather_objects, in_boxes, own_axes

CAR, ROAD, VOID = 13, 0, 255
BOX = TrackedBox(7, "car", (10.0, 2.0, 0.8), (4.0, 1.8, 1.6), 0.6)


def drive_of(*sweeps: Sweep, points: np.ndarray | None = None, frames: tuple = ()) -> Drive:
    cloud = PointCloud(np.zeros((0, 3)) if points is None else points)
    return Drive(Path("drive"), frames, cloud, sweeps=sweeps)


def sweep_of(positions: np.ndarray, classes: list[int] | None, *boxes: TrackedBox, time: float = 0.0) -> Sweep:
    numbers = None if classes is None else np.array(classes, np.uint8)
    return Sweep(Path("sweep"), lambda: SweepPoints(positions, numbers), time, boxes)


def test_own_axes_and_back() -> None:
    places = np.random.default_rng(0).normal(size=(50, 3)) * 5
    np.testing.assert_allclose(from_own_axes(BOX, own_axes(BOX, places)), places, atol=1e-12)
    front = from_own_axes(BOX, np.array([[2.0, 0.0, 0.0]]))[0]
    np.testing.assert_allclose(front, [10 + 2 * np.cos(0.6), 2 + 2 * np.sin(0.6), 0.8])


def test_a_point_in_two_boxes_is_of_the_nearer_middle() -> None:
    other = replace(BOX, id=8, centre=(10.0 + 3 * np.cos(0.6), 2.0 + 3 * np.sin(0.6), 0.8))
    places = from_own_axes(
        BOX, np.array([[0.0, 0, 0], [1.4, 0, 0], [1.6, 0, 0], [3.0, 0, 0], [9.0, 0, 0], [0, 0, 2.0]])
    )
    np.testing.assert_array_equal(in_boxes(places, (BOX, other), 0.05), [0, 0, 1, 1, -1, -1])
    np.testing.assert_array_equal(in_boxes(places, (), 0.05), -1)
    assert len(in_boxes(np.zeros((0, 3)), (BOX,), 0.05)) == 0


def test_points_of_several_sweeps_lie_in_the_boxes_own_axes() -> None:
    """A moving car: its points fall together though it was measured at two places."""
    local = np.random.default_rng(1).uniform((-1.9, -0.8, -0.5), (1.9, 0.8, 0.7), (200, 3))
    later = replace(BOX, centre=(30.0, -4.0, 1.0), yaw=-1.2)
    sweeps = [sweep_of(from_own_axes(b, local), [CAR] * 200, b, time=t) for t, b in ((0.0, BOX), (1.0, later))]
    objects, strays = gather_objects(drive_of(*sweeps), None)
    assert set(objects) == {7}
    found = objects[7].near(1.0, 1)
    assert len(found) > 150
    assert np.abs(found[:, None] - local).sum(axis=2).min(axis=1).max() < 1e-9
    assert len(objects[7].near(0.2, 10_000)) == len(objects[7].parts[0]) + len(objects[7].parts[1])
    assert [len(s.positions) for s in strays] == [0, 0]


def test_classes_and_the_floor_tell_what_is_ground() -> None:
    local = np.array([[0, 0, -0.75], [0, 0, -0.75], [0, 0, 0.0], [0, 0, 0.1], [1.0, 0, -0.75]])
    places = from_own_axes(BOX, local)
    objects, _ = gather_objects(drive_of(sweep_of(places, [ROAD, CAR, ROAD, VOID, VOID], BOX)), None)
    assert sorted(objects[7].parts[0][:, 2].round(2).tolist()) == [-0.75, 0.1]
    bare, _ = gather_objects(drive_of(sweep_of(places, None, BOX)), None)
    assert sorted(bare[7].parts[0][:, 2].round(2).tolist()) == [0.0, 0.1]
    high, _ = gather_objects(drive_of(sweep_of(places, None, BOX)), lambda p: np.full(len(p), 0.05))
    assert high == {}


def test_removable_points_without_a_box_are_strays() -> None:
    places = np.array([[10.0, 2.0, 0.8], [40.0, 0.0, 1.0], [41.0, 0.0, 0.0]])
    objects, (stray,) = gather_objects(drive_of(sweep_of(places, [CAR, CAR, ROAD], BOX, time=3.0)), None)
    assert len(objects[7].parts[0]) == 1
    assert stray.time == 3.0
    np.testing.assert_allclose(stray.positions, [[40.0, 0, 1]])


def test_boxes_of_what_stays_hold_nothing() -> None:
    cone = replace(BOX, class_name="traffic sign")
    objects, _ = gather_objects(drive_of(sweep_of(np.array([[10.0, 2.0, 0.8]]), None, cone)), None)
    assert objects == {}
