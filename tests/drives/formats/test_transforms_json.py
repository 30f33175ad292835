"""transforms.json in, Drive out; import and open again; every bad input is one line that names the file."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.drives.tiny_drive import CAR, ROAD, SKY, camera_to_world, edit, make_tiny_drive
from unveil_core.base.errors import DriveError, SelectionError, UnveilError
from unveil_core.base.pictures.decoding import read_image, read_instance_image, read_label_image
from unveil_core.drives import open_drive
from unveil_core.drives.importing.check import check_drive
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.semantics.labels import choose_labels


def test_poses_turn_to_opencv(tmp_path: Path) -> None:
    drive = open_drive(make_tiny_drive(tmp_path))
    camera = drive.frames[2].camera
    assert np.allclose(camera.centre, (2, 0, 1.6))
    assert np.allclose(camera.forward, (1, 0, 0))
    pixels, depth = camera.project(np.array([[12.0, 0.0, 1.6], [12.0, -1.0, 0.6]]))
    assert np.allclose(depth, 10)
    assert np.allclose(pixels, [[16, 12], [16 + 2.5, 12 + 2.6]])  # right of and below the middle


@pytest.mark.parametrize("offset", [(0, 0, 0), (352_140.0, 5_812_960.0, 34.0), (6e6, -6e6, 1e3)])
def test_recentring_loses_nothing(tmp_path: Path, offset: tuple[float, float, float]) -> None:
    drive = open_drive(make_tiny_drive(tmp_path / "d", offset=offset))
    local = import_drive(drive, tmp_path / "ws" / "drive")
    assert np.abs(local.frames[0].camera.centre).max() < 10
    rounding = 4 * np.spacing(max(1.0, *np.abs(offset)))
    for i, frame in enumerate(local.frames):
        world = frame.camera.centre + local.to_world.translation
        assert np.abs(world - camera_to_world(i, np.array(offset))[:3, 3]).max() <= rounding
    assert np.abs(local.points.positions + local.to_world.translation - drive.points.positions).max() <= rounding


def test_import_opens_again_and_links_originals(tmp_path: Path) -> None:
    drive = open_drive(make_tiny_drive(tmp_path / "d", masks=True))
    local = import_drive(drive, tmp_path / "ws" / "drive")
    again = open_drive(tmp_path / "ws" / "drive")
    assert [f.name for f in again.frames] == ["00", "01", "02", "03"]
    for a, b, c in zip(drive.frames, local.frames, again.frames, strict=True):
        assert a.image_path.read_bytes() == c.image_path.read_bytes()
        assert np.array_equal(b.camera.world_to_camera, c.camera.world_to_camera)
        assert c.mask_path is not None and c.semantic_path is not None and c.instance_path is not None
    assert not list((tmp_path / "ws").glob(".*partial*"))


def test_smaller_images_see_the_same(tmp_path: Path) -> None:
    drive = open_drive(make_tiny_drive(tmp_path / "d", masks=True))
    local = import_drive(drive, tmp_path / "ws" / "drive", work_side=16)
    frame = local.frames[0]
    assert (frame.camera.width, frame.camera.height) == (16, 12)
    blocks = read_image(drive.frames[0].image_path).reshape(12, 2, 16, 2, 3).mean(axis=(1, 3))
    assert np.abs(read_image(frame.image_path) - blocks).max() <= 0.5
    assert frame.semantic_path is not None and frame.instance_path is not None and frame.mask_path is not None
    car = np.zeros((12, 16), bool)
    car[6:9, 9:13] = True
    beside = np.where(np.arange(12)[:, None] < 5, SKY, ROAD)
    assert np.array_equal(read_label_image(frame.semantic_path), np.where(car, CAR, beside))
    assert np.array_equal(read_instance_image(frame.instance_path), np.where(car, 300, 0))
    assert np.array_equal(read_label_image(frame.mask_path), np.where(car, 0, 255))
    point = np.array([[9.0, 0.5, 1.0]])
    full = drive.frames[0].camera.project(point)[0]
    assert np.allclose(frame.camera.project(point - local.to_world.translation)[0] * 2, full)


@pytest.mark.parametrize("model", ["OPENCV", "OPENCV_FISHEYE"])
def test_undistortion_puts_points_where_the_pinhole_says(tmp_path: Path, model: str) -> None:
    path = make_tiny_drive(tmp_path / "d", semantics=False)
    size, focal, coefficients = (320, 240), 200.0, {"k1": -0.12, "k2": 0.03, "k3": 0.0, "k4": 0.0}
    if model == "OPENCV":
        coefficients |= {"p1": 0.002, "p2": -0.001}

    def change(document: dict) -> None:  # type: ignore[type-arg]
        document.update({"w": size[0], "h": size[1], "fl_x": focal, "fl_y": focal, "cx": 160.0, "cy": 120.0})
        document.update({"camera_model": model, **coefficients})
        document["frames"] = document["frames"][:1]

    edit(path, change)
    # A white dot drawn where OpenCV's distorted projection puts a point must appear where the pinhole projection says.
    k = np.array([[focal, 0, 159.5], [0, focal, 119.5], [0, 0, 1]])
    ray = np.array([[[0.45, -0.3, 1.0]]])
    order = ("k1", "k2", "p1", "p2") if model == "OPENCV" else ("k1", "k2", "k3", "k4")
    values = np.array([coefficients.get(n, 0.0) for n in order])
    project = cv2.projectPoints if model == "OPENCV" else cv2.fisheye.projectPoints
    spot = project(ray, np.zeros(3), np.zeros(3), k, values)[0].reshape(2)
    image = np.zeros((240, 320, 3), np.uint8)
    y, x = np.mgrid[0:240, 0:320]
    image[...] = (255 * np.exp(-((x - spot[0]) ** 2 + (y - spot[1]) ** 2) / 18))[..., None].astype(np.uint8)
    cv2.imwrite(str(path.parent / "images/00.png"), image)
    local = import_drive(open_drive(path), tmp_path / "ws" / "drive")
    assert local.frames[0].distortion is None
    flat = read_image(local.frames[0].image_path)[..., 0].astype(float)
    found = np.array([(flat * (x + 0.5)).sum(), (flat * (y + 0.5)).sum()]) / flat.sum()
    assert np.abs(found - (160 + focal * 0.45, 120 - focal * 0.3)).max() < 0.35


def cut_image(path: Path) -> None:
    image = path.parent / "images/01.png"
    image.write_bytes(image.read_bytes()[:-40])


def garble_image(path: Path) -> None:
    (path.parent / "images/01.png").write_bytes(b"no image at all")


def resize_image(path: Path) -> None:
    cv2.imwrite(str(path.parent / "images/01.png"), np.zeros((10, 10, 3), np.uint8))


def resize_labels(path: Path) -> None:
    cv2.imwrite(str(path.parent / "semantics/02.png"), np.zeros((10, 10), np.uint8))


def nan_pose(path: Path) -> None:
    edit(path, lambda d: d["frames"][1]["transform_matrix"][0].__setitem__(3, float("nan")))


def scaled_pose(path: Path) -> None:
    edit(path, lambda d: d["frames"][1]["transform_matrix"][0].__setitem__(1, -2.0))


def no_frames(path: Path) -> None:
    edit(path, lambda d: d.update(frames=[]))


def no_points(path: Path) -> None:
    edit(path, lambda d: d.pop("ply_file_path"))


def missing_points(path: Path) -> None:
    (path.parent / "points.ply").unlink()


def cut_points(path: Path) -> None:
    points = path.parent / "points.ply"
    points.write_bytes(points.read_bytes()[:-100])


def twice(path: Path) -> None:
    edit(path, lambda d: d["frames"].append(d["frames"][0]))


def bad_json(path: Path) -> None:
    path.write_text(path.read_text()[:-20])


BAD = {
    "01.png: Cut short": cut_image,
    "01.png: Not a readable image": garble_image,
    "01.png: Not the size of its camera: 10x10 pixels, the camera says 32x24": resize_image,
    "02.png: Not the size of its camera: 10x10 pixels, the camera says 32x24": resize_labels,
    "transforms.json: the pose of frame 01 holds NaN or infinity": nan_pose,
    "transforms.json: Not a rotation: the pose of frame 01": scaled_pose,
    "transforms.json: has no frames": no_frames,
    "transforms.json: names no points": no_points,
    "points.ply: Not found": missing_points,
    "points.ply: Not a readable point PLY": cut_points,
    "frame 00 of camera camera occurs twice": twice,
    "transforms.json: Not valid JSON": bad_json,
}


@pytest.mark.parametrize("line", sorted(BAD))
def test_bad_input_is_one_line_and_leaves_nothing(tmp_path: Path, line: str) -> None:
    path = make_tiny_drive(tmp_path / "d")
    BAD[line](path)
    with pytest.raises(UnveilError) as caught:
        drive = open_drive(path)
        import_drive(drive, tmp_path / "ws" / "drive")
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not list((tmp_path / "ws").glob("**/*")) if (tmp_path / "ws").exists() else True


def test_rounded_rotations_are_made_exact(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)
    edit(path, lambda d: d["frames"][1]["transform_matrix"][0].__setitem__(1, 2e-4))
    rotation = open_drive(path).frames[1].camera.world_to_camera[:3, :3]
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-12


def test_suffix_and_focal_length_may_be_left_out(tmp_path: Path) -> None:
    path = make_tiny_drive(tmp_path)

    def change(document: dict) -> None:  # type: ignore[type-arg]
        for key in ("w", "h", "fl_x", "fl_y", "cx", "cy"):
            document.pop(key)
        document["camera_angle_x"] = 1.0
        for frame in document["frames"]:
            frame["file_path"] = frame["file_path"][:-4]

    edit(path, change)
    camera = open_drive(path).frames[0].camera
    assert (camera.width, camera.height, camera.cx) == (32, 24, 16.0)
    assert camera.fx == pytest.approx(16 / np.tan(0.5))
    check_drive(open_drive(path))


def test_selection(tmp_path: Path) -> None:
    drive = open_drive(make_tiny_drive(tmp_path / "a"))
    scene = choose_labels(drive)
    assert scene.labels.names == ("road", "sky", "car") and scene.removed == ("car",)
    with pytest.raises(SelectionError, match="nothing to remove: the drive has no person; found: road, sky, car"):
        choose_labels(drive, ("person",))
    assert choose_labels(drive, (), (300,)).removed == ()
    with pytest.raises(SelectionError, match="no instance 7; found: 300"):
        choose_labels(drive, (), (7,))
    masked = open_drive(make_tiny_drive(tmp_path / "b", semantics=False, masks=True))
    assert choose_labels(masked).source == "masks"
    bare = open_drive(make_tiny_drive(tmp_path / "c", semantics=False))
    with pytest.raises(DriveError, match="neither semantics nor masks"):
        choose_labels(bare)


def test_unknown_places_say_what_is_looked_for(tmp_path: Path) -> None:
    with pytest.raises(DriveError, match="Not found"):
        open_drive(tmp_path / "nowhere")
    with pytest.raises(DriveError, match="sparse/0 .COLMAP."):
        open_drive(tmp_path)
