"""What nerfstudio and Instant-NGP write beside the plain case: rigs, lenses, depth images, transformed points, splits."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.drives.tiny_drive import camera_to_world, edit, make_tiny_drive
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.drive import PointCloud
from unveil_core.drives.formats.nerfstudio.depth import MOST_POINTS
from unveil_core.drives.points import read_points, write_points
from unveil_core.drives.scale_and_up import place_drive

TURN = np.array([[0.0, 1.0, 0.0, 2.0], [0.0, 0.0, 1.0, -1.0], [1.0, 0.0, 0.0, 0.5]])


def drive_with(tmp_path: Path, change: Callable[[dict[str, Any]], object], **options: Any) -> Path:
    path = make_tiny_drive(tmp_path / "d", **options)
    edit(path, change)
    return path


def set_frames(document: dict[str, Any], **values: list[Any]) -> None:
    for key, given in values.items():
        for frame, value in zip(document["frames"], given, strict=True):
            frame[key] = value


# ------------------------------------------------------------------------------------------------------------- cameras, names


def into_folders(path: Path, folders: list[str], stems: list[str]) -> None:
    """Move the images, and say so."""

    def change(document: dict[str, Any]) -> None:
        for i, (frame, folder, stem) in enumerate(zip(document["frames"], folders, stems, strict=True)):
            target = path.parent / folder / f"{stem}.png"
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path.parent / f"images/{i:02d}.png", target)
            frame["file_path"] = f"./{folder}/{stem}.png"

    edit(path, change)


@pytest.mark.parametrize(
    ("folders", "stems", "expected"),
    [
        (["images/a"] * 2 + ["images/b"] * 2, ["0", "1"] * 2, [("a", "0"), ("a", "1"), ("b", "0"), ("b", "1")]),
        (["i", "i", "i/b", "i/b"], ["0", "1"] * 2, [("camera", "0"), ("camera", "1"), ("b", "0"), ("b", "1")]),
        (["a/x", "b/x", "a/x", "b/x"], ["0", "0", "1", "1"], [("a_x", "0"), ("b_x", "0"), ("a_x", "1"), ("b_x", "1")]),
        # One folder a frame is no rig: the folder is the frame's name.
        (["f0", "f1", "f2", "f3"], ["rgb"] * 4, [("camera", f"f{k}_rgb") for k in range(4)]),
        (["images"] * 4, ["7", "8", "9", "10"], [("camera", n) for n in ("7", "8", "9", "10")]),
    ],
)  # fmt: skip
def test_folders_are_cameras(
    folders: list[str], stems: list[str], expected: list[tuple[str, str]], tmp_path: Path
) -> None:
    path = make_tiny_drive(tmp_path)
    into_folders(path, folders, stems)
    edit(path, lambda d: [f.pop("timestamp") for f in d["frames"]])
    frames = open_drive(path).frames
    assert sorted((f.camera_name, f.name) for f in frames) == sorted(expected)
    assert all(f.image_path.is_file() for f in frames)


def test_cameras_by_key(tmp_path: Path) -> None:
    path = drive_with(tmp_path, lambda d: set_frames(d, camera_id=[1, 1, 2, "rear cam"]))
    assert [f.camera_name for f in open_drive(path).frames] == ["camera_1", "camera_1", "camera_2", "rear cam"]
    edit(path, lambda d: set_frames(d, camera=["front"] * 3 + ["rear"]))
    assert [f.camera_name for f in open_drive(path).frames] == ["front"] * 3 + ["rear"]


def test_cameras_by_lens(tmp_path: Path) -> None:
    """Of a rig that takes two pictures at a time; of one camera they are not (see ``tests/drives/travel``)."""

    def double(document: dict[str, Any]) -> None:
        entries = document["frames"]
        document["frames"] = [dict(entry) for entry in entries for _ in range(2)]
        for k, frame in enumerate(document["frames"]):
            pose = camera_to_world(k // 2, np.array([0.0, 0.5 * (k % 2), 0.0])).tolist()
            frame.update(fl_x=25.0 + k % 2, timestamp=0.1 * (k // 2), transform_matrix=pose)
            frame["file_path"] = f"images/{k:02d}.png"
            (tmp_path / f"d/images/{k:02d}.png").write_bytes((tmp_path / "d/images/00.png").read_bytes())

    frames = open_drive(drive_with(tmp_path, double)).frames
    assert [f.camera_name for f in frames] == ["camera_1"] * 4 + ["camera_2"] * 4
    assert {f.camera.fx for f in frames[:4]} == {25.0} and {f.camera.fx for f in frames[4:]} == {26.0}


def test_frames_of_all_splits_in_the_order_of_the_file(tmp_path: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        document["frames"] = document["frames"][::-1]
        document.update(train_filenames=["images/00.png"], val_filenames=["images/01.png"], test_filenames=[])
        for frame in document["frames"]:
            frame.pop("timestamp")

    assert [f.name for f in open_drive(drive_with(tmp_path, change)).frames] == ["03", "02", "01", "00"]


def test_time_is_a_time_stamp(tmp_path: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        for k, frame in enumerate(document["frames"]):
            frame["time"] = frame.pop("timestamp") + k

    assert [f.timestamp for f in open_drive(drive_with(tmp_path, change)).frames] == pytest.approx([0, 1.1, 2.2, 3.3])


# --------------------------------------------------------------------------------------------------------------------- lenses


def test_lenses_by_frame_and_order_of_coefficients(tmp_path: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        document.update(camera_model="OPENCV", k1=0.1, k2=0.2, k3=0.3, p1=0.01, p2=0.02)
        document["frames"][1].update(camera_model="OPENCV_FISHEYE", k4=0.4, fl_x=30.0)
        document["frames"][2].update(camera_model="FULL_OPENCV", k4=0.4)

    frames = open_drive(drive_with(tmp_path, change)).frames
    assert [f.distortion.model for f in frames if f.distortion] == ["OPENCV", "OPENCV_FISHEYE", "OPENCV", "OPENCV"]
    coefficients = [f.distortion.coefficients for f in frames if f.distortion]
    assert coefficients[0] == (0.1, 0.2, 0.01, 0.02, 0.3, 0, 0, 0) and coefficients[1] == (0.1, 0.2, 0.3, 0.4)
    assert coefficients[2] == (0.1, 0.2, 0.01, 0.02, 0.3, 0.4, 0, 0) and frames[1].camera.fx == 30


def test_instant_ngp_says_fisheye_and_angles(tmp_path: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        for key in ("fl_x", "fl_y", "w", "h", "camera_model"):
            document.pop(key)
        document.update(camera_angle_x=1.0, camera_angle_y=0.5, is_fisheye=True)

    frame = open_drive(drive_with(tmp_path, change)).frames[0]
    assert frame.distortion is not None and frame.distortion.model == "OPENCV_FISHEYE"
    assert frame.camera.fx == pytest.approx(16 / math.tan(0.5)) and frame.camera.fy == pytest.approx(
        12 / math.tan(0.25)
    )
    assert (frame.camera.width, frame.camera.height) == (32, 24)


@pytest.mark.parametrize(("radius", "told"), [(60, False), (18, False), (15, True)])
def test_a_fisheye_circle_within_the_picture_is_told(radius: float, told: bool, tmp_path: Path) -> None:
    """Corners 20 pixels from the middle of a pinhole with a focal length of 25 are 25 atan(20 / 25) = 17 in the fisheye."""
    keys = {"camera_model": "OPENCV_FISHEYE", "fisheye_crop_radius": radius}
    notices = open_drive(drive_with(tmp_path, lambda d: d.update(keys))).notices
    assert len(notices) == told and all("fisheye_crop_radius 15" in n and "up to 17 pixels" in n for n in notices)


# --------------------------------------------------------------------------------------------------------------------- points


def turned(path: Path, *, cloud: bool) -> np.ndarray:
    """Poses as nerfstudio saves them, and with ``cloud`` the points as well; gives the points that belong to the poses."""
    pose = np.eye(4)
    pose[:3] = TURN

    def change(document: dict[str, Any]) -> None:
        for frame in document["frames"]:
            frame["transform_matrix"] = (pose @ np.array(frame["transform_matrix"])).tolist()
        document["applied_transform"] = TURN.tolist()

    edit(path, change)
    points = read_points(path.parent / "points.ply")
    moved = points.positions @ TURN[:, :3].T + TURN[:, 3]
    if cloud:
        write_points(PointCloud(moved, points.colors), path.parent / "points.ply")
    return moved


@pytest.mark.parametrize("cloud", [True, False])
def test_points_lie_where_the_cameras_see_them(cloud: bool, tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)
    expected = turned(path, cloud=cloud)
    drive = open_drive(path)
    assert np.allclose(drive.points.positions, expected)
    assert bool(drive.notices) != cloud and all("before applied_transform" in n for n in drive.notices)


def test_points_of_a_scaled_drive(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)
    turned(path, cloud=False)

    def scale(document: dict[str, Any]) -> None:
        document["applied_scale"] = 0.5
        document.pop("metric")
        for frame in document["frames"]:
            matrix = np.array(frame["transform_matrix"])
            matrix[:3, 3] *= 0.5
            frame["transform_matrix"] = matrix.tolist()

    before = read_points(path.parent / "points.ply").positions
    edit(path, scale)
    drive = open_drive(path)
    assert np.allclose(drive.points.positions, 0.5 * (before @ TURN[:, :3].T + TURN[:, 3]))
    assert drive.units_per_metre == 0.5


def test_points_of_the_colmap_model_beside_it(tmp_path: Path) -> None:
    """As nerfstudio left them before it wrote a PLY."""
    path = make_tiny_drive(tmp_path)
    expected = turned(path, cloud=False)
    points = read_points(tmp_path / "points.ply")
    assert points.colors is not None
    folder = tmp_path / "colmap/sparse/0"
    folder.mkdir(parents=True)
    (folder / "images.txt").write_text("")
    rows = zip(points.positions, points.colors, strict=True)
    lines = [f"{k} {' '.join(map(str, [*p, *c]))} 0.5 1 0 2 0 3 0" for k, (p, c) in enumerate(rows)]
    (folder / "points3D.txt").write_text("\n".join(lines))
    edit(path, lambda d: d.pop("ply_file_path"))
    drive = open_drive(path)
    assert np.allclose(drive.points.positions, expected) and folder / "points3D.txt" in drive.sources


# --------------------------------------------------------------------------------------------------------------------- depth


def wall_depth(size: tuple[int, int] = (24, 32)) -> np.ndarray:
    """(H, W) metres: a wall 8 m before each camera, a box 5 m before it, and no depth in the upper rows."""
    height, width = size
    depth = np.full(size, 8.0, np.float32)
    depth[: height // 4] = 0
    depth[height // 2 :, width // 2 :] = 5.0
    return depth


def with_depth(path: Path, values: np.ndarray, ending: str = "png", **keys: Any) -> None:
    (path.parent / "depth").mkdir(exist_ok=True)

    def change(document: dict[str, Any]) -> None:
        document.pop("ply_file_path", None)
        document.update(keys)
        for k, frame in enumerate(document["frames"]):
            frame["depth_file_path"] = name = f"depth/{k:02d}.{ending}"
            if ending == "npy":
                np.save(path.parent / name, values)
            else:
                cv2.imwrite(str(path.parent / name), values)

    edit(path, change)


KINDS: dict[str, tuple[np.ndarray, str, dict[str, float], bool]] = {
    "millimetres": (np.round(wall_depth() * 1000).astype(np.uint16), "png", {}, True),
    "of a unit": (np.round(wall_depth() * 256).astype(np.uint16), "png", {"depth_unit_scale_factor": 1 / 256}, False),
    "metres in floating point": (wall_depth(), "npy", {}, True),
    "millimetres in floating point": (wall_depth().astype(np.float64) * 1000, "npy", {}, True),
    "with an axis more": (wall_depth()[..., None], "npy", {"depth_unit_scale_factor": 1.0}, False),
    "smaller than the picture": (np.round(wall_depth((12, 16)) * 1000).astype(np.uint16), "png", {}, True),
    "not finite": (np.where(wall_depth() > 0, wall_depth(), np.nan), "npy", {"depth_unit_scale_factor": 1.0}, False),
}


@pytest.mark.parametrize("kind", KINDS)
def test_depth_images_are_sweeps(kind: str, tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)
    values, ending, keys, told = KINDS[kind]
    with_depth(path, values, ending, up=[0, 0, 1], **keys)
    drive = open_drive(path)
    assert not len(drive.points.positions) and len(drive.sweeps) == 4
    assert bool(drive.notices) == told and all("depth_unit_scale_factor decides" in n for n in drive.notices)
    assert [s.timestamp for s in drive.sweeps] == [f.timestamp for f in drive.frames]
    found = drive.sweeps[2].read().positions
    # The camera stands at x = 2 and looks along x; the box is to the right (y < 0) and below.
    assert set(np.round(found[:, 0] - 2, 2)) == {8.0, 5.0}
    box = found[np.abs(found[:, 0] - 7) < 0.1]
    assert (box[:, 1] < 0).all() and (box[:, 2] < 1.6).all()
    assert len(found) > 0.5 * np.count_nonzero(np.nan_to_num(np.squeeze(values)))
    # Pixels at a depth's border are of neither side.
    pixels = drive.frames[2].camera.project(found)[0] * (values.shape[1] / 32)
    assert not ((np.abs(pixels[:, 0] - values.shape[1] / 2) < 0.9) & (pixels[:, 1] > values.shape[0] / 2 + 1)).any()


@pytest.mark.parametrize("unit", [1e-3, 10 / 65535])
def test_instant_ngp_names_depth_images_and_their_unit_otherwise(unit: float, tmp_path: Path) -> None:
    """NeRFCapture's unit is a 65,535th of ten metres."""
    path = make_tiny_drive(tmp_path)
    with_depth(path, np.round(wall_depth() / unit).astype(np.uint16), integer_depth_scale=unit, up=[0, 0, 1])
    edit(path, lambda d: [f.update(depth_path=f.pop("depth_file_path")) for f in d["frames"]])
    drive = open_drive(path)
    assert len(drive.sweeps) == 4 and drive.notices == ()
    found = drive.sweeps[1].read().positions[:, 0] - 1
    assert set(np.round(found, 3)) == {8.0, 5.0} and drive.scale_source == "metric"


