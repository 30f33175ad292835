"""Tracked boxes are read, checked, brought to local coordinates and kept."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.hard_drives import make_tiny_street
from tests.other_frame import Y_UP_UTM, box_in_other_frame
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.boxes import TrackedBox, read_boxes
from unveil_core.drives.importing.whole_drive import import_drive

BOX = {"id": 7, "class": "car", "centre": [600010.0, 2.0, 0.75], "size": [4.2, 1.8, 1.5], "yaw": 0.5}


def test_a_box_knows_what_lies_in_it() -> None:
    box = read_boxes([BOX], Path("t.json"), "00")[0]
    corners = box.corners()
    np.testing.assert_allclose(np.abs(box.local(corners)), 1.0, atol=1e-9)
    np.testing.assert_allclose(corners.mean(axis=0), box.centre)
    along = corners[4] - corners[0]
    np.testing.assert_allclose(along, 4.2 * np.array([np.cos(0.5), np.sin(0.5), 0.0]), atol=1e-9)
    assert read_boxes([box.to_json()], Path("t.json"), "00") == (box,)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"id": 0}, "not an id from 1 to 65535: 0"),
        ({"size": [4.0, 0.0, 1.0]}, "not positive"),
        ({"centre": [1.0, 2.0]}, "three numbers"),
        ({"yaw": float("nan")}, "not finite"),
        ({"class": ""}, "class is empty"),
    ],
)
def test_a_bad_box_is_one_line(change: dict[str, Any], message: str) -> None:
    with pytest.raises(DriveError, match=rf"t\.json: box 0 of frame 00: .*{message}"):
        read_boxes([{**BOX, **change}], Path("t.json"), "00")


def test_lists_are_checked_too() -> None:
    assert read_boxes(None, Path("t.json"), "00") == ()
    with pytest.raises(DriveError, match="two boxes of one id"):
        read_boxes([BOX, BOX], Path("t.json"), "00")
    with pytest.raises(DriveError, match="Not a list"):
        read_boxes({"id": 3}, Path("t.json"), "00")
    with pytest.raises(DriveError, match="lacks 'centre'"):
        read_boxes([{"id": 3, "class": "car"}], Path("t.json"), "00")


def test_boxes_of_another_frame_become_the_same_boxes() -> None:
    (box,) = read_boxes([BOX], Path("t.json"), "00")
    again = box_in_other_frame(box).to_local(Y_UP_UTM)
    np.testing.assert_allclose(again.corners(), box.corners(), atol=1e-6)
    assert again.yaw == box.yaw


def test_boxes_are_imported_with_the_frames(tmp_path: Path) -> None:
    path = make_tiny_street(tmp_path / "street", [0.0, 1.0, 2.0])
    document = json.loads(path.read_text())
    document["frames"][1]["boxes"] = [{**BOX, "centre": [10.0, 2.0, 0.75]}]
    path.write_text(json.dumps(document))
    drive = import_drive(open_drive(path), tmp_path / "drive")
    assert [len(f.boxes) for f in drive.frames] == [0, 1, 0]
    box = drive.frames[1].boxes[0]
    assert isinstance(box, TrackedBox) and box.class_name == "car"
    np.testing.assert_allclose(np.asarray(box.centre) + drive.to_world.translation, [10.0, 2.0, 0.75])
    assert "boxes" not in json.loads((tmp_path / "drive/cameras.json").read_text())["frames"][0]
