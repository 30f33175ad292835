"""The PNG sequence: numbers, and every bit of the delivered frames."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from tests.exports.conftest import Street
from unveil_core.app.cli import main


def test_plates_are_the_delivered_frames_bit_for_bit(street: Street) -> None:
    folder = street.exported("png")
    names = sorted(p.name for p in (folder / "front").iterdir())
    assert names == ["front.1001.png", "front.1002.png", "front.1003.png"]
    told = json.loads((folder / "export.json").read_text())
    assert told["colorspace"] == "srgb_rec709_display"
    for name in names:
        source = told["cameras"]["front"][name.split(".")[1]]["source"]
        plate = cv2.imread(str(folder / "front" / name), cv2.IMREAD_UNCHANGED)
        delivered = cv2.imread(str(street.root / f"frames/front/{source}.png"), cv2.IMREAD_UNCHANGED)
        assert plate.dtype == np.uint16
        np.testing.assert_array_equal(plate, delivered)
    plate = folder / "front/front.1001.png"
    assert not plate.samefile(street.root / "frames/front/0000.png")  # to paint on


def test_numbers_start_where_asked_and_keep_one_width(street: Street, tmp_path: Path) -> None:
    assert main(["export", str(street.root), "--to", "png", "--start-frame", "9999", "-o", str(tmp_path)]) == 0
    names = sorted(p.name for p in (tmp_path / "png/front").iterdir())
    assert names == ["front.09999.png", "front.10000.png", "front.10001.png"]