def splits(path: Path) -> Path:
    """The drive in two files, as synthetic NeRFs have it; returns its folder."""
    document = json.loads(path.read_text())
    for name, frames in (("train", document["frames"][::2]), ("test", document["frames"][1::2])):
        (path.parent / f"transforms_{name}.json").write_text(json.dumps({**document, "frames": frames}))
    path.unlink()
    return path.parent


def test_parts_of_a_capture_are_one_drive(tmp_path: Path) -> None:
    folder = splits(make_tiny_drive(tmp_path))
    drive = open_drive(folder)
    assert [f.name for f in drive.frames] == ["00", "01", "02", "03"]
    assert drive.notices[0] == (
        "no transforms.json: the frames of transforms_train.json (2), transforms_test.json (2) make one drive"
    )
    assert {p.name for p in drive.sources} >= {"transforms_train.json", "transforms_test.json"}
    alone = open_drive(folder / "transforms_train.json")
    assert [f.name for f in alone.frames] == ["00", "02"]
    assert "transforms_test.json beside it: not read; give the folder to read all frames" in alone.notices


@pytest.mark.parametrize("model", ["OPENCV", "OPENCV_FISHEYE"])
def test_depth_through_a_distorting_lens(model: str, tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)
    with_depth(
        path, wall_depth(), "npy", camera_model=model, k1=-0.2, k2=0.05, depth_unit_scale_factor=1.0, up=[0, 0, 1]
    )
    drive = open_drive(path)
    found = drive.sweeps[0].read().positions
    corner = found[np.argmin(found[:, 1] + found[:, 2])]  # right and below, 5 m away
    k = np.array([[25.0, 0, 16], [0, 26, 12], [0, 0, 1]])
    coefficients = np.array([-0.2, 0.05, 0, 0])
    project = cv2.projectPoints if model == "OPENCV" else cv2.fisheye.projectPoints
    local = np.array([[[-corner[1], 1.6 - corner[2], corner[0]]]])
    pixel = project(local, np.zeros(3), np.zeros(3), k, coefficients)[0].reshape(2)
    assert np.allclose(pixel, (31.5, 23.5), atol=0.01)


