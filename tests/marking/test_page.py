"""The page of the objects shows names as text."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.base.output.own_folder import OwnFolder
from unveil_core.drives import open_drive
from unveil_core.marking.asked.record import OfFrame, Recorded
from unveil_core.marking.page import PAGE, sheet_name, write_page


def test_names_are_text_without_orders_and_marks_of_direction(tmp_path: Path) -> None:
    thing = Recorded("<script>car</script>\u202e\x1b[2J", "car", 1001, {"front/0\u202e7": OfFrame()})
    (tmp_path / "sheets").mkdir()
    (tmp_path / sheet_name(thing)).touch()
    drive = open_drive(make_tiny_drive(tmp_path / "drive"))
    with OwnFolder(tmp_path) as own:
        write_page(own, [thing], [], drive, lambda _: np.zeros((2, 2, 3), np.uint8))
        page = (own.new / PAGE).read_text(encoding="utf-8")
    assert "&lt;script&gt;car&lt;/script&gt;\\u202e\\x1b[2J" in page and "front/0\\u202e7" in page
    assert "<script>" not in page and "\u202e" not in page and "\x1b" not in page
