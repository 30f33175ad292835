"""Keyframes by name, and in what order the frames of a rig were taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.inpaint.walls import before_wall
from unveil_core.base.errors import SettingsError
from unveil_core.drives.drive import Frame, instants
from unveil_core.drives.selecting import named_frames


def frame(name: str, camera: str = "front", timestamp: float | None = None) -> Frame:
    return Frame(name, camera, before_wall(0, 5), Path(f"{name}.png"), timestamp=timestamp)


RIG = [frame(f"{n:04d}", c) for c in ("left", "right") for n in (4, 5, 6)]


def test_frames_are_ordered_by_time_or_by_their_place_in_the_track() -> None:
    assert instants(RIG).tolist() == [0, 1, 2, 0, 1, 2]
    timed = [frame("a", "left", 0.1), frame("b", "left", 0.3), frame("c", "right", 0.2)]
    assert instants(timed).tolist() == [0.1, 0.3, 0.2]
    assert instants([*timed, frame("d", "right")]).tolist() == [0, 1, 0, 1]


def test_a_camera_with_fewer_frames_is_in_step_by_their_numbers() -> None:
    front, rare = [frame(f"{n:03d}") for n in range(3, 8)], [frame(f"{n:03d}", "left") for n in (3, 7)]
    assert instants([*front, *rare]).tolist() == [0, 1, 2, 3, 4, 0, 4]
    # Numbers that go on from camera to camera, or fall, are no times; nor is a name beside them.
    later = [frame(f"{n:03d}", "left") for n in (8, 9)]
    assert instants([*front, *later]).tolist() == [0, 1, 2, 3, 4, 0, 1]
    assert instants([*front[::-1], *rare]).tolist() == [0, 1, 2, 3, 4, 0, 1]
    assert instants([*front, frame("a", "left")]).tolist() == [0, 1, 2, 3, 4, 0]


@pytest.mark.parametrize(
    ("names", "indices"),
    [
        (("0005",), (1, 4)),
        (("5",), (1, 4)),
        (("right/0005",), (4,)),
        (("6", "4"), (2, 5, 0, 3)),
        (("5", "0005", "left/0005"), (1, 4)),
        ((), ()),
    ],
)
def test_a_keyframe_is_named_by_stem_or_number(names: tuple[str, ...], indices: tuple[int, ...]) -> None:
    assert named_frames(RIG, names) == indices


def test_without_numbers_in_the_stems_the_place_in_the_track_counts() -> None:
    frames = [frame("first"), frame("second"), frame("left-3", "left"), frame("left-4", "left")]
    assert named_frames(frames, ("1",)) == (1, 3)
    assert named_frames(frames, ("left-3",)) == (2,)


def test_a_number_in_a_name_is_that_of_the_frame(tmp_path: Path) -> None:
    frames = [frame(f"shot2_frame{n}", c) for c in ("left", "right") for n in (8, 9, 10)]
    assert named_frames(frames, ("9",)) == (1, 4)
    assert named_frames(frames, ("0",)) == (0, 3)  # there is no frame 0: the first one
    assert instants(frames).tolist() == [0, 1, 2, 0, 1, 2]
    rare = [frame(f"right_{n}", "right") for n in (8, 10)]
    assert instants([*frames[:3], *rare]).tolist() == [0, 1, 2, 0, 2]


@pytest.mark.parametrize("name", ["7", "0007", "-1", "five", "front/0005", "9" * 30, "٣"])
def test_what_there_is_not_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(SettingsError) as refused:
        named_frames(RIG, ("4", name))
    line = str(refused.value)
    assert repr(name) in line and "4 to 6" in line and "\n" not in line


def test_an_empty_drive_has_no_instants() -> None:
    assert instants([]).tolist() == [] and named_frames([], ()) == () and np.shape(instants([])) == (0,)