def test_depth_is_in_units_of_the_poses(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)
    with_depth(path, np.round(wall_depth() * 1000).astype(np.uint16), applied_scale=0.5, depth_unit_scale_factor=0.001)
    found = open_drive(path).sweeps[0].read().positions
    assert set(np.round(found[:, 0], 2)) == {4.0, 2.5}


def test_scale_and_up_are_estimated_from_some_depth_images(tmp_path: Path) -> None:
    """Depth of the ground 1.6 units below the cameras."""
    path = make_tiny_drive(tmp_path)
    rows = np.arange(24) + 0.5
    depth = np.where(rows > 13, 1.6 * 26 / np.maximum(rows - 12, 0.1), 0)[:, None] * np.ones((1, 32))
    with_depth(path, depth.astype(np.float32), "npy", depth_unit_scale_factor=1.0)
    edit(path, lambda d: d.pop("metric"))
    drive = open_drive(path)
    assert len(drive.points.positions) and len(drive.sweeps) == 4
    placed = place_drive(drive)
    assert placed.scale_source == "depth unit" and placed.up_name == "z"
    assert placed.height == pytest.approx(1.6, rel=0.05)


def test_large_depth_images_are_thinned(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)
    with_depth(path, np.full((960, 1280), 8000, np.uint16), up=[0, 0, 1])
    count = len(open_drive(path).sweeps[0].read().positions)
    assert MOST_POINTS / 4 < count <= MOST_POINTS


