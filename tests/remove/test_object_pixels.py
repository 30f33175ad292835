"""Which pixels of a frame show what is removed: by its own labels, by what was drawn, and enlarged where a person asks for it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.drives.tiny_drive import make_tiny_drive
from tests.remove.test_regions import surfels_at
from unveil_core.base.pictures.decoding import read_image
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive, Footage, Frame
from unveil_core.drives.marked import MarkedObject
from unveil_core.geometry.images import grow
from unveil_core.remove.object_pixels import OWN_KINDS, ObjectPixels, drawn_by_kind, working_px
from unveil_core.semantics.labels import SceneLabels, find_labels

CAR = np.zeros((24, 32), dtype=bool)
CAR[12:18, 18:26] = True
NOWHERE = np.zeros_like(CAR)


def of_drive(drive: Drive, scene: SceneLabels, **changes: object) -> ObjectPixels:
    """Of a scene that holds nothing but a surfel far behind all cameras: only the frames tell."""
    nothing = surfels_at(np.array([[-500.0, 0, 0]]), np.array([0]))
    kinds = drawn_by_kind(nothing, np.zeros(1, bool), np.zeros(1, np.int64), (), {})
    found = ObjectPixels(
        drive, scene, None, kinds, (), {}, lambda f: read_image(f.image_path), lambda f: NOWHERE, lambda f: NOWHERE
    )
    return replace(found, **changes)  # type: ignore[arg-type]


@pytest.fixture
def labelled(tmp_path: Path) -> tuple[Drive, SceneLabels]:
    drive = open_drive(make_tiny_drive(tmp_path / "drive"))
    return drive, replace(find_labels(drive), removed=())


def test_a_frames_own_labels_tell_what_goes(labelled: tuple[Drive, SceneLabels]) -> None:
    drive, scene = labelled
    chosen = replace(scene, removed=("car",))
    assert np.array_equal(of_drive(drive, chosen).seen(drive.frames[0]).hidden, CAR)
    assert not of_drive(drive, scene).seen(drive.frames[0]).hidden.any()
    by_object = replace(scene, instances=(300,))
    assert np.array_equal(of_drive(drive, by_object).seen(drive.frames[0]).hidden, CAR)


def test_what_moves_goes_and_the_ego_vehicle_stays(labelled: tuple[Drive, SceneLabels]) -> None:
    drive, scene = labelled
    moving, ego = np.zeros_like(CAR), np.zeros_like(CAR)
    moving[:4], ego[2:] = True, True
    hidden = of_drive(drive, scene, moving=lambda f: moving, ego=lambda f: ego).seen(drive.frames[1]).hidden
    assert hidden[:2].all() and not hidden[2:].any()


def test_a_single_objects_mask_is_enlarged_by_pixels_of_the_delivered_frame(
    labelled: tuple[Drive, SceneLabels],
) -> None:
    drive, scene = labelled
    chosen, frame = replace(scene, removed=("car",)), drive.frames[0]
    hidden = of_drive(drive, chosen, grown={300: 2}).seen(frame).hidden
    assert np.array_equal(hidden, grow(CAR, 2))
    assert np.array_equal(of_drive(drive, chosen, grown={301: 2}).seen(frame).hidden, CAR), "another object's"


def test_pixels_of_the_delivered_frame_are_fewer_of_a_smaller_working_one(labelled: tuple[Drive, SceneLabels]) -> None:
    frame: Frame = labelled[0].frames[0]
    large = replace(frame.camera, width=128, height=96)
    footage = Footage(frame.image_path, large)
    assert working_px(frame, 8) == 8
    assert [working_px(replace(frame, footage=footage), n) for n in (1, 8, 20)] == [1, 2, 5]


def test_what_goes_is_drawn_by_kind() -> None:
    surfels = surfels_at(np.zeros((6, 3)), np.array([4, 4, 4, 4, 5, 5]))
    gone, ids = np.array([0, 1, 1, 1, 1, 0], bool), np.array([0, 0, 7, 8, 9, 9])
    drawn = drawn_by_kind(surfels, gone, ids, (MarkedObject(7, "car"),), {8: 3, 9: 1})
    assert drawn.labels.tolist() == [0, 1, 2, OWN_KINDS, OWN_KINDS + 1, 0]


def test_other_frames_labels_tell_whether_a_place_has_something_that_goes(labelled: tuple[Drive, SceneLabels]) -> None:
    drive, scene = labelled
    pixels = of_drive(drive, replace(scene, removed=("car",)))
    far = np.full(CAR.shape, 150.0, np.float32)  # where all frames have it at the same pixel
    assert np.array_equal(pixels._backed(drive.frames[1], far, np.ones_like(CAR)), CAR)
    alone = of_drive(replace(drive, frames=drive.frames[:1]), replace(scene, removed=("car",)))
    assert alone._backed(drive.frames[0], far, np.ones_like(CAR)).all(), "nobody says no"
