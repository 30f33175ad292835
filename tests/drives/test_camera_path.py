"""Paths of cameras: three kinds of file give the same views, shifts go where they say, and what is damaged is one line."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.small_street import FOCAL, HEIGHT, WIDTH, make_small_street, pose_at
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.camera_path import View, drive_path, read_camera_path, shifted
from unveil_core.drives.drive import Drive
from unveil_core.drives.importing.whole_drive import localized
from unveil_core.geometry.camera import Camera

UTM = np.array([352_140.0, 5_812_960.0, 34.0])


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small street with surveyed coordinates."""
    path = make_small_street(tmp_path_factory.mktemp("street"))
    data = json.loads(path.read_text())
    for frame in data["frames"]:
        for k in range(3):
            frame["transform_matrix"][k][3] += UTM[k]
    path.write_text(json.dumps(data))
    return path


@pytest.fixture(scope="module")
def drive(street: Path) -> Drive:
    return localized(open_drive(street))


def same(a: Camera, b: Camera) -> None:
    assert (a.width, a.height) == (b.width, b.height)
    np.testing.assert_allclose((a.fx, a.fy, a.cx, a.cy), (b.fx, b.fy, b.cx, b.cy), rtol=1e-12)
    np.testing.assert_allclose(a.world_to_camera[:3, :3], b.world_to_camera[:3, :3], atol=1e-12)
    np.testing.assert_allclose(a.centre, b.centre, atol=1e-8)


def written(folder: Path, document: object) -> Path:
    path = folder / "path.json"
    path.write_text(json.dumps(document))
    return path


def test_the_drives_own_file_gives_the_drives_own_views(street: Path, drive: Drive) -> None:
    views = read_camera_path(street, drive)
    assert [v.name for v in views] == [f.name for f in drive.frames]
    for view, own in zip(views, drive_path(drive), strict=True):
        same(view.camera, own.camera)


def test_nerfstudios_camera_path(drive: Drive, tmp_path: Path) -> None:
    """Flat matrices and a vertical field of view, as its viewer writes them."""
    pose = pose_at(2.0)
    pose[:3, 3] += UTM
    fov = 2 * math.degrees(math.atan(HEIGHT / 2 / FOCAL))
    entries = [{"camera_to_world": pose.ravel().tolist(), "fov": fov, "aspect": 1}, {"camera_to_world": pose.tolist()}]
    path = written(
        tmp_path,
        {
            "camera_type": "perspective",
            "render_width": WIDTH,
            "render_height": HEIGHT,
            "camera_path": entries,
            "fps": 24,
        },
    )
    views = read_camera_path(path, drive)
    assert [v.name for v in views] == ["0000", "0001"]
    for view in views:
        same(view.camera, drive.frames[2].camera)


def test_a_workspaces_own_cameras(drive: Drive, tmp_path: Path) -> None:
    frame = drive.frames[3]
    c = frame.camera
    entry = {
        "name": frame.name,
        "camera": "front",
        "width": c.width,
        "height": c.height,
        "fx": c.fx,
        "fy": c.fy,
        "cx": c.cx,
        "cy": c.cy,
        "world_to_camera": c.world_to_camera.tolist(),
    }
    (view,) = read_camera_path(written(tmp_path, {"to_world": drive.to_world.to_json(), "frames": [entry]}), drive)
    assert (view.name, view.track) == (frame.name, "front")
    same(view.camera, c)


def test_poses_alone_are_seen_through_the_drives_lens(street: Path, drive: Drive, tmp_path: Path) -> None:
    matrix = json.loads(street.read_text())["frames"][5]["transform_matrix"]
    frames = [{"transform_matrix": matrix}, {"transform_matrix": matrix, "w": 50, "h": 20, "camera_angle_x": 1.0}]
    first, second = read_camera_path(written(tmp_path, {"frames": frames}), drive)
    same(first.camera, drive.frames[5].camera)
    assert (second.camera.width, second.camera.height, second.camera.cx, second.camera.cy) == (50, 20, 25, 10)
    assert second.camera.fx == second.camera.fy == pytest.approx(25 / math.tan(0.5))


