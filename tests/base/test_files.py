"""Photographs as cameras and phones leave them: pixels as they are stored, whatever stands beside them in the file."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from unveil_core.base.errors import DriveError
from unveil_core.base.files import read_json
from unveil_core.base.pictures.decoding import read_image

PICTURE = np.random.default_rng(0).integers(0, 255, (24, 32, 3), dtype=np.uint8)
JPEG = cv2.imencode(".jpg", PICTURE)[1].tobytes()


def held(orientation: int) -> bytes:
    """The photograph with a note that the camera was held so."""
    note = b"Exif\0\0II*\0" + struct.pack("<IHHHIHHI", 8, 1, 0x112, 3, 1, orientation, 0, 0)
    return JPEG[:2] + b"\xff\xe1" + struct.pack(">H", len(note) + 2) + note + JPEG[2:]


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_how_the_camera_was_held_does_not_turn_a_photograph(tmp_path: Path, orientation: int) -> None:
    """Poses are of the pixels as they are stored; COLMAP and nerfstudio do not turn them either."""
    (tmp_path / "plain.jpg").write_bytes(JPEG)
    (tmp_path / "held.jpg").write_bytes(held(orientation))
    shown = cv2.imread(str(tmp_path / "held.jpg"))
    assert not np.array_equal(shown, cv2.imread(str(tmp_path / "plain.jpg")))  # a viewer turns it
    assert np.array_equal(read_image(tmp_path / "held.jpg", (32, 24)), read_image(tmp_path / "plain.jpg"))


@pytest.mark.parametrize("part", ["[]", "{}", "0", '{"a":0}', "[[0]]"])
def test_a_json_of_countless_values_is_refused_before_it_is_read(
    tmp_path: Path, part: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sixty megabytes of empty lists are 1.6 GB of them."""
    (tmp_path / "a.json").write_text("[" + ",".join([part] * 5_000_000) + "]")
    monkeypatch.setattr(json, "loads", lambda *_, **__: pytest.fail("it is read"))
    with pytest.raises(DriveError, match=r"a\.json: Not valid JSON: it holds [0-9,]+ values"):
        read_json(tmp_path / "a.json")


def test_a_long_json_is_read(tmp_path: Path) -> None:
    whole = [{"file_path": f"images/{k}.jpg", "transform_matrix": [[0.5] * 4] * 4} for k in range(20_000)]
    (tmp_path / "a.json").write_text(json.dumps(whole))
    assert read_json(tmp_path / "a.json") == whole