def test_missing_depth_images_are_told(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)
    with_depth(path, np.round(wall_depth() * 1000).astype(np.uint16), up=[0, 0, 1], depth_unit_scale_factor=0.001)
    (tmp_path / "depth/01.png").unlink()
    drive = open_drive(path)
    assert (
        len(drive.sweeps) == 3 and len(drive.notices) == 1 and "1 of 4 depth images are not there" in drive.notices[0]
    )


# --------------------------------------------------------------------------------------------------------------------- errors


BAD_KEYS: dict[str, Callable[[dict[str, Any]], object]] = {
    "Not a number: fl_x: 'wide'": lambda d: d.update(fl_x="wide"),
    "Not a number: cy of frame 02": lambda d: d["frames"][2].update(cy=[1]),
    "Not a number: timestamp of frame 00": lambda d: d["frames"][0].update(timestamp="noon"),
    "camera_model EQUIRECTANGULAR cannot be undistorted": lambda d: d.update(camera_model="EQUIRECTANGULAR"),
    "Not a known camera_model: BALL .use one of PINHOLE": lambda d: d.update(camera_model="BALL"),
    "nerfstudio's fourth radial term": lambda d: d.update(camera_model="OPENCV", k4=0.1),
    "Not a 3x4 matrix: applied_transform": lambda d: d.update(applied_transform=[[1, 0], [0, 1]]),
    "has no frames": lambda d: d.update(frames={"a": 1}),
    "frame 1 has no file_path": lambda d: d["frames"][1].pop("file_path"),
    "has neither fl_x nor camera_angle_x": lambda d: d.pop("fl_x"),
    "Not a field of view: camera_angle_x is 4": lambda d: (d.pop("fl_x"), d.update(camera_angle_x=4.0)),
    'names no points .points.ply lies beside it: set "ply_file_path": .*or give depth': lambda d: d.pop("ply_file_path"),
    "Not the name of a file: file_path of frame 1": lambda d: d["frames"][1].update(file_path=["images/01.png"]),
    "Not above 0: integer_depth_scale -1": lambda d: (
        d.pop("ply_file_path"),
        d.update(integer_depth_scale=-1.0),
        set_frames(d, depth_path=[f"images/{k:02d}.png" for k in range(4)]),
    ),
    "names no points, and none of its 4 depth images is there, the first .*/d/9.png": lambda d: (
        d.pop("ply_file_path"),
        set_frames(d, depth_path=["d/9.png"] * 4),
    ),
}  # fmt: skip


