"""KITTI raw: a tiny drive in the released encoding, and what may be wrong with one."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.drives.formats.kitti.files import (
    apply,
    numbers,
    projected,
    rigid,
    rotation,
    seen_at,
    write_picture,
    write_sweep,
    write_text,
)
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Sweep
from unveil_core.drives.selecting import DriveOptions

DAY, NAME = "2011_09_26", "2011_09_26_drive_0001_sync"
AXES = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
CAM0_FROM_VELO = rigid(rotation(0.01, -0.02, 0.015) @ AXES, (-0.004, -0.076, -0.272))
VELO_FROM_IMU = rigid(rotation(0.002, 0.001, -0.003), (-0.81, 0.32, -0.80))
RECTIFY = rotation(0.004, -0.01, 0.007)
P0 = np.array([[72.1, 0, 30.9, 0], [0, 72.1, 8.6, 0], [0, 0, 1, 0]])
P2 = np.array([[72.1, 0, 30.9, 4.485728], [0, 72.1, 8.6, 0.2163791], [0, 0, 1, 0.002745884]])
P3 = np.array([[72.1, 0, 30.9, -33.95242], [0, 72.1, 8.6, 2.199936], [0, 0, 1, 0.002729905]])
LATITUDE, LONGITUDE = 49.011, 8.416
RADIUS = 6378137.0
SPEED, YAW_RATE = 12.0, 0.15
"""Of the vehicle, m/s along its heading and rad/s."""


def vehicle(time: float) -> np.ndarray:
    """Pose of the IMU, level, from the first frame's position: a constant speed and turn."""
    heading = 0.4 + YAW_RATE * time
    radius = SPEED / YAW_RATE
    position = radius * (np.sin([heading, 0.4 + math.pi / 2]) - np.sin([0.4, heading + math.pi / 2]))
    return rigid(rotation(z=heading), (*position, 0.0))


def stamp(seconds: float) -> str:
    return f"2011-09-26 13:02:{25 + seconds:012.9f}"


def write_drive(root: Path, frames: int = 4, compensated: bool = False) -> Path:
    """A drive along an arc; each sweep sees the points of ``wall`` while it moves."""
    day, drive = root / DAY, root / DAY / NAME
    cam = "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.95e-02\n"
    for k, matrix in (("00", P0), ("01", P3), ("02", P2), ("03", P3)):
        # The rotations of other cameras are there and must not be used.
        turn = RECTIFY if k == "00" else rotation(0.3, 0.2, 0.1)
        cam += f"S_{k}: 62 18\nD_{k}: {numbers([-0.37, 0.2, 0, 0, -0.07])}\nR_rect_{k}: {numbers(turn)}\n"
        cam += f"P_rect_{k}: {numbers(matrix)}\n"
    write_text(day / "calib_cam_to_cam.txt", cam)
    for name, pose in (("velo_to_cam", CAM0_FROM_VELO), ("imu_to_velo", VELO_FROM_IMU)):
        text = f"calib_time: 15-Mar-2012 11:37:16\nR: {numbers(pose[:3, :3])}\nT: {numbers(pose[:3, 3])}\n"
        write_text(day / f"calib_{name}.txt", text + "delta_f: 0 0\ndelta_c: 0 0\n" * (name == "velo_to_cam"))
    scale = math.cos(math.radians(LATITUDE))
    lines = {n: "" for n in ("", "_start", "_end")}
    for i in range(frames):
        time = 0.1 * i
        pose = vehicle(time)
        east, north = pose[:2, 3]
        longitude = LONGITUDE + math.degrees(east / (scale * RADIUS))
        mercator = math.log(math.tan(math.pi / 4 + math.radians(LATITUDE) / 2)) + north / (scale * RADIUS)
        latitude = math.degrees(2 * math.atan(math.exp(mercator)) - math.pi / 2)
        values = [latitude, longitude, 112.8, 0.0, 0.0, math.atan2(pose[1, 0], pose[0, 0]), *[0.0] * 19, 4, 11, 4, 4, 0]
        packet = " ".join(f"{v:.14g}" if k > 1 else f"{v:.17g}" for k, v in enumerate(values))
        write_text(drive / f"oxts/data/{i:010d}.txt", packet + "\n" * (i % 2))
        for camera in ("image_00", "image_02", "image_03"):
            write_picture(drive / camera / "data" / f"{i:010d}.png")
        write_sweep(drive / f"velodyne_points/data/{i:010d}.bin", measured(time))
        for ending, shift in (("", 0.0), ("_start", -0.05), ("_end", 0.05)):
            lines[ending] += stamp(time + shift) + "\n"
    for folder in ("image_00", "image_02", "image_03", "oxts", "velodyne_points"):
        write_text(drive / folder / "timestamps.txt", lines[""].rstrip("\n"))
    for ending in ("_start", "_end"):
        write_text(drive / f"velodyne_points/timestamps{ending}.txt", lines[ending])
    return drive


