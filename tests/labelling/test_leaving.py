"""Objects at the ends of a drive: their tracks stop too early, and their boxes end before they do, while the picture shows them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.labelling.leaving import COUNT, MOVING, PARKED, Spoilt, leaving, truth
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.cityscapes import train_id
from unveil_core.drives.drive import Drive
from unveil_core.labelling.from_boxes import label_frames
from unveil_core.semantics.classes import REMOVABLE

IDS = [train_id(name) for name in REMOVABLE]
FIRST, LAST = (0,), (COUNT - 1,)


def masks(drive: Drive, frames: tuple[int, ...]) -> list[np.ndarray]:
    labels = label_frames(drive)
    return [np.isin(labels[i].semantic, IDS) for i in frames]


def assert_found(
    drive: Drive, usual: list[np.ndarray], frames: tuple[int, ...], number: int, least: float = 0.98
) -> None:
    """The object is masked in these frames, and of the street no more than where nothing is wrong with the boxes, but for a rim."""
    for i, mask in zip(frames, masks(drive, frames), strict=True):
        true = truth(drive.frames[i])
        own, street = true == number, true == 0
        assert own.sum() > 300
        recall, spoilt = float(mask[own].mean()), int((mask & ~usual[i] & street).sum()) / int(own.sum())
        assert recall >= least, (i, recall)
        assert spoilt < 0.05, (i, spoilt)


def without(number: int, frames: tuple[int, ...]) -> Spoilt:
    return lambda i, box: None if box.id == number and i in frames else box


def changed(number: int, frames: tuple[int, ...], *, shorter: float = 0.0, moved: float = 0.0) -> Spoilt:
    """Boxes that are cut short at the end that the picture shows, or displaced along the street towards the other, metres."""

    def of(i: int, box: TrackedBox) -> TrackedBox:
        if box.id != number or i not in frames:
            return box
        away = (
            -1.0 if number == PARKED and i == COUNT - 1 else 1.0
        )  # the parked car's rear has left the picture by then
        (x, y, z), (length, width, height) = box.centre, box.size
        return replace(box, centre=(x + away * (moved + shorter / 2), y, z), size=(length - shorter, width, height))

    return of


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> list[np.ndarray]:
    """What is masked in each frame where nothing is wrong with the boxes."""
    return masks(leaving(tmp_path_factory.mktemp("whole")), tuple(range(COUNT)))


@pytest.mark.parametrize("number", [PARKED, MOVING])
@pytest.mark.parametrize("frames", [(COUNT - 3, COUNT - 2, COUNT - 1), (0, 1)], ids=["stops", "starts late"])
@pytest.mark.parametrize("classes", [True, False])
def test_a_track_goes_on_while_the_picture_shows_its_object(
    tmp_path: Path, usual: list[np.ndarray], number: int, frames: tuple[int, ...], classes: bool
) -> None:
    spoilt = without(number, frames)
    assert_found(leaving(tmp_path, spoilt, spoilt, classes=classes), usual, frames, number)


@pytest.mark.parametrize("number", [PARKED, MOVING])
@pytest.mark.parametrize("frames", [FIRST, LAST])
@pytest.mark.parametrize("change", [{"shorter": 0.4}, {"moved": 0.5}], ids=["short", "displaced"])
def test_a_box_that_ends_before_its_object_in_the_first_or_last_frame(
    tmp_path: Path, usual: list[np.ndarray], number: int, frames: tuple[int, ...], change: dict[str, float]
) -> None:
    spoilt = changed(number, frames, **change)
    assert_found(leaving(tmp_path, spoilt, spoilt, sweeps=(1, 4), classes=False), usual, frames, number)


def test_points_that_were_measured_beside_their_box_do_not_cut_it(tmp_path: Path, usual: list[np.ndarray]) -> None:
    """Boxes interpolated between key frames wander along the way: those of the sweeps lie ahead, those of the frames do not."""
    drive = leaving(tmp_path, in_sweeps=changed(MOVING, tuple(range(COUNT)), moved=-0.45), sweeps=(1, 4))
    # Where the end of the car lies is told by colours alone: a rim may be lost.
    assert_found(drive, usual, (5, 6, 7), MOVING, 0.975)
