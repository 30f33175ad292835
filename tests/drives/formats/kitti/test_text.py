"""Text files of KITTI: dates with nanoseconds, calibrations with other lines between, and numbers beside each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.drives.formats.kitti.files import rigid, rotation
from unveil_core.base.errors import DriveError
from unveil_core.drives.formats.kitti.text import neighbours, numbered, read_calibration, read_stamps
from unveil_core.geometry.transforms import rigid_inverse


def test_dates_keep_what_is_shorter_than_a_microsecond(tmp_path: Path) -> None:
    path = tmp_path / "timestamps.txt"
    path.write_text("2011-09-26 13:02:25.594360375\n\n2011-09-26 13:02:26\n2011-09-26 13:03:25.594360875")
    first, none, whole, last = read_stamps(path)
    assert none is None and first is not None and whole is not None and last is not None
    assert last - first == pytest.approx(60.0000005, abs=3e-7) and whole - first == pytest.approx(0.405639625, abs=3e-7)
    path.write_text("2011-09-26 13:02:25.59x\n")
    with pytest.raises(DriveError, match="Not a time stamp: line 1"):
        read_stamps(path)
    assert read_stamps(tmp_path / "none.txt") == []


def test_calibrations_leave_out_what_is_not_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    path.write_text("calib_time: 09-Jan-2012 13:57:47\nR:1 2\n T : 3 4 5")
    assert read_calibration(path, {"T": 3}, "")["T"].tolist() == [3, 4, 5]
    with pytest.raises(DriveError, match="Not 9 finite numbers: R .again"):
        read_calibration(path, {"R": 9}, "again")
    with pytest.raises(DriveError, match="Not numbers: calib_time"):
        read_calibration(path, {"calib_time": 2}, "")
    path.write_bytes(b"\xff\xfe\x00R: 1")
    with pytest.raises(DriveError, match="Not UTF-8 text"):
        read_calibration(path, {"R": 1}, "")


def test_files_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for name in ("10.png", "2.png", "0003.JPG", "4.txt", "x5.png", "٣.png", ".png"):
        (tmp_path / name).touch()
    assert list(numbered(tmp_path, (".png", ".jpg"))) == [2, 3, 10]
    assert numbered(tmp_path / "none", (".png",)) == {}


def test_neighbours_within_reach() -> None:
    assert neighbours(5, [1, 4, 5, 7, 30], 3) == (4, 7)
    assert neighbours(7, [1, 4, 5, 7, 30], 3) == (5, None)
    assert neighbours(1, [1, 4, 5, 7, 30], 2) == (None, None)


def test_inverse_undoes_a_pose() -> None:
    pose = rigid(rotation(0.3, -1.2, 2.0), (4e5, -5e6, 100))
    assert np.abs(rigid_inverse(pose) @ pose - np.eye(4)).max() < 1e-8
