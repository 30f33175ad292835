"""Time stamps of any unit become seconds, and a notice says so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.drives.captures import FOCAL, frame, frames, write_transforms
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep, SweepPoints, frames_per_second
from unveil_core.drives.travel.stamps import in_seconds, stamp_of, unit_of
from unveil_core.geometry.camera import Camera

NAMES = [f"images/{i:03d}.png" for i in range(8)]


@pytest.mark.parametrize(
    ("stamps", "unit"),
    [
        ([0, 0.1, 0.2], "seconds"),
        ([0, 1, 2], "seconds"),
        ([1700000000.0, 1700000000.1, 1700000000.2], "seconds"),
        ([0, 33, 67, 100], "milliseconds"),
        ([0, 300, 600], "milliseconds"),
        ([1700000000000, 1700000000300, 1700000000600], "milliseconds"),
        ([5123456789, 5123556789, 5123656789], "microseconds"),
        ([1700000000000000, 1700000000033333, 1700000000066666], "microseconds"),
        # Since boot, a month ago: as milliseconds it would be a date.
        ([1.7e12, 1.7e12 + 1e5, 1.7e12 + 2e5], "microseconds"),
        ([1.7e18, 1.7e18 + 3e8, 1.7e18 + 6e8], "nanoseconds"),
        ([90e9, 90.1e9, 90.2e9], "nanoseconds"),
        ([1.7e12] * 3, "milliseconds"),
        ([1.7e18], "nanoseconds"),
        ([], "seconds"),
    ],
)
def test_units_follow_from_steps_and_dates(stamps: list[float], unit: str) -> None:
    found = unit_of([stamps])
    assert found is not None and found.name == unit


def test_missing_frames_and_jitter_do_not_mislead() -> None:
    generator = np.random.default_rng(0)
    stamps = np.cumsum(generator.uniform(28, 40, 60))
    stamps[30:] += 4000  # of a stop
    found = unit_of([stamps.tolist()])
    assert found is not None and found.name == "milliseconds"


def test_how_fast_the_vehicle_is_decides_where_steps_fit_two_units() -> None:
    every_half_minute = [[0.0, 30.0, 60.0]]
    assert unit_of(every_half_minute, 15.0).name == "seconds"  # type: ignore[union-attr]
    assert unit_of(every_half_minute, 0.5).name == "milliseconds"  # type: ignore[union-attr]
    of_120_hertz = [[0.0, 8.33, 16.67]]
    assert unit_of(of_120_hertz, 0.1).name == "milliseconds"  # type: ignore[union-attr]
    assert unit_of(of_120_hertz, 9.0).name == "seconds"  # type: ignore[union-attr]


def test_steps_of_no_camera_are_told_and_left() -> None:
    assert unit_of([[0.0, 5e12, 1e13]]) is None


@pytest.mark.parametrize(
    ("value", "seconds"),
    [
        (0.3, 0.3),
        ("0.3", 0.3),
        (7, 7.0),
        ("2023-11-14T22:13:20.300Z", 1700000000.3),
        ("2023-11-14T23:13:20.300000000+01:00", 1700000000.3),
        ("2023:11:14 22:13:20.5", 1700000000.5),
        ("00:01:02.5", 62.5),
        ({"secs": 3, "nsecs": 500000000}, 3.5),
        ({"sec": 3, "nanosec": 0}, 3.0),
        (True, None),
        ("x", None),
        (float("nan"), None),
        ([1], None),
        ({"nsecs": 1}, None),
        ("2023-13-45", None),
        (10**400, None),
    ],
)
def test_what_a_time_stamp_may_be(value: object, seconds: float | None) -> None:
    assert stamp_of(value) == (None if seconds is None else pytest.approx(seconds, abs=1e-6))


@pytest.mark.parametrize(
    ("key", "stamps", "unit"),
    [
        ("timestamp", [100 * i for i in range(8)], "milliseconds"),
        ("time", [40 * i for i in range(8)], "milliseconds"),
        ("timestamp", [str(1700000000000000000 + 100000000 * i) for i in range(8)], "nanoseconds"),
        ("timestamp", [123456789 + 33333 * i for i in range(8)], "microseconds"),
        ("timestamp", [f"2026-01-31T12:00:00.{i}" for i in range(8)], None),
        ("timestamp", [0.1 * i for i in range(8)], None),
    ],
)
def test_a_drive_has_seconds_whatever_its_file_has(
    key: str, stamps: list[object], unit: str | None, tmp_path: Path
) -> None:
    drive = open_drive(write_transforms(tmp_path, frames(NAMES, **{key: stamps})))
    steps = np.diff([f.timestamp for f in drive.frames])  # type: ignore[arg-type]
    assert steps.min() > 0.03 and steps.max() < 0.11
    assert frames_per_second(drive.frames) == pytest.approx(1 / float(np.median(steps)), rel=1e-3)
    assert [n for n in drive.notices if "converted" in n] == [n for n in drive.notices if unit is not None]
    assert unit is None or f"count as {unit} and are converted" in drive.notices[0]


def test_a_share_of_the_drive_is_no_time(tmp_path: Path) -> None:
    """Of 29 frames 7 m apart it would be 200 m/s."""
    entries = [frame(f"images/{i:03d}.png", 7.0 * i, time=i / 28) for i in range(29)]
    drive = open_drive(write_transforms(tmp_path, entries[::-1]))
    assert [f.name for f in drive.frames] == [f"{i:03d}" for i in range(29)]
    assert {f.timestamp for f in drive.frames} == {None} and "a share of the drive" in drive.notices[0]


def test_words_are_no_time(tmp_path: Path) -> None:
    path = write_transforms(tmp_path, frames(NAMES, timestamp=["noon"] * 8))
    with pytest.raises(DriveError, match="Not a number: timestamp of frame 000: 'noon' .give seconds, or a date"):
        open_drive(path)


def test_sweeps_are_converted_by_their_own_steps() -> None:
    camera = Camera(4, 3, FOCAL, FOCAL, 2.0, 1.5, np.eye(4))
    own = tuple(Frame(f"{i}", "c", camera, Path(f"{i}.png"), timestamp=0.1 * i) for i in range(4))
    content = SweepPoints(np.zeros((1, 3)))
    sweeps = tuple(Sweep(Path("s"), lambda: content, 1e5 * i) for i in range(4))
    drive = in_seconds(Drive(Path("d"), own, PointCloud(np.zeros((0, 3))), sweeps=sweeps))
    assert [s.timestamp for s in drive.sweeps] == pytest.approx([0, 0.1, 0.2, 0.3])
    assert [f.timestamp for f in drive.frames] == pytest.approx([0, 0.1, 0.2, 0.3])
    assert drive.notices == (
        "time stamps of LiDAR sweeps count as microseconds and are converted: their steps would be 100,000 s",
    )