def wall() -> np.ndarray:
    """(P, 3) points that stand still around the street, world."""
    angle = np.linspace(0, 2 * math.pi, 73)[:-1] + 0.01
    reach = 15 + 5 * np.sin(3 * angle)
    return np.stack([3 + reach * np.cos(angle), 2 + reach * np.sin(angle), np.sin(7 * angle)], axis=1)


def scanner(time: float) -> np.ndarray:
    return vehicle(time) @ np.linalg.inv(VELO_FROM_IMU)


def measured(time: float) -> np.ndarray:
    """The wall as the scanner sees it, each point at the moment when it looks there: clockwise, ahead at ``time``."""
    found = []
    for point in wall():
        when = time
        for _ in range(20):
            x, y, z = apply(np.linalg.inv(scanner(when)), point[None])[0]
            when = time - 0.1 * math.atan2(y, x) / (2 * math.pi)
        found.append((x, y, z))
    return np.array(found)


def bent(sweep: Sweep) -> float:
    """How far a sweep is from the wall at most, metres, but right behind, where it is not known which end of the turn saw it."""
    seen = measured(0.1 * int(sweep.path.stem))
    known = np.abs(np.arctan2(seen[:, 1], seen[:, 0])) < 3.0
    return float(np.linalg.norm((sweep.read().positions - wall())[known], axis=1).max())


def test_cameras_see_points_where_the_calibration_says(tmp_path: Path) -> None:
    drive = open_drive(write_drive(tmp_path), DriveOptions(cameras=("all",)))
    assert {f.camera_name for f in drive.frames} == {"image_00", "image_02", "image_03"}
    assert drive.front_cameras == ("image_02",) and not drive.notices
    generator = np.random.default_rng(0)
    in_velo = generator.uniform((6, -4, -2), (30, 4, 2), (40, 3))
    for frame in drive.frames:
        i = int(frame.name)
        world = apply(vehicle(0.1 * i), apply(np.linalg.inv(VELO_FROM_IMU), in_velo))
        rectified = apply(CAM0_FROM_VELO, in_velo) @ RECTIFY.T
        matrix = {"image_00": P0, "image_02": P2, "image_03": P3}[frame.camera_name]
        assert np.abs(seen_at(frame, world) - projected(matrix, rectified)).max() < 0.01
        assert (frame.camera.width, frame.camera.height) == (62, 18)
    stamps = [f.timestamp for f in drive.frames if f.camera_name == "image_02"]
    assert np.diff(stamps) == pytest.approx(0.1, abs=1e-6)


def test_a_still_wall_stands_still_though_the_vehicle_moves(tmp_path: Path) -> None:
    drive = open_drive(write_drive(tmp_path))
    raw = apply(scanner(0.1), measured(0.1))
    assert np.linalg.norm(raw - wall(), axis=1).max() > 0.4  # without compensation
    for sweep in drive.sweeps:
        assert bent(sweep) < 0.01
    (drive.root / "oxts/timestamps.txt").unlink()
    (drive.root / "velodyne_points/timestamps_start.txt").unlink()
    for sweep in open_drive(drive.root).sweeps:  # as well by the nominal time of a turn
        assert bent(sweep) < 0.01


