"""Which part of a drive is read: cameras, ranges of frames over a rig with gaps, the order of time, and sweeps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from unveil_core.base.drive_options import DriveOptions, frame_range
from unveil_core.base.errors import SettingsError
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import Drive, Frame, PointCloud, Sweep, SweepPoints
from unveil_core.drives.selecting import select_part
from unveil_core.drives.travel.order import in_order_of_time
from unveil_core.geometry.camera import Camera

CAMERA = Camera(4, 3, 4.0, 4.0, 2.0, 1.5, np.eye(4))
BOX = TrackedBox(1, "car", (0.0, 0.0, 0.0), (4.0, 2.0, 1.5), 0.0)


def frame(camera: str, number: int, time: float | None) -> Frame:
    return Frame(f"{number:02d}", camera, CAMERA, Path(f"{camera}/{number:02d}.png"), timestamp=time)


def sweep(time: float | None, *, boxes: bool = False, annotated: bool = True) -> Sweep:
    content = SweepPoints(np.zeros((1, 3)))
    return Sweep(Path("sweep"), lambda: content, time, (BOX,) if boxes else (), annotated)


def drive(frames: list[Frame], sweeps: list[Sweep] | None = None, **more: object) -> Drive:
    return Drive(Path("drive"), tuple(frames), PointCloud(np.zeros((0, 3))), sweeps=tuple(sweeps or ()), **more)  # type: ignore[arg-type]


def rig(times: dict[str, list[float | None]]) -> list[Frame]:
    return [frame(camera, i, t) for camera, stamps in times.items() for i, t in enumerate(stamps)]


def names(found: Drive) -> dict[str, list[str]]:
    cameras = dict.fromkeys(f.camera_name for f in found.frames)
    return {c: [f.name for f in found.frames if f.camera_name == c] for c in cameras}


# ------------------------------------------------------------------------------------------------------------------- cameras


def test_the_front_camera_is_read_unless_others_are_asked_for() -> None:
    whole = drive(rig({"left": [0.0, 1.0], "front": [0.0, 1.0], "back": [0.0, 1.0]}), front_cameras=("front", "none"))
    assert list(names(select_part(whole, DriveOptions()))) == ["front"]
    assert list(names(select_part(whole, DriveOptions(cameras=("back", "left"))))) == ["back", "left"]
    assert list(names(select_part(whole, DriveOptions(cameras=("all",))))) == ["left", "front", "back"]
    unnamed = drive(list(whole.frames))
    assert len(names(select_part(unnamed, DriveOptions()))) == 3


def test_a_camera_that_is_not_there_is_one_line_with_those_that_are() -> None:
    whole = drive(rig({"left": [0.0], "front": [0.0]}))
    with pytest.raises(SettingsError, match=r"no camera rear.*it has left, front"):
        select_part(whole, DriveOptions(cameras=("front", "rear")))


# -------------------------------------------------------------------------------------------------------------------- frames


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("2:5", "234"),
        ("::3", "0369"),
        ("-3:", "789"),
        ("7", "7"),
        ("-1", "9"),
        ("1:8:2", "1357"),
        (":", "0123456789"),
        ("8:,1:3, 5,2:4", "123589"),
    ],
)
def test_a_range_counts_as_in_python(text: str, kept: str) -> None:
    for times in ([0.1 * i for i in range(10)], [None] * 10):
        found = select_part(drive(rig({"camera": times})), DriveOptions(frames=text))  # type: ignore[dict-item]
        assert names(found) == {"camera": [f"0{n}" for n in kept]}, text


@pytest.mark.parametrize("text", ["", "a", "3,", ",3", "1:2,a", "1:2:3:4", "1:b", "::0", "::-1", "1.5", " "])
def test_what_is_no_range_is_one_line(text: str) -> None:
    with pytest.raises(SettingsError, match="Not a range of frames.*A:B:STEP"):
        frame_range(text)


def test_a_range_without_frames_is_one_line() -> None:
    with pytest.raises(SettingsError, match="no frame lies in 20:30.*has 10 frames"):
        select_part(drive(rig({"camera": [0.1 * i for i in range(10)]})), DriveOptions(frames="20:30"))


def test_cameras_of_a_rig_give_the_same_times_whatever_is_missing() -> None:
    """The left camera lost its first four frames, and is 30 ms late: numbers would give it other moments than the front."""
    front = [0.1 * i for i in range(10)]
    left = [0.1 * i + 0.03 for i in range(4, 10)]
    whole = drive(rig({"left": left, "front": front}))  # type: ignore[dict-item]
    found = select_part(whole, DriveOptions(cameras=("front", "left"), frames="3:9:2"))
    times = {c: [round(f.timestamp, 2) for f in found.frames if f.camera_name == c] for c in ("front", "left")}  # type: ignore[arg-type]
    assert times == {"front": [0.3, 0.5, 0.7], "left": [0.53, 0.73]}


def test_without_time_stamps_each_camera_counts_for_itself() -> None:
    whole = drive(rig({"left": [None] * 3, "front": [None] * 5}))
    assert names(select_part(whole, DriveOptions(frames="1:4"))) == {"left": ["01", "02"], "front": ["01", "02", "03"]}


def test_frames_come_in_the_order_of_time_with_a_notice() -> None:
    mixed = drive(rig({"left": [0.0, 0.2, 0.1], "front": [0.0, 0.1, 0.2]}), notices=("before",))
    found = in_order_of_time(mixed)
    assert names(found) == {"left": ["00", "02", "01"], "front": ["00", "01", "02"]}
    assert found.notices[0] == "before" and "camera left" in found.notices[1] and len(found.notices) == 2


def test_the_order_of_the_files_stays_where_a_time_stamp_is_missing_or_occurs_twice() -> None:
    for stamps in ([0.2, None, 0.1], [0.1, 0.1, 0.1]):
        found = in_order_of_time(drive(rig({"camera": stamps})))
        assert names(found) == {"camera": ["00", "01", "02"]} and found.notices == ()


def test_cameras_in_turns_become_tracks() -> None:
    turns = [frame(c, i, 0.1 * i) for i in range(3) for c in ("left", "front")]
    assert [f.camera_name for f in in_order_of_time(drive(turns)).frames] == ["left"] * 3 + ["front"] * 3


# -------------------------------------------------------------------------------------------------------------------- sweeps


def stamps_of(found: Drive) -> list[float | None]:
    return [s.timestamp for s in found.sweeps]


def test_sweeps_are_thinned() -> None:
    whole = drive(rig({"camera": [0.0]}), [sweep(float(i)) for i in range(7)])
    assert stamps_of(select_part(whole, DriveOptions())) == [0, 1, 2, 3, 4, 5, 6]
    assert stamps_of(select_part(whole, DriveOptions(sweeps="3"))) == [0, 3, 6]
    for wrong in ("0", "-1", "many", "1.5"):
        with pytest.raises(SettingsError, match="Not a choice of sweeps.*all, key, or a number"):
            select_part(whole, DriveOptions(sweeps=wrong))


def test_key_sweeps_are_those_of_annotated_moments() -> None:
    def key(sweeps: list[Sweep], **more: object) -> Drive:
        return select_part(drive(rig({"camera": [0.0, 0.1, 0.2]}), sweeps, **more), DriveOptions(sweeps="key"))

    between = [sweep(0.0, boxes=True), sweep(0.1, boxes=True, annotated=False), sweep(0.2, annotated=True)]
    assert stamps_of(key(between)) == [0.0, 0.2]
    assert stamps_of(key([sweep(0.0), sweep(0.1, boxes=True), sweep(0.2)])) == [0.1]
    assert stamps_of(key([sweep(0.0), sweep(0.1)])) == [0.0, 0.1]  # nothing says which
    only = key(between, key_frames=frozenset({"00", "02"}))
    assert names(only) == {"camera": ["00", "02"]}
    assert names(key(between)) == {"camera": ["00", "01", "02"]}


def test_only_sweeps_of_the_time_of_the_frames_are_read() -> None:
    sweeps = [sweep(float(i)) for i in range(12)]
    whole = drive(rig({"camera": [0.5 * i for i in range(20)]}), sweeps)
    assert stamps_of(select_part(whole, DriveOptions(frames="8:13"))) == [3, 4, 5, 6, 7]
    assert len(select_part(whole, DriveOptions()).sweeps) == 12
    unknown = drive(list(whole.frames), [*sweeps, sweep(None)])
    assert len(select_part(unknown, DriveOptions(frames="8:13")).sweeps) == 13
