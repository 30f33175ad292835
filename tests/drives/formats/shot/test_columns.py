"""Camera paths of columns: Nuke's .chan, and what others write with shot.json."""

from __future__ import annotations

import json
import math
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from tests.drives.formats.shot.shots import COUNT, SIZE, angles, chan, plates, pose_y_up, rotation
from unveil_core.base.errors import DriveError
from unveil_core.drives.drive import Drive
from unveil_core.drives.formats.registry import open_drive
from unveil_core.drives.formats.shot.columns import turned
from unveil_core.exports.cameras.chan import nuke_angles
from unveil_core.geometry.transforms import opengl_to_opencv, rigid_inverse


def same_poses(drive: Drive, first: int = 0) -> None:
    assert drive.frames
    for k, frame in enumerate(drive.frames, start=first):
        expected = rigid_inverse(opengl_to_opencv(pose_y_up(k)))
        np.testing.assert_allclose(frame.camera.world_to_camera, expected, atol=1e-6)


def test_nukes_chan_with_plates_beside(tmp_path: Path) -> None:
    plates(tmp_path / "plates")
    path = chan(tmp_path / "cam.chan")
    (tmp_path / "points.obj").write_text("# locators\nv 1 2 3\nv 4 5 6\nvn 0 1 0\n")
    for given in (path, tmp_path):
        drive = open_drive(given)
        same_poses(drive)
        assert [f.name for f in drive.frames] == [f"plate.{1001 + k}" for k in range(COUNT)]
        camera = drive.frames[0].camera
        assert camera.fy == pytest.approx(SIZE[1] / 2 / math.tan(math.radians(20)))
        assert (camera.fx, camera.cx, camera.cy) == (camera.fy, SIZE[0] / 2, SIZE[1] / 2)
        assert drive.units_per_metre is None and drive.up is not None and drive.up.tolist() == [0, 1, 0]
        assert drive.points.positions.tolist() == [[1, 2, 3], [4, 5, 6]]
        assert not drive.notices


@pytest.mark.parametrize("order", ["".join(p) for p in permutations("XYZ")])
def test_the_first_axis_is_turned_about_first(order: str) -> None:
    degrees = np.array([10.0, 20.0, 30.0])
    first, second, third = (rotation(a.lower(), degrees["XYZ".index(a)]) for a in order)
    np.testing.assert_allclose(turned(degrees, order), third @ second @ first, atol=1e-12)


def test_what_unveil_exports_for_nuke_is_read_back() -> None:
    given = np.array([[10.0, -40.0, 5.0], [-20.0, 130.0, 170.0]])
    turns = np.stack([turned(a, "ZXY") for a in given])
    np.testing.assert_allclose(np.degrees(nuke_angles(turns)), given, atol=1e-9)


def test_rotation_order_and_focal_length_are_told(tmp_path: Path) -> None:
    """As SynthEyes' plain text may be: XYZ, z up, centimetres, the focal length last."""
    plates(tmp_path / "plates")
    path = chan(tmp_path / "camera.txt", last="35.0")
    said = {"rotation_order": "XYZ", "zoom": "focal_mm", "sensor_mm": [24.0, 13.5], "up": "z", "units_per_metre": 100}
    (tmp_path / "shot.json").write_text(json.dumps({**said, "fps": 24, "camera": "A", "lens": {"k1": -0.1}}))
    drive = open_drive(path)
    x, y, z = angles(1)
    expected = np.eye(4)
    expected[:3, :3] = rotation("z", z) @ rotation("y", y) @ rotation("x", x)
    expected[:3, 3] = pose_y_up(1)[:3, 3]
    frame = drive.frames[1]
    np.testing.assert_allclose(frame.camera.world_to_camera, rigid_inverse(opengl_to_opencv(expected)), atol=1e-6)
    assert frame.camera.fx == pytest.approx(35 / 24 * SIZE[0]) and frame.camera.fy == pytest.approx(140)
    assert drive.units_per_metre == 100 and drive.up is not None and drive.up.tolist() == [0, 0, 1]
    assert frame.camera_name == "A" and frame.timestamp == pytest.approx(1002 / 24)
    assert frame.distortion is not None and frame.distortion.coefficients[0] == -0.1


def test_pixel_aspect_makes_the_picture_narrower(tmp_path: Path) -> None:
    plates(tmp_path / "plates")
    chan(tmp_path / "cam.chan")
    (tmp_path / "shot.json").write_text('{"pixel_aspect": 2.0}')
    camera = open_drive(tmp_path).frames[0].camera
    assert camera.fx == pytest.approx(camera.fy / 2)


def test_frames_are_matched_by_their_numbers(tmp_path: Path) -> None:
    plates(tmp_path, first=1003, count=6, name="sh_{}_v2.png")
    drive = open_drive(chan(tmp_path / "cam.chan"))
    same_poses(drive, first=2)
    assert [f.name for f in drive.frames] == ["sh_1003_v2", "sh_1004_v2", "sh_1005_v2"]
    assert "2 of 5 frames of the path have no plate" in drive.notices[0]
    assert "3 of 6 plates have no frame of the path" in drive.notices[1]