def test_the_day_holds_drives_by_name(tmp_path: Path) -> None:
    write_drive(tmp_path)
    assert len(open_drive(tmp_path / DAY).frames) == 4
    assert len(open_drive(tmp_path, DriveOptions(scene=f"{DAY}/{NAME}")).frames) == 4
    (tmp_path / DAY / NAME).rename(tmp_path / DAY / NAME.replace("sync", "extract"))
    with pytest.raises(DriveError, match="ends in _sync"):
        open_drive(tmp_path)


def tracklets(poses: str, kind: str = "Van", extra: str = "") -> str:
    item = f"<item class_id='1'><objectType>{kind}</objectType><h>2</h><w>1.8</w><l>4.5</l><first_frame>1</first_frame>"
    item += f"<poses class_id='2'><count>2</count><item_version>2</item_version>{poses}</poses><finished>1</finished></item>"
    misc = item.replace(kind, "Misc")
    head = "<?xml version='1.0' encoding='UTF-8' standalone='yes' ?>\n"
    doctype = "<!DOCTYPE boost_serialization>\n"
    return (
        f"{head}{extra or doctype}<boost_serialization signature='serialization::archive' version='9'><tracklets class_id='0'>"
        f"<count>2</count><item_version>1</item_version>{misc}{item}</tracklets></boost_serialization>\n"
    )


def pose_item(x: float, yaw: float) -> str:
    return f"<item><tx>{x}</tx><ty>2</ty><tz>-1.7</tz><rx>0</rx><ry>0</ry><rz>{yaw}</rz><state>2</state></item>"


def test_tracklets_are_boxes_in_the_world(tmp_path: Path) -> None:
    drive = write_drive(tmp_path)
    write_text(drive / "tracklet_labels.xml", tracklets(pose_item(10, 0.3) + pose_item(11, 0.3)))
    frames = open_drive(drive).frames
    assert [len(f.boxes) for f in frames] == [0, 1, 1, 0]
    (box,) = frames[2].boxes
    assert (box.id, box.class_name, box.size) == (2, "car", (4.5, 1.8, 2.0))
    corners = np.array([[10, 2, -0.7]]) + np.array([[1, 0, 0]])
    assert box.centre == pytest.approx(tuple(apply(scanner(0.2), corners)[0]), abs=1e-6)
    assert box.yaw == pytest.approx(0.4 + YAW_RATE * 0.2 + 0.3 + 0.003, abs=1e-3)
    assert open_drive(drive).sweeps[2].boxes == frames[2].boxes


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (tracklets("", extra='<!DOCTYPE a [<!ENTITY b "bb"><!ENTITY c "&b;&b;">]>'), "entities in its document type"),
        (
            tracklets("", extra='<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/passwd">]>'),
            "entities in its document type",
        ),
        (tracklets("", extra='<!DOCTYPE a [<!ENTITY % b SYSTEM "b.dtd"> %b;]>'), "entities in its document type"),
        (tracklets("", extra='<!DOCTYPE a SYSTEM "file:///etc/passwd">'), "another file as its document type"),
        (tracklets("", extra='<!DOCTYPE a PUBLIC "b" "http://c/d.dtd">'), "another file as its document type"),
        (tracklets("", extra='<!DOCTYPE a [<!ATTLIST item b CDATA "ccc">]>'), "values in its document type"),
        (tracklets("<item>&b;</item>"), "Not complete XML: undefined entity"),
        (tracklets("<item>" * 40 + "</item>" * 40), "within one another"),
        (tracklets(pose_item(1, 0))[:-60], "Not complete XML"),
        (tracklets("<item><tx>1</tx></item>"), "object 1: lacks ty"),
        (tracklets(pose_item(1, 0)).replace("<h>2</h>", "<h>two</h>"), "object 1: could not convert"),
        ("", "Not complete XML"),
    ],
)
def test_hostile_and_damaged_tracklets_say_so(tmp_path: Path, text: str, said: str) -> None:
    drive = write_drive(tmp_path, 2)
    write_text(drive / "tracklet_labels.xml", text)
    with pytest.raises(DriveError, match=said):
        open_drive(drive)


