"""Forecasts: of real drives, and what is said where there is too little memory or disk."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from tests.drives.tiny_drive import make_tiny_drive
from unveil_core.drives import open_drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.forecast.costs import disk_mb, peak_memory_mb, seconds_of
from unveil_core.forecast.forecast import forecast
from unveil_core.forecast.machine import Machine
from unveil_core.forecast.workload import Workload
from unveil_core.pipeline.graph import STAGES
from unveil_core.pipeline.settings import QUALITIES

WORK = Workload("standard", 200, 2, 3, 280.0, (1920, 1080), 768, 200 * 2.0736, 200 * 0.331776, 4096.0)
NAMES = [stage.name for stage in STAGES]


def test_the_work_of_a_drive_is_counted(tmp_path: Path) -> None:
    drive = localized(open_drive(make_tiny_drive(tmp_path / "drive")))
    width, height = drive.frames[0].camera.width, drive.frames[0].camera.height
    whole = Workload.of_drive(drive, "draft", 512, 1 << 30)
    assert (whole.frames, whole.size, whole.memory_mb) == (len(drive.frames), (width, height), 1024)
    assert whole.given_mpx == whole.working_mpx == pytest.approx(len(drive.frames) * width * height / 1e6)
    half = Workload.of_drive(drive, "draft", max(width, height) // 2, 1 << 30)
    assert half.given_mpx == whole.given_mpx and half.working_mpx == pytest.approx(whole.working_mpx / 4, rel=0.1)
    assert whole.with_side(max(width, height) // 2).working_mpx == pytest.approx(half.working_mpx, rel=0.1)


@pytest.mark.parametrize("quality", QUALITIES)
def test_more_work_takes_more(quality: str) -> None:
    work = replace(WORK, quality=quality)
    for more in (work.with_frames(400), work.with_side(1024)):
        assert sum(seconds_of(more).values()) > 1.1 * sum(seconds_of(work).values())
        assert disk_mb(more) >= disk_mb(work)
    assert peak_memory_mb(work.with_side(1400)) > peak_memory_mb(work)
    little = replace(work, memory_mb=512.0)
    assert peak_memory_mb(little) < peak_memory_mb(work)
    assert peak_memory_mb(little.with_frames(2000)) < 1.15 * peak_memory_mb(little), "frames come from a store"
    assert set(seconds_of(work)) == set(NAMES)


def test_the_line_names_what_there_is_to_do() -> None:
    found = forecast(WORK, NAMES, Machine("", speed=2.0))
    assert sum(found.seconds.values()) == pytest.approx(2 * sum(seconds_of(WORK).values()))
    assert found.line().startswith(
        "200 frames of 2 cameras, 1920x1080, worked on at 768, 280 m of way in 3 blocks: about "
    )
    assert re.search(r"about [\dhmins ]+, [\d.]+ GB of memory and [\d.]+ [GM]B of disk$", found.line())
    assert found.lacking(1e6, 1e6) == []


def test_too_little_memory_is_said_with_what_would_fit() -> None:
    found = forecast(WORK, NAMES, Machine(""))
    (line,) = found.lacking(found.memory_mb - 300, 1e6)
    assert "of memory" in line and "--memory" in line and "--work-side" not in line
    free = peak_memory_mb(replace(WORK, memory_mb=512.0).with_side(500))
    (line,) = found.lacking(free, 1e6)
    side = int(re.findall(r"--work-side (\d+)", line)[0])
    fits = replace(WORK, memory_mb=512.0).with_side(side)
    assert side >= 400 and peak_memory_mb(fits) <= free
    (line,) = found.lacking(1.0, 1e6)
    assert "a machine with more would fit" in line


def test_too_little_disk_is_said_with_what_would_fit() -> None:
    found = forecast(WORK, NAMES, Machine(""))
    (line,) = found.lacking(1e6, found.disk_mb / 2)
    frames = int(re.findall(r"--frames 0:(\d+)", line)[0])
    assert disk_mb(WORK.with_frames(frames * WORK.cameras)) <= found.disk_mb / 2
    assert "another disk" in line
