"""Points on dynamic objects are looked for near these, and those are found that looking everywhere finds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ground.test_blocks import straight
from tests.ground.test_street import look
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.importing.sweeps import in_boxes
from unveil_core.geometry.axes import UP, up_frame
from unveil_core.geometry.grid import PointGrid
from unveil_core.ground.height_field import HeightField
from unveil_core.movers.boxes import points_in_boxes
from unveil_core.movers.contacts import Contacts
from unveil_core.movers.points import points_along_track, points_behind_contacts
from unveil_core.movers.seen_through import WIDE, DriveVisibility, FrameVisibility

ALL_M = 1e6
"""Side of cells of which one holds everything, metres."""
FLAT = HeightField(up_frame(UP), np.array([-300.0, -200.0]), 200.0, np.zeros((4, 4)))


def crowd(seed: int, count: int = 4000) -> np.ndarray:
    return np.random.default_rng(seed).uniform([-20, -12, -0.2], [300, 12, 3], (count, 3))


@pytest.mark.parametrize("seed", range(4))
def test_points_of_boxes(seed: int) -> None:
    generator = np.random.default_rng(seed)
    drive = straight(30, 8.0)

    def boxes(k: int) -> tuple[TrackedBox, ...]:
        return tuple(
            TrackedBox(n, "car", (8.0 * k + n, float(generator.normal(0, 4)), 0.8), (4.0 + n, 1.8, 1.6), 0.3 * k + n)
            for n in (1, 2, 3)
        )

    drive = replace(drive, frames=tuple(replace(f, boxes=boxes(k)) for k, f in enumerate(drive.frames)))
    points = PointCloud(crowd(seed))
    moved = [b for f in drive.frames for b in f.boxes if b.id != 2]
    found = points_in_boxes(points, drive, [1, 3])
    assert np.array_equal(found, in_boxes(points.positions, moved)) and 20 < found.sum() < 2000
    assert not points_in_boxes(points, drive, []).any()


@pytest.mark.parametrize("seed", range(4))
def test_points_behind_contacts(seed: int) -> None:
    points, camera = crowd(seed), look(np.array([20.0 * seed, 0.0, 1.6]), 0.1 * seed)
    columns = np.arange(30, 70, 2)
    depth = np.linspace(9.0, 14.0, len(columns))
    contacts = Contacts(columns, np.zeros((len(columns), 3)), depth, 0.02 * depth, np.ones(len(columns)))
    mask = np.zeros((camera.height, camera.width), dtype=bool)
    mask[10:60, 28:72] = True
    few, all_ = (
        points_behind_contacts(points, PointGrid(points, cell), mask, contacts, camera, WIDE, FLAT)
        for cell in (3.0, ALL_M)
    )
    assert np.array_equal(few, all_) and len(few) > 5


@pytest.mark.parametrize("seed", range(4))
def test_points_along_a_track(seed: int) -> None:
    points = crowd(seed)
    cameras = [look(np.array([5.0 * i, 0.0, 1.6]), 0.0) for i in range(20)]
    shape = cameras[0].height, cameras[0].width
    seen = FrameVisibility(np.ones(shape, bool), np.zeros(shape, bool))
    visibility = DriveVisibility(cameras, [seen] * len(cameras))
    track = np.column_stack([np.linspace(30, 60, 7), np.linspace(-3, 2 + seed, 7), np.zeros(7)])
    few, all_ = (
        points_along_track(points, PointGrid(points, cell), track, 1.5, visibility, WIDE, FLAT) for cell in (3.0, ALL_M)
    )
    assert np.array_equal(few, all_) and len(few) > 20
