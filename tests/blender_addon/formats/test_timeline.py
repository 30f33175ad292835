"""Frames of the timeline: rigs stay in step though pictures are missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blender_addon.formats.drive_files import DriveFrame, ImportedDrive
from blender_addon.formats.timeline import timeline_of


def drive(times: dict[str, list[float | None]], rate: float | None) -> ImportedDrive:
    def frame(name: str, t: float | None) -> DriveFrame:
        return DriveFrame(name, Path(f"{name}.png"), 4, 3, 4, 4, 2, 1.5, np.eye(4), Path(f"{name}.png"), timestamp=t)

    tracks = {track: tuple(frame(f"{i}", t) for i, t in enumerate(own)) for track, own in times.items()}
    return ImportedDrive(Path("ws"), "drive", tracks, np.zeros(3), 1.0, np.eye(3), rate)


def test_a_lost_picture_leaves_a_gap_that_the_one_before_fills() -> None:
    front = [100.0 + 0.1 * i for i in range(6)]
    left = [100.04 + 0.1 * i for i in (0, 1, 3, 4, 5)]
    found = timeline_of(drive({"front": front, "left": left}, 10.0), 1001)
    assert found.frames == {"front": (1001, 1002, 1003, 1004, 1005, 1006), "left": (1001, 1002, 1004, 1005, 1006)}
    assert found.held("left", "abcde") == list("abbcde") and found.end == 1006 and found.rate == 10.0


@pytest.mark.parametrize("times", [[0.0, 1e300, 2e300], [-1.7e308, 0.0, 1.7e308], [0.0, 1e-308, 2e-308]])
@pytest.mark.parametrize("rate", [1e308, 1e-308, 10.0])
def test_numbers_that_are_none_count_pictures(times: list[float], rate: float) -> None:
    assert timeline_of(drive({"front": times}, rate), 1).end == 3


def test_what_a_frame_shows() -> None:
    found = timeline_of(drive({"left": [0.0, 0.1, 0.3]}, 10.0), 1001)
    assert [found.at("left", f) for f in (5, 1001, 1002, 1003, 1004, 2000)] == [0, 0, 1, 1, 2, 2]


def test_a_camera_that_began_later_begins_later() -> None:
    found = timeline_of(drive({"front": [0.0, 0.1, 0.2], "left": [0.2, 0.3]}, 10.0), 0)
    assert found.frames["left"] == (2, 3) and found.first("left") == 2 and found.end == 3


@pytest.mark.parametrize(
    ("times", "rate"),
    [
        ([0.0, 0.1, None], 10.0),  # not all have one
        ([0.0, 0.1, 0.2], None),
        ([0.0, 0.01, 0.02], 10.0),  # two would be one frame
        ([0.0, 0.1, 1e12], 10.0),  # a pause of ages
        ([5.0, 4.0, 3.0], 10.0),
    ],
)
def test_time_stamps_that_do_not_tell_are_left_aside(times: list[float | None], rate: float | None) -> None:
    assert timeline_of(drive({"front": times}, rate), 7).frames == {"front": (7, 8, 9)}


@given(
    st.lists(st.booleans(), min_size=3, max_size=40).filter(any),
    st.floats(1, 120),
    st.floats(-0.3, 0.3),
    st.integers(0, 5000),
)
def test_whatever_is_missing_and_however_exposures_jitter(
    kept: list[bool], rate: float, jitter: float, start: int
) -> None:
    """Each picture that is left has the frame that it would have had."""
    whole = [i for i, keep in enumerate(kept) if keep]
    noise = [jitter * (i % 2) for i in range(len(whole))]
    times = [1.5e9 + (i + e) / rate for i, e in zip(whole, noise, strict=True)]
    found = timeline_of(drive({"a": list(times)}, rate), start)
    expected = tuple(start + i - whole[0] for i in whole)
    few = whole[-1] - whole[0] >= 10 * len(whole)
    assert found.frames["a"] == (tuple(range(start, start + len(whole))) if few else expected)
    assert found.held("a", whole) == sorted(found.held("a", whole)) and len(found.held("a", whole)) == (
        found.end - found.first("a") + 1
    )