@pytest.mark.parametrize("line", BAD_KEYS)
def test_bad_keys_are_one_line(line: str, tmp_path: Path) -> None:
    path = drive_with(tmp_path, BAD_KEYS[line])
    with pytest.raises(DriveError, match=line) as caught:
        open_drive(path)
    assert "\n" not in str(caught.value) and str(tmp_path) in str(caught.value)


BAD_DEPTH: dict[str, tuple[str, Callable[[Path], object]]] = {
    "Not a readable .npy file": ("npy", lambda p: p.write_bytes(b"no array")),
    "Not an array .H, W. of depths": ("npy", lambda p: np.save(p, np.zeros((3, 4, 5)))),
    "Not a readable .npy file: it says": ("npy", lambda p: np.save(p, np.array([{}], dtype=object), allow_pickle=True)),
    "Not a depth image of one channel: it has 8 bits": ("png", lambda p: cv2.imwrite(str(p), np.zeros((24, 32), np.uint8))),
    "Not a depth image of one channel: it has 3 channels": ("png", lambda p: cv2.imwrite(str(p), np.zeros((24, 32, 3), np.uint16))),
    "Not a readable depth image": ("png", lambda p: p.write_bytes(b"no image")),
}  # fmt: skip


@pytest.mark.parametrize("line", BAD_DEPTH)
def test_bad_depth_is_one_line(line: str, tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)
    ending, spoil = BAD_DEPTH[line]
    values = wall_depth() if ending == "npy" else np.round(wall_depth() * 1000).astype(np.uint16)
    with_depth(path, values, ending, up=[0, 0, 1], depth_unit_scale_factor=1.0)
    spoil(tmp_path / f"depth/02.{ending}")
    drive = open_drive(path)  # no depth image is read before it is asked for
    with pytest.raises(DriveError, match=line) as caught:
        drive.sweeps[2].read()
    assert "\n" not in str(caught.value) and f"depth/02.{ending}" in str(caught.value)


def test_poses_of_the_tiny_drive_are_not_changed_by_all_that(tmp_path: Path) -> None:
    drive = open_drive(make_tiny_drive(tmp_path))
    assert np.allclose(drive.frames[3].camera.centre, camera_to_world(3, np.zeros(3))[:3, 3])
    assert not drive.sweeps and not drive.notices


def test_a_field_of_view_in_degrees_is_taken_for_that_and_told(tmp_path: Path) -> None:
    drive = make_tiny_drive(tmp_path)
    edit(drive, lambda d: (d.pop("fl_x"), d.pop("fl_y"), d.update(camera_angle_x=70.0, camera_angle_y=55.0)))
    opened = open_drive(drive)
    camera = opened.frames[0].camera
    assert camera.fx == pytest.approx(16 / math.tan(math.radians(35)))
    assert camera.fy == pytest.approx(12 / math.tan(math.radians(27.5)))
    assert [n for n in opened.notices if "degrees" in n] == [
        "camera_angle_x or camera_angle_y is 70: taken for degrees, 1.222 radians"
    ]
