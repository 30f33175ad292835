"""A drive that a solve made tells so, and one that is half exchanged is not read."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.base.errors import DriveError
from unveil_core.base.files import write_json_atomic
from unveil_core.base.output.own_folder import EXCHANGE, NEW
from unveil_core.base.output.written import GENERATOR
from unveil_core.drives import open_drive
from unveil_core.drives.checks.solved import SOLVED, is_solved, told_of_solve


def test_what_a_solve_found_is_told_and_what_did_not_end_is_too(tmp_path: Path) -> None:
    drive = Path(make_tiny_drive(tmp_path / "drive"))
    assert not is_solved(drive) and told_of_solve(drive) == ()
    write_json_atomic(drive.parent / SOLVED, {"generator": GENERATOR, "footage": ["a.mp4"], "placed": 8, "frames": 9})
    assert is_solved(drive) and is_solved(drive.parent)
    assert told_of_solve(drive) == ("solved from a.mp4: 8 of 9 frames placed",)
    (drive.parent / NEW).mkdir()
    (drive.parent / NEW / "images").mkdir()
    assert len(told_of_solve(drive)) == 1
    (drive.parent / NEW / "images/0.png").write_bytes(b"")
    assert "a later solve of this drive did not end" in told_of_solve(drive.parent)[1]


def test_a_drive_between_two_solves_is_refused(tmp_path: Path) -> None:
    drive = Path(make_tiny_drive(tmp_path / "drive"))
    open_drive(drive)
    (drive.parent / EXCHANGE).write_text("{}")
    for path in (drive, drive.parent):
        with pytest.raises(DriveError, match="drive: Not whole: a command was ended while it put its files here"):
            open_drive(path)
