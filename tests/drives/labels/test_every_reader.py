"""Labels and instance maps of a folder are taken with every format, and reach what is imported."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tests.drives.formats.street.all_formats import WRITERS
from tests.drives.formats.street.street import tiny_street
from tests.drives.labels.files import in_colours
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.files import write_image_atomic
from unveil_core.drives import open_drive
from unveil_core.drives.cityscapes import CITYSCAPES
from unveil_core.drives.drive import Frame
from unveil_core.drives.imported import read_imported
from unveil_core.drives.importing.check import check_drive
from unveil_core.drives.importing.whole_drive import import_drive, write_labels
from unveil_core.drives.labels.reading import instances_of, semantics_of
from unveil_core.labelling.from_boxes import label_frames
from unveil_core.pipeline.settings import RunSettings
from unveil_core.pipeline.steps.import_ import labels_come_from

CAR = CITYSCAPES.index("car")


def label_of(frame: Frame, i: int) -> np.ndarray:
    """trainIds of frame i: a street with a car that moves to the right."""
    height, width = frame.camera.height, frame.camera.width
    label = np.zeros((height, width), np.uint8)
    label[: height // 2] = CITYSCAPES.index("building")
    label[: height // 4] = CITYSCAPES.index("sky")
    label[height // 2 : 3 * height // 4, 2 + i : 12 + i] = CAR
    return label


def write(folder: Path, frames: Sequence[Frame], *, colours: bool) -> None:
    for i, frame in enumerate(frames):
        label = label_of(frame, i)
        path = folder / f"labels/{frame.camera_name}/{frame.name}.png"
        write_image_atomic(path, in_colours(label) if colours else label)
        path = folder / f"maps/{frame.camera_name}/{frame.name}.png"
        write_image_atomic(path, np.where(label == CAR, 77, 0).astype(np.uint16))


@pytest.mark.parametrize("name", WRITERS)
def test_with_every_format(name: str, tmp_path: Path) -> None:
    path = WRITERS[name](tmp_path / "drive", tiny_street())
    write(tmp_path, open_drive(path).frames, colours=name != "transforms.json")
    options = DriveOptions(labels=str(tmp_path / "labels"), instance_maps=str(tmp_path / "maps"))
    opened = open_drive(path, options)
    assert labels_come_from(opened, RunSettings()) == "drive"
    check_drive(opened)
    for i, frame in enumerate(opened.frames):
        wanted = label_of(frame, i)
        assert np.array_equal(semantics_of(frame), wanted)
        assert np.array_equal(instances_of(frame), np.where(wanted == CAR, 77, 0))
    imported = import_drive(opened, tmp_path / "imported", work_side=None)
    assert len(imported.frames) == len(opened.frames)
    for frame in imported.frames:
        label, instance = semantics_of(frame), instances_of(frame)
        assert set(np.unique(label)) <= {0, 2, 10, CAR, 255} and (label == CAR).any()
        assert np.array_equal(instance == 77, label == CAR)


def test_instance_maps_stay_where_boxes_label_the_rest(tmp_path: Path) -> None:
    path = WRITERS["PandaSet"](tmp_path / "drive", tiny_street())
    write(tmp_path, open_drive(path).frames, colours=False)
    opened = open_drive(path, DriveOptions(instance_maps=str(tmp_path / "maps")))
    assert labels_come_from(opened, RunSettings()) == "boxes"
    imported = import_drive(opened, tmp_path / "imported", work_side=None)
    write_labels(tmp_path / "imported", label_frames(imported))
    for frame in read_imported(tmp_path / "imported").frames:
        assert frame.semantic_path is not None
        assert set(np.unique(instances_of(frame))) == {0, 77}