def test_names_are_single_files_and_never_the_same_twice(street: Path, drive: Drive, tmp_path: Path) -> None:
    matrix = json.loads(street.read_text())["frames"][0]["transform_matrix"]
    odd = [("../../etc/passwd", "../.."), ("a b/c:d.png", "left eye"), (".hidden", "..")]
    frames: list[dict[str, Any]] = [{"file_path": f, "camera": c, "transform_matrix": matrix} for f, c in odd]
    views = read_camera_path(written(tmp_path, {"frames": frames}), drive)
    assert [(v.name, v.track) for v in views] == [("passwd", "camera"), ("c_d", "left eye"), ("hidden", "camera")]
    views = read_camera_path(written(tmp_path, {"frames": [frames[0], frames[0]]}), drive)
    assert [v.name for v in views] == ["0000", "0001"]


def test_beside_is_right_of_travel_and_above_is_up(drive: Drive) -> None:
    """The small street leads along x: right of it is -y. Where the camera looks does not matter."""
    views = drive_path(drive)
    backwards = np.diag([-1.0, 1.0, -1.0, 1.0])
    rear = []
    for v in views:
        turned = backwards @ v.camera.world_to_camera
        rear.append(replace(v, track="rear", camera=replace(v.camera, world_to_camera=turned)))
    mixed = [v for pair in zip(views, rear, strict=True) for v in pair]
    moved = shifted(mixed, beside=1.5, above=1.0)
    assert [(v.name, v.track) for v in moved] == [(v.name, v.track) for v in mixed]
    for before, after in zip(mixed, moved, strict=True):
        np.testing.assert_allclose(after.camera.centre - before.camera.centre, (0, -1.5, 1.0), atol=1e-9)
        np.testing.assert_array_equal(after.camera.world_to_camera[:3, :3], before.camera.world_to_camera[:3, :3])


def test_on_a_bend_every_view_goes_its_own_way() -> None:
    """A quarter circle of 20 m to the left, at a slope: 2 m to its right lies a circle of 22 m, as high."""
    angle = np.linspace(0, np.pi / 2, 12)
    views = []
    for a in angle:
        pose = np.eye(4)
        pose[:3, :3] = [[np.sin(a), -np.cos(a), 0], [0, 0, -1], [np.cos(a), np.sin(a), 0]]
        pose[:3, 3] = -pose[:3, :3] @ (20 * np.sin(a), -20 * np.cos(a), 0.3 * a)
        views.append(View(str(a), "camera", Camera(8, 8, 9.0, 9.0, 4.0, 4.0, pose)))
    moved = np.array([v.camera.centre for v in shifted(views, beside=2.0)])
    np.testing.assert_allclose(np.linalg.norm(moved[1:-1, :2], axis=1), 22.0, atol=1e-9)
    np.testing.assert_allclose(moved[:, 2], 0.3 * angle, atol=1e-12)


def test_a_known_direction_of_travel_counts_more_than_jitter(drive: Drive) -> None:
    """A standing car's odometry jitters; where the street leads is known from elsewhere."""
    rng = np.random.default_rng(0)
    views = []
    for v in drive_path(drive):
        pose = v.camera.world_to_camera.copy()
        pose[:3, 3] = -pose[:3, :3] @ (drive.frames[0].camera.centre + rng.normal(0, 0.01, 3) * (1, 1, 0))
        views.append(replace(v, camera=replace(v.camera, world_to_camera=pose)))
    along = np.tile([1.0, 0.0, 0.2], (len(views), 1))
    for before, after in zip(views, shifted(views, beside=2.0, along=along), strict=True):
        np.testing.assert_allclose(after.camera.centre - before.camera.centre, (0, -2.0, 0), atol=1e-9)


