"""A file of strokes says what can be drawn, or is refused in a line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from unveil_core.base.errors import SettingsError
from unveil_core.drives.drive import Footage, Frame
from unveil_core.geometry.camera import Camera
from unveil_core.marking.asked.said import line_drawn, of_file


def strokes(folder: Path, text: str) -> Path:
    path = folder / "strokes.json"
    path.write_text(text)
    return path


def stroke(**more: Any) -> str:
    return json.dumps([{"object": "car", "frame": "0007", "stroke": [[10, 10], [20, 20]], **more}])


@pytest.mark.parametrize(
    "text",
    [
        stroke(width=float("nan")),
        stroke(width=float("inf")),
        stroke(width=-5),
        stroke(width=10**400),
        stroke(width=[3]),
        stroke(inside=[[10**400, 10]]),
        stroke(stroke=[[1e300, -1e300], [20, 20]], of="camera"),
        stroke(object={"a": 1}),
        stroke(object=["car"]),
        stroke(object="car" * 100),
    ],
)
def test_what_cannot_be_drawn_or_named_is_one_line(text: str, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"strokes\.json: Not a file of strokes: .*a list of") as told:
        of_file(strokes(tmp_path, text))
    assert "\n" not in str(told.value)


def test_a_stroke_is_no_wider_than_the_picture(tmp_path: Path) -> None:
    camera = Camera(64, 48, 50.0, 50.0, 32.0, 24.0, np.eye(4))
    frame = Frame("0007", "front", camera, tmp_path / "7.png", footage=Footage(tmp_path / "7.png", camera))
    for given, whole in ((1e308, True), (40_000, True), (6, False), (0, False)):
        (thing,) = of_file(strokes(tmp_path, stroke(width=given)))
        width, places = thing.said[0].value
        mask = line_drawn(width, places, frame)
        assert mask.shape == (48, 64) and mask.any() and bool(mask.mean() > 0.5) == whole