def test_as_many_frames_as_plates_go_in_order(tmp_path: Path) -> None:
    plates(tmp_path)
    drive = open_drive(chan(tmp_path / "cam.chan", first=1))
    same_poses(drive)
    assert "as many, so they are taken in order" in drive.notices[0]
    (tmp_path / "shot.json").write_text('{"frame_offset": 1001}')
    assert [f.name for f in open_drive(tmp_path).frames] == [f"plate.{1002 + k}" for k in range(4)]


@pytest.mark.parametrize(
    ("first", "count", "line"),
    [
        (1, 3, "no frame has a plate: the path has frames 1 to 3, the plates are 1001 to 1005"),
        (1001, 0, "holds no frames"),
    ],
)
def test_frames_without_plates(tmp_path: Path, first: int, count: int, line: str) -> None:
    plates(tmp_path)
    with pytest.raises(DriveError, match=line):
        open_drive(chan(tmp_path / "cam.chan", first=first, count=count))


def test_several_sequences_want_a_name(tmp_path: Path) -> None:
    plates(tmp_path / "left", name="l.{}.png")
    plates(tmp_path / "plates", name="a.{}.png")
    plates(tmp_path / "plates", name="b.{}.png")
    path = chan(tmp_path / "cam.chan")
    with pytest.raises(DriveError, match=r'2 picture sequences beside it: a\.#\.png, b\.#\.png.*name one by "plates"'):
        open_drive(path)
    for named, name in (("plates/b.####.png", "b.1001"), ("plates/a.%04d.png", "a.1001"), ("left", "l.1001")):
        (tmp_path / "shot.json").write_text(json.dumps({"plates": named}))
        assert open_drive(tmp_path).frames[0].name == name


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("1001 0 0 0 0 0 0\n", r"does not tell the focal|does not tell its focal length.*focal_mm"),
        ("1001 0 0 0 0 0 0 200\n", r"field of view of 200 degrees.*zoom"),
        ("1001 0 0 0 0 0\n", r"Not a frame of a camera path: line 1"),
        ("1001 0 0 0 0 0 x 40\n", r"Not a frame of a camera path: line 1"),
        ("1001 0 0 0 0 0 0 40\n1001 0 0 0 0 0 0 40\n", r"has frame 1001 twice"),
    ],
)
def test_paths_that_are_none(tmp_path: Path, text: str, line: str) -> None:
    plates(tmp_path)
    (tmp_path / "cam.chan").write_text(text)
    with pytest.raises(DriveError, match=line):
        open_drive(tmp_path)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ('{"zom": "none"}', r"Not a known key: zom.*keys are path"),
        ('{"zoom": "fov"}', r"Not a value of zoom: 'fov'.*vertical_fov"),
        ('{"fps": -1}', r"Not a value of fps: '-1'.*frames a second"),
        ('{"lens": {"k9": 1}}', r"Not a value of lens:.*k1, k2"),
        ("[]", r"no JSON object"),
        ('{"path": "gone.chan"}', r"names a camera path that is none: gone.chan"),
        ('{"plates": "nowhere"}', r"Not a folder: .*nowhere, named as plates"),
    ],
)
def test_what_shot_json_says_is_checked(tmp_path: Path, text: str, line: str) -> None:
    plates(tmp_path)
    chan(tmp_path / "cam.chan")
    (tmp_path / "shot.json").write_text(text)
    with pytest.raises(DriveError, match=line):
        open_drive(tmp_path / "shot.json")


@pytest.mark.parametrize(
    ("name", "text", "places"),
    [
        ("points.csv", "name,x,y,z\nt1,1,2,3\nt2,4,5,6\n", [[1, 2, 3], [4, 5, 6]]),
        ("points.csv", "x;y;z\n1;2;3\n", [[1, 2, 3]]),
        ("locators.txt", "Tracker1 1 2 3\nTracker2 4 5 6\n", [[1, 2, 3], [4, 5, 6]]),
        ("trackers.txt", "1 1 2 3\n2 4 5 6\n", [[1, 2, 3], [4, 5, 6]]),
        ("points.xyz", "1 2 3\n4 5 6\n", [[1, 2, 3], [4, 5, 6]]),
    ],
)
def test_points_of_a_matchmove(tmp_path: Path, name: str, text: str, places: list[list[float]]) -> None:
    plates(tmp_path / "plates")
    path = chan(tmp_path / "cam.chan")
    assert "no points lie beside cam.chan" in open_drive(path).notices[0]
    (tmp_path / name).write_text(text)
    assert open_drive(path).points.positions.tolist() == places


def test_a_line_that_is_no_point(tmp_path: Path) -> None:
    plates(tmp_path / "plates")
    path = chan(tmp_path / "cam.chan")
    (tmp_path / "points.csv").write_text("x,y,z\n1,2\n")
    with pytest.raises(DriveError, match=r"points.csv: Not a point: a line with '1 2' .*NAME X Y Z"):
        open_drive(path)
