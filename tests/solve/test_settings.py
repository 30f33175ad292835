"""Settings of a solve: what they accept, and the line for what they do not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from unveil_core.base.errors import SettingsError
from unveil_core.solve.settings import SolveSettings, focal_of


@pytest.mark.parametrize(("text", "wanted"), [("1450", 1450.0), ("1450.5px", 1450.5), ("26mm", 26 / 43.27 * 50)])
def test_focal_lengths(text: str, wanted: float) -> None:
    assert focal_of(text, (40, 30)) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"focal": "wide"}, "Not a focal length: 'wide' .*26mm"),
        ({"focal": "-3"}, "Not a focal length"),
        ({"lens": "zoom"}, "Not a lens: 'zoom' .*simple, opencv, fisheye"),
        ({"every": 0}, "Not a step: --every 0"),
        ({"frames": "a:b"}, "Not a range of frames"),
        ({"camera_height": 0.0}, "Not a value of --camera-height: 0 .*metres"),
        ({"speed": float("nan")}, "Not a value of --speed"),
        ({"speed": 30.0, "camera_height": 1.5}, "Given twice: the scale, by --camera-height and --speed"),
        ({"labels": Path("a"), "segmenter": Path("b.onnx")}, "Given twice: labels, from a folder and from a network"),
    ],
)
def test_what_is_wrong_is_one_line(given: dict[str, Any], line: str) -> None:
    with pytest.raises(SettingsError, match=line):
        SolveSettings(**given)
