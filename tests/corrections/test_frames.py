"""Which frames corrections are of: by name, or by the number in it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.inpaint.walls import before_wall
from unveil_core.base.errors import SettingsError
from unveil_core.corrections.files import Correction
from unveil_core.corrections.frames import corrected_frames
from unveil_core.drives.drive import Frame

FRAMES = [Frame(f"{n:04d}", c, before_wall(0, 5), Path("a.png")) for c in ("left", "right") for n in (4, 5, 16)]


@pytest.mark.parametrize(("camera", "name", "index"), [("left", "0005", 1), ("right", "5", 4), ("right", "00016", 5)])
def test_a_frame_is_named_by_its_name_or_number(camera: str, name: str, index: int) -> None:
    assert corrected_frames([Correction(camera, name, Path("c.png"))], FRAMES) == [index]


@pytest.mark.parametrize(
    ("camera", "name"), [("left", "6"), ("rear", "5"), ("left", "five"), ("left", "-5"), ("left", "9" * 40)]
)
def test_what_there_is_not_is_told(camera: str, name: str) -> None:
    with pytest.raises(SettingsError, match=f"c.png: the drive has no frame {name} of camera {camera}"):
        corrected_frames([Correction(camera, name, Path("c.png"))], FRAMES)