def test_gaps_are_borne(tmp_path: Path) -> None:
    drive = write_drive(tmp_path, 6)
    (drive / "velodyne_points/data/0000000002.bin").unlink()
    (drive / "image_02/data/0000000001.png").unlink()
    packet = (drive / "oxts/data/0000000004.txt").read_text().split()
    write_text(drive / "oxts/data/0000000004.txt", " ".join(["nan", *packet[1:]]))
    stamps = (drive / "image_02/timestamps.txt").read_text().splitlines()
    write_text(drive / "velodyne_points/timestamps.txt", "\n".join(["", *stamps[1:3]]))
    found = open_drive(drive)
    assert [int(f.name) for f in found.frames] == [0, 2, 3, 5]
    assert [s.path.stem[-1] for s in found.sweeps] == ["0", "1", "3", "5"]
    assert [s.timestamp is None for s in found.sweeps] == [True, False, True, True]
    said = ["oxts", "image_02", "image_03", "image_00", "velodyne_points", "velodyne_points"]
    assert [n.split(":")[0] for n in found.notices] == said
    assert "sweeps have no pose and are left out" in found.notices[-1]
    for sweep in found.sweeps:
        assert bent(sweep) < 0.02


def test_time_stamps_that_do_not_ascend_do_not_bend_sweeps(tmp_path: Path) -> None:
    drive = write_drive(tmp_path)
    write_text(drive / "oxts/timestamps.txt", "\n".join(stamp(t) for t in (0.0, 0.3, 0.1, 0.1)))
    write_text(drive / "velodyne_points/timestamps_start.txt", "\n".join(stamp(t) for t in (9.0, 0.0, 0.0, 0.3)))
    for sweep in open_drive(drive).sweeps:
        assert bent(sweep) < 0.01


def test_damaged_files_say_so(tmp_path: Path) -> None:
    drive = write_drive(tmp_path, 2)
    sweep = drive / "velodyne_points/data/0000000001.bin"
    sweep.write_bytes(sweep.read_bytes()[:-3])
    opened = open_drive(drive)
    with pytest.raises(DriveError, match=r"0000000001.bin: Cut short"):
        opened.sweeps[1].read()
    sweep.write_bytes(b"")
    with pytest.raises(DriveError, match="Empty"):
        opened.sweeps[1].read()
    write_text(drive / "image_02/timestamps.txt", "noon\n")
    with pytest.raises(DriveError, match="Not a time stamp: line 1"):
        open_drive(drive)
    (drive / "image_02/timestamps.txt").unlink()
    assert open_drive(drive).frames[0].timestamp is None
    calibration = tmp_path / DAY / "calib_cam_to_cam.txt"
    whole = calibration.read_text()
    calibration.write_text(whole.replace("P_rect_02", "P_rect_12"))
    with pytest.raises(DriveError, match="lacks the key P_rect_02"):
        open_drive(drive)
    calibration.write_text(whole.replace("7.21", "nan 7.21"))
    with pytest.raises(DriveError, match="12 finite numbers"):
        open_drive(drive)
    calibration.unlink()
    with pytest.raises(DriveError, match="cannot be read"):
        open_drive(drive)


def test_blanks_and_nan_are_no_points(tmp_path: Path) -> None:
    drive = write_drive(tmp_path, 2)
    write_sweep(drive / "velodyne_points/data/0000000000.bin", np.array([[0, 0, 0], [np.nan, 1, 2], [5.0, 1, 0]]))
    assert len(open_drive(drive).sweeps[0].read().positions) == 1
