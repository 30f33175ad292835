"""Labels made of boxes and points, against the truth of a ray-cast street."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.labelling.parked_row import CAR, PERSON, POLE, ROAD, SIDEWALK, SKY, parked_row, picture
from unveil_core.base.errors import Cancelled, DriveError
from unveil_core.base.output.written import files_in
from unveil_core.base.parallel import threads
from unveil_core.drives.drive import Drive, FrameLabels, PointCloud
from unveil_core.drives.importing.whole_drive import import_drive, write_labels
from unveil_core.labelling.from_boxes import label_frames


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Drive:
    return parked_row(tmp_path_factory.mktemp("row"))


@pytest.fixture(scope="module")
def labels(drive: Drive) -> list[FrameLabels]:
    return list(label_frames(drive))


def shares(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Intersection over union, and how much of the truth is found."""
    return (found & true).sum() / (found | true).sum(), (found & true).sum() / true.sum()


def test_every_frame_is_labelled_whole(drive: Drive, labels: list[FrameLabels]) -> None:
    assert len(labels) == len(drive.frames)
    for frame, label in zip(drive.frames, labels, strict=True):
        assert label.semantic.shape == (frame.camera.height, frame.camera.width)
        assert (label.semantic.dtype, label.instance.dtype) == (np.uint8, np.uint16)  # type: ignore[union-attr]
        assert (label.semantic < 19).all()
        assert ((label.instance > 0) <= np.isin(label.semantic, (CAR, PERSON))).all()


@pytest.mark.parametrize("classes", [True, False])
def test_outlines_are_those_of_the_objects(tmp_path: Path, classes: bool) -> None:
    drive = parked_row(tmp_path, classes=classes)
    for frame, label in zip(drive.frames, label_frames(drive), strict=True):
        _, kind, owner = picture(frame.camera)
        assert label.instance is not None
        overlap, covered = shares(label.instance > 0, owner > 0)
        assert overlap > 0.85
        assert covered > 0.985
        for number in (1, 2, 4, 5):
            overlap, covered = shares(label.instance == number, owner == number)
            assert overlap > 0.7, (frame.name, number)
            assert covered > 0.88, (frame.name, number)
        assert (label.semantic[owner == 5] == PERSON).mean() > 0.9


def test_near_cars_hide_far_ones(drive: Drive, labels: list[FrameLabels]) -> None:
    """In the row each car's box covers much of the next one."""
    for frame, label in zip(drive.frames, labels, strict=True):
        _, _, owner = picture(frame.camera)
        assert (label.instance[owner == 1] == 1).mean() > 0.95  # type: ignore[index]
        assert (label.instance[owner == 2] == 1).mean() < 0.12  # type: ignore[index]


def test_a_pole_before_a_car_is_spared(drive: Drive, labels: list[FrameLabels]) -> None:
    for frame, label in zip(drive.frames, labels, strict=True):
        _, kind, _ = picture(frame.camera)
        rows = np.flatnonzero((kind == POLE).any(axis=1))
        low = kind == POLE
        low[: rows.max() - 12] = False  # where the car stands behind it
        assert low.sum() > 10
        assert (label.semantic[low] == CAR).mean() < 0.5


def test_the_street_has_its_classes(drive: Drive, labels: list[FrameLabels]) -> None:
    for frame, label in zip(drive.frames, labels, strict=True):
        _, kind, owner = picture(frame.camera)
        street = owner == 0
        assert (label.semantic == kind)[street].mean() > 0.96
        for name, least in ((ROAD, 0.93), (SKY, 0.95), (SIDEWALK, 0.9)):
            assert shares((label.semantic == name) & street, (kind == name) & street)[1] > least, (frame.name, name)


def test_without_classes_the_ground_is_road_and_the_rest_building(tmp_path: Path) -> None:
    drive = parked_row(tmp_path, classes=False)
    for frame, label in zip(drive.frames, label_frames(drive), strict=True):
        _, kind, owner = picture(frame.camera)
        street = owner == 0
        ground = street & np.isin(kind, (ROAD, SIDEWALK))
        assert (label.semantic[ground] == ROAD).mean() > 0.93
        assert (label.semantic[street & (kind == 2)] == 2).mean() > 0.9
        assert (label.semantic[street & (kind == SKY)] == SKY).mean() > 0.95


def test_points_without_sweeps_show_static_objects(tmp_path: Path) -> None:
    drive = parked_row(tmp_path, sweeps=False)
    for frame, label in zip(drive.frames, label_frames(drive), strict=True):
        _, _, owner = picture(frame.camera)
        assert min(shares(label.instance > 0, owner > 0)) > 0.85  # type: ignore[operator]


def test_boxes_alone_are_enough(drive: Drive) -> None:
    bare = replace(drive, sweeps=(), points=PointCloud(np.zeros((0, 3))), frames=drive.frames[:1])
    (label,) = label_frames(bare)
    _, _, owner = picture(drive.frames[0].camera)
    assert shares(label.instance > 0, owner > 0)[1] > 0.9  # type: ignore[operator]
    assert (label.semantic[0] == SKY).mean() > 0.5


def test_a_drive_without_boxes_has_no_objects(drive: Drive) -> None:
    frame = replace(drive.frames[0], boxes=())
    bare = replace(drive, frames=(frame,), sweeps=(), points=drive.points.select(drive.points.positions[:, 2] < 0.1))
    (label,) = label_frames(bare)
    assert not label.instance.any()  # type: ignore[union-attr]
    assert not np.isin(label.semantic, (CAR, PERSON)).any()


def test_labels_are_the_same_again(drive: Drive, labels: list[FrameLabels]) -> None:
    for one, other in zip(labels, label_frames(drive), strict=True):
        np.testing.assert_array_equal(one.semantic, other.semantic)
        np.testing.assert_array_equal(one.instance, other.instance)


def test_an_unknown_class_is_one_clear_line(drive: Drive) -> None:
    frame = replace(drive.frames[0], boxes=(replace(drive.frames[0].boxes[0], class_name="spaceship"),))
    with pytest.raises(DriveError, match="spaceship"):
        label_frames(replace(drive, frames=(frame,)))


def test_it_can_be_cancelled(drive: Drive) -> None:
    def stop(done: int, total: int, message: str = "", **metrics: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        label_frames(drive, stop)


def test_frames_that_are_imported_and_labelled_together_are_the_same_files(tmp_path: Path) -> None:
    drive = parked_row(tmp_path / "row")
    for name, count in (("alone", 1), ("together", 3)):
        with threads(count):
            imported = import_drive(drive, tmp_path / name, work_side=160)
            done: list[int] = []

            def progress(k: int, *_: object, done: list[int] = done) -> None:
                done.append(k)

            write_labels(tmp_path / name, label_frames(imported), progress, together=True)
            assert done == [1, 2, 3]
    files = files_in(tmp_path / "alone")
    assert files == files_in(tmp_path / "together") and sum("semantics" in f for f in files) == 3
    for name in files:
        one, other = ((tmp_path / folder / name).read_bytes() for folder in ("alone", "together"))
        assert one == other, name