@pytest.mark.parametrize(("look", "right"), [((0, 1, 0), (1, 0, 0)), ((0, 0, -1), (1, 0, 0))])
def test_a_camera_that_stands_still(look: tuple[int, ...], right: tuple[int, ...]) -> None:
    """Right of where it looks, level; straight down, of the top of its picture, which is y here."""
    rotation = np.array([(1, 0, 0), np.cross(look, (1, 0, 0)), look], dtype=float)
    pose = np.eye(4)
    pose[:3, :3] = rotation
    views = [View(str(i), "camera", Camera(8, 8, 9.0, 9.0, 4.0, 4.0, pose)) for i in range(3)]
    for view in shifted(views, beside=1.0):
        np.testing.assert_allclose(view.camera.centre, right, atol=1e-12)


GOOD = {"transform_matrix": (np.eye(4) + np.pad(UTM[:, None], ((0, 1), (3, 0)))).tolist()}


def in_frame(**values: object) -> Callable[[Path], Path]:
    return lambda folder: written(folder, {"frames": [{**GOOD, **values}]})


def in_viewer(**values: object) -> Callable[[Path], Path]:
    entry = {"camera_to_world": GOOD["transform_matrix"], **values}
    return lambda folder: written(folder, {"camera_path": [entry], **{k: v for k, v in values.items() if k != "fov"}})


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda f: f / "nowhere.json", "nowhere.json: cannot be read: No such file"),
        (lambda f: f, "cannot be read: Is a directory"),
        (lambda f: written(f, {"frames": []}), "path.json: has no cameras"),
        (lambda f: written(f, [1, 2]), "path.json: has no cameras"),
        (lambda f: written(f, {"frames": [3]}), "Not a JSON object: view 0"),
        (in_frame(transform_matrix=None), "Not a 4x4 matrix: the pose of frame 0000"),
        (in_frame(transform_matrix="north"), "view 0000 is damaged"),
        (in_frame(transform_matrix=np.diag([2.0, 2, 2, 1]).tolist()), "Not a rotation"),
        (in_frame(transform_matrix=np.array(GOOD["transform_matrix"]).T.tolist()), "the last row of view 0000"),
        (in_frame(transform_matrix=[[math.nan] * 4] * 3 + [[0, 0, 0, 1]]), "holds NaN"),
        (in_frame(w=100), "view 0000 has half a camera"),
        (in_frame(w=100, h="tall", fl_x=80), "view 0000 is damaged: could not convert"),
        (in_frame(w=100, h=0, fl_x=80), "view 0000 has 100x0 pixels (1 to 16384 a side)"),
        (in_frame(w=1e9, h=1e9, fl_x=80), "pixels (1 to 16384 a side)"),
        (in_frame(w=math.inf, h=80, fl_x=80), "view 0000 is damaged: cannot convert float infinity"),
        (in_frame(w=100, h=80, fl_x=-1), "no focal length"),
        (in_frame(transform_matrix=np.eye(4).tolist()), "m away from the drive (poses are camera-to-world"),
        (in_frame(world_to_camera=[[1]]), "view 0000 needs a 4x4 matrix"),
        (in_frame(world_to_camera=np.eye(4).tolist()), "view 0000 lacks 'fx'"),
        (in_viewer(camera_type="equirectangular"), "Not a known camera_type: equirectangular"),
        (in_viewer(fov=180), "field of view of 180 degrees"),
        (in_viewer(camera_to_world=[1, 2, 3]), "Not a 4x4 matrix"),
    ],
)
def test_a_damaged_path_is_one_line(make: Callable[[Path], Path], line: str, drive: Drive, tmp_path: Path) -> None:
    with pytest.raises(DriveError) as error:
        read_camera_path(make(tmp_path), drive)
    assert line in str(error.value) and "\n" not in str(error.value)


def test_text_that_is_no_json(drive: Drive, tmp_path: Path) -> None:
    for content, says in ((b"{", "Not valid JSON"), (b"\xff\xfe\x00", "Not UTF-8 text")):
        (tmp_path / "path.json").write_bytes(content)
        with pytest.raises(DriveError, match=says):
            read_camera_path(tmp_path / "path.json", drive)
