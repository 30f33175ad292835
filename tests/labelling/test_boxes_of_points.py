"""Boxes put around labelled points, against the street's own boxes and the outlines of its objects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.drives.formats.street.all_formats import WRITERS
from tests.drives.formats.street.street import tiny_street
from tests.ground.test_blocks import straight
from tests.labelling.parked_row import CAR, PERSON, ROAD, boxes, parked_row, picture
from unveil_core.drives import open_drive
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.depth_range import ASKED_M
from unveil_core.drives.drive import Drive, PointCloud
from unveil_core.labelling.boxes_of_points import points_have_classes, with_boxes_of_points
from unveil_core.labelling.from_boxes import label_frames
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.steps.import_ import labels_come_from


def without_boxes(drive: Drive) -> Drive:
    return replace(
        drive,
        frames=tuple(replace(f, boxes=()) for f in drive.frames),
        sweeps=tuple(replace(s, boxes=()) for s in drive.sweeps),
    )


def owner_of(box: TrackedBox) -> TrackedBox:
    """The street's own box that a found one lies in; there is just one."""
    (own,) = (b for b in boxes() if (np.abs(b.local(np.array([box.centre]))) <= 1).all())
    return own


def test_boxes_hold_one_object_and_all_objects_are_in_boxes(tmp_path: Path) -> None:
    drive = with_boxes_of_points(without_boxes(parked_row(tmp_path)))
    found = drive.frames[0].boxes
    assert len({b.id for b in found}) == len(found)
    assert all(f.boxes == found for f in drive.frames) and all(s.boxes == found for s in drive.sweeps)
    # A pole before a car parts it in two, and sides that are seen from afar fall apart.
    assert {owner_of(b).id for b in found} == {b.id for b in boxes()} and len(found) < 2 * len(boxes())
    for box in found:
        assert box.class_name == owner_of(box).class_name
        assert max(box.size) < max(owner_of(box).size) + 0.1
    positions = drive.points.positions[np.isin(drive.points.classes, (CAR, PERSON))]
    inside = np.any([(np.abs(b.local(positions)) <= 1.1).all(axis=1) for b in found], axis=0)
    assert inside.mean() > 0.95


def test_frames_are_labelled_without_boxes_of_the_dataset(tmp_path: Path) -> None:
    drive = with_boxes_of_points(without_boxes(parked_row(tmp_path)))
    for frame, label in zip(drive.frames, label_frames(drive), strict=True):
        _, _, owner = picture(frame.camera)
        assert label.instance is not None
        mine, true = label.instance > 0, owner > 0
        assert (mine & true).sum() / (mine | true).sum() > 0.8
        assert (mine & true).sum() / true.sum() > 0.95


def test_the_way_of_an_object_that_moves_gets_no_box(tmp_path: Path) -> None:
    drive = without_boxes(parked_row(tmp_path))
    generator = np.random.default_rng(0)
    way = np.column_stack([generator.uniform(-30, 0, 4000), generator.normal(0, 0.3, 4000), np.full(4000, 1.0)])
    assert drive.points.classes is not None
    points = replace(
        drive.points,
        positions=np.concatenate([drive.points.positions, way]),
        classes=np.concatenate([drive.points.classes, np.full(4000, CAR, np.uint8)]),
    )
    found = with_boxes_of_points(replace(drive, points=points)).frames[0].boxes
    assert [b.size for b in found] == [b.size for b in with_boxes_of_points(drive).frames[0].boxes]


def test_points_without_classes_or_objects_give_no_boxes(tmp_path: Path) -> None:
    bare = without_boxes(parked_row(tmp_path / "a", classes=False))
    assert not points_have_classes(bare) and with_boxes_of_points(bare) is bare
    drive = without_boxes(parked_row(tmp_path / "b"))
    road = replace(drive.points, classes=np.full(len(drive.points.positions), ROAD, np.uint8))
    assert with_boxes_of_points(replace(drive, points=road)).frames[0].boxes == ()


@pytest.mark.parametrize(
    ("name", "source"),
    [
        ("transforms.json", "drive"),
        ("KITTI-360", "dataset"),
        ("PandaSet", "boxes"),
        ("Waymo Open v2", "boxes"),
        ("KITTI odometry", "points"),
    ],
)
def test_labels_come_from_the_best_that_a_format_has(tmp_path: Path, name: str, source: str) -> None:
    path = WRITERS[name](tmp_path, tiny_street())
    assert labels_come_from(open_drive(path), RunSettings()) == source
    if name == "KITTI odometry":
        for file in tmp_path.rglob("*.label"):
            file.unlink()
        assert labels_come_from(open_drive(path), RunSettings()) == "nothing"


def test_frames_of_a_long_drive_have_the_boxes_near_them() -> None:
    generator = np.random.default_rng(0)
    at = np.array([20.0, 150.0, 400.0])
    positions = np.concatenate([generator.uniform(-1, 1, (300, 3)) * [2, 0.8, 0.7] + [x, 4, 0.8] for x in at])
    points = PointCloud(positions, classes=np.full(len(positions), CAR, np.uint8))
    drive = with_boxes_of_points(replace(straight(51, 10.0), points=points))
    for frame in drive.frames:
        near = np.abs(at - frame.camera.centre[0]) < ASKED_M - 3
        far = np.abs(at - frame.camera.centre[0]) > ASKED_M + 3
        shown = [b.centre[0] for b in frame.boxes]
        assert all(np.abs(x - np.array(shown)).min(initial=9.0) < 1 for x in at[near])
        assert not any(np.abs(x - np.array(shown)).min(initial=9.0) < 1 for x in at[far])
