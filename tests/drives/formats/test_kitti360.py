"""KITTI-360: a tiny sequence in the released encoding, and what may be wrong with one."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
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
from unveil_core.drives.selecting import DriveOptions

NAME = "2013_05_28_drive_0000_sync"
IMU_FROM_CAM0 = np.array([
    [0.0371783278, -0.0986182135, 0.9944306009, 1.5752681039],
    [0.9992675562, -0.0053553387, -0.0378902567, 0.0043914093],
    [0.0090621821, 0.9951109327, 0.0983468786, -0.6500000000],
    [0, 0, 0, 1],
])  # fmt: skip
VELO_FROM_CAM0 = np.array([
    [0.04307104361, -0.08829286498, 0.995162929, 0.8043914418],
    [-0.999004371, 0.007784614041, 0.04392796942, 0.2993489574],
    [-0.01162548558, -0.9960641394, -0.08786966659, -0.1770225824],
    [0, 0, 0, 1],
])  # fmt: skip
RECTIFY = {0: rotation(0.004, -0.01, 0.007), 1: rotation(-0.003, 0.012, -0.002)}
BASELINE_M = 0.6
FOCAL, CENTRE = 55.2554261, (30.2049453, 8.8769549)
SPEED, YAW_RATE = 8.0, -0.2
ORIGIN = np.array([1048.7, 3719.3, 114.6])


def imu_pose(time: float) -> np.ndarray:
    """World z up from IMU: x ahead, y to the right, z down."""
    heading = 0.9 + YAW_RATE * time
    radius = SPEED / YAW_RATE
    position = radius * (np.sin([heading, 0.9 + math.pi / 2]) - np.sin([0.9, heading + math.pi / 2]))
    return rigid(rotation(z=heading) @ np.diag([1.0, -1.0, -1.0]), ORIGIN + (*position, 0.0))


def matrix(k: int) -> np.ndarray:
    return np.array([[FOCAL, 0, CENTRE[0], -FOCAL * BASELINE_M * k], [0, FOCAL, CENTRE[1], 0], [0, 0, 1, 0]])


def imu_from_rectified(k: int) -> np.ndarray:
    """Rectified cameras have the same axes, and lie beside each other along x."""
    first = IMU_FROM_CAM0 @ np.linalg.inv(rigid(RECTIFY[0], (0, 0, 0)))
    return first @ rigid(np.eye(3), (BASELINE_M * k, 0, 0))


def scanner(time: float) -> np.ndarray:
    return imu_pose(time) @ IMU_FROM_CAM0 @ np.linalg.inv(VELO_FROM_CAM0)


def wall() -> np.ndarray:
    angle = np.linspace(-2.9, 2.9, 60)
    around = np.stack([15 * np.cos(angle), 15 * np.sin(angle), np.sin(7 * angle)], axis=1)
    return apply(scanner(0.2), around)


def measured(time: float) -> np.ndarray:
    """The wall as the scanner sees it while it turns clockwise."""
    found = []
    for point in wall():
        when = time
        for _ in range(20):
            x, y, z = apply(np.linalg.inv(scanner(when)), point[None])[0]
            when = time - 0.1 * math.atan2(y, x) / (2 * math.pi)
        found.append((x, y, z))
    return np.array(found)


def write_sequence(root: Path, frames: int = 5, without_pose: tuple[int, ...] = ()) -> Path:
    images = root / "data_2d_raw" / NAME
    text, in_imu = "calib_time: 29-May-2013\n", ""
    for k in (0, 1):
        text += f"S_rect_0{k}: 62 18\nR_rect_0{k}: {numbers(RECTIFY[k])}\nP_rect_0{k}: {numbers(matrix(k))}\n"
        in_imu += f"image_0{k}: {numbers((imu_from_rectified(k) @ rigid(RECTIFY[k], (0, 0, 0)))[:3])}\n"
    write_text(root / "calibration/perspective.txt", text)
    write_text(root / "calibration/calib_cam_to_pose.txt", in_imu + "image_02: 1 2 3\n")
    write_text(root / "calibration/calib_cam_to_velo.txt", numbers(VELO_FROM_CAM0[:3]))
    lines = [f"{i} {numbers(imu_pose(0.1 * i)[:3])}" for i in range(frames) if i not in without_pose]
    write_text(root / "data_poses" / NAME / "poses.txt", "\n".join(lines))
    stamps = "\n".join(f"2013-05-28 08:46:{2 + 0.1 * i:012.9f}" for i in range(frames))
    for k in (0, 1):
        for i in range(frames):
            write_picture(images / f"image_0{k}/data_rect/{i:010d}.png")
        write_text(images / f"image_0{k}/timestamps.txt", stamps)
    velodyne = root / "data_3d_raw" / NAME / "velodyne_points"
    for i in range(frames):
        write_sweep(velodyne / f"data/{i:010d}.bin", measured(0.1 * i))
    write_text(velodyne / "timestamps.txt", stamps)
    return root


def write_labels(root: Path, frame: int, semantic: np.ndarray, instance: np.ndarray) -> None:
    folder = root / "data_2d_semantics/train" / NAME / "image_00"
    for kind, values in (("semantic", semantic.astype(np.uint8)), ("instance", instance.astype(np.uint16))):
        (folder / kind).mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / kind / f"{frame:010d}.png"), values)


def test_cameras_see_points_where_the_calibration_says(tmp_path: Path) -> None:
    drive = open_drive(write_sequence(tmp_path), DriveOptions(cameras=("all",)))
    assert {f.camera_name for f in drive.frames} == {"image_00", "image_01"} and not drive.notices
    in_velo = np.random.default_rng(0).uniform((6, -4, -2), (30, 4, 2), (40, 3))
    for frame in drive.frames:
        world = apply(scanner(0.1 * int(frame.name)), in_velo)
        in_cam0 = apply(np.linalg.inv(VELO_FROM_CAM0), in_velo) @ RECTIFY[0].T
        expected = projected(matrix(int(frame.camera_name[-1])), in_cam0)
        assert np.abs(seen_at(frame, world) - expected).max() < 0.01
        assert frame.camera.world_to_camera[1, 2] < -0.9  # the picture's down is the world's down
    assert drive.front_cameras == ("image_00",) and drive.key_frames is None and drive.semantic_classes is None


def test_a_still_wall_stands_still_though_the_vehicle_moves(tmp_path: Path) -> None:
    drive = open_drive(write_sequence(tmp_path, without_pose=(1,)))
    assert np.linalg.norm(apply(scanner(0.2), measured(0.2)) - wall(), axis=1).max() > 0.3
    assert [int(s.path.stem) for s in drive.sweeps] == [0, 2, 3, 4]
    for sweep in drive.sweeps:
        assert np.linalg.norm(sweep.read().positions - wall(), axis=1).max() < 0.015


def test_frames_without_pose_are_left_out(tmp_path: Path) -> None:
    root = write_sequence(tmp_path, without_pose=(1, 3))
    (root / "data_3d_raw" / NAME / "velodyne_points/data/0000000002.bin").unlink()
    poses = root / "data_poses" / NAME / "poses.txt"
    write_text(poses, poses.read_text().replace(poses.read_text().splitlines()[2], "4 " + "nan " * 12))
    (root / "data_2d_raw" / NAME / "image_02/data_rgb").mkdir(parents=True)
    drive = open_drive(root / "data_2d_raw" / NAME)
    assert [int(f.name) for f in drive.frames] == [0, 2]
    said = ["poses", "image_00", "image_01", "image_02", "velodyne_points", "velodyne_points"]
    assert [n.split(":")[0] for n in drive.notices] == said


def test_labels_are_train_ids_and_objects_keep_their_numbers(tmp_path: Path) -> None:
    root = write_sequence(tmp_path)
    ids = np.array([[7, 9, 26, 26, 30, 11, 44, 1]])
    semantic = np.repeat(ids, 18, axis=0).repeat(8, axis=1)[:, :62]
    instance = semantic * 1000 + np.where(np.arange(62) < 24, 0, 17)
    write_labels(root, 1, semantic, instance)
    drive = open_drive(root)
    assert drive.key_frames == {"0000000001"} and drive.semantic_classes == "cityscapes"
    assert any("1 of 10 photographs are labelled" in n for n in drive.notices)
    assert [f.labels is None for f in drive.frames] == [True, False, True, True, True]
    read = drive.frames[1].labels
    assert read is not None
    labels = read()
    assert labels.semantic[0, ::8].tolist() == [0, 0, 13, 13, 14, 2, 255, 255]
    assert labels.instance is not None and labels.ego is not None
    assert labels.instance[0, ::8].tolist() == [0, 0, 0, 26017, 30017, 0, 0, 0]
    assert labels.ego.sum() == 18 * 6


def matrix_text(name: str, values: np.ndarray) -> str:
    rows, columns = values.shape
    head = f"<rows>{rows}</rows><cols>{columns}</cols><dt>f</dt>"
    return f"<{name} type_id='opencv-matrix'>{head}<data>{numbers(values)}</data></{name}>"


CUBE = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)])


def box_text(n: int, kind: int, instance: int, frame: int, pose: np.ndarray) -> str:
    return (
        f"<object{n}><index>{n}</index><label>car</label><semanticId>{kind}</semanticId><instanceId>{instance}</instanceId>"
        f"<timestamp>{frame}</timestamp><dynamic>{int(frame >= 0)}</dynamic>{matrix_text('transform', pose)}"
        f"{matrix_text('vertices', CUBE)}</object{n}>"
    )


def placed(x: float, yaw: float, size: tuple[float, float, float]) -> np.ndarray:
    return rigid(rotation(z=yaw) @ np.diag(size), ORIGIN + (x, 3, 0.5))


def write_boxes(root: Path, *items: str) -> Path:
    path = root / "data_3d_bboxes/train" / f"{NAME}.xml"
    write_text(path, f"<?xml version='1.0'?>\n<opencv_storage>\n{''.join(items)}</opencv_storage>\n")
    return path


def test_boxes_have_the_numbers_of_the_pictures(tmp_path: Path) -> None:
    root = write_sequence(tmp_path)
    car = (4.2, 1.8, 1.5)
    items = [
        box_text(1, 13, 17, -1, placed(10, 0.3, car)),
        box_text(2, 11, 4, -1, placed(12, 0.3, (30, 20, 9))),  # a building
        box_text(3, 14, 2, -1, placed(900, 0.3, car)),  # far away
        box_text(4, 13, 5, 1, placed(20, 0.1, (1.8, 4.2, 1.5))),  # its length is along y
        box_text(5, 13, 5, 3, placed(22, 0.2, (1.8, 4.2, 1.5))),
        box_text(6, 19, 0, -1, placed(7, 0.0, (0.5, 0.6, 1.7))),  # not in the pictures
    ]
    write_boxes(root, *items)
    drive = open_drive(root)
    assert [sorted(b.id for b in f.boxes) for f in drive.frames] == [
        [26017, 45000],
        [26005, 26017, 45000],
        [26005, 26017, 45000],
        [26005, 26017, 45000],
        [26017, 45000],
    ]
    boxes = {b.id: b for b in drive.frames[2].boxes}
    still, moving = boxes[26017], boxes[26005]
    assert still.size == pytest.approx(car) and still.yaw == pytest.approx(0.3) and still.class_name == "car"
    assert still.centre == pytest.approx(tuple(ORIGIN + (10, 3, 0.5)))
    assert moving.centre == pytest.approx(tuple(ORIGIN + (21, 3, 0.5))) and moving.size == pytest.approx(car)
    assert moving.yaw == pytest.approx(0.15 + math.pi / 2) and boxes[45000].class_name == "person"
    assert drive.sweeps[2].boxes == drive.frames[2].boxes


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t.replace("<opencv_storage>", "<!DOCTYPE a [<!ENTITY b 'c'>]><opencv_storage>"), "document type"),
        (lambda t: t.replace("<opencv_storage>", "<!DOCTYPE a SYSTEM 'a.dtd'><opencv_storage>"), "document type"),
        (lambda t: t[:-40], "Not complete XML"),
        (lambda t: t.replace("<timestamp>-1</timestamp>", ""), "object1: lacks timestamp"),
        (
            lambda t: t.replace("<cols>4</cols><dt>f</dt><data>", "<cols>4</cols><dt>f</dt><data>1 "),
            "not a matrix of 4",
        ),
    ],
)
def test_hostile_and_damaged_boxes_say_so(tmp_path: Path, change, said: str) -> None:  # type: ignore[no-untyped-def]
    root = write_sequence(tmp_path, 2)
    path = write_boxes(root, box_text(1, 13, 17, -1, placed(10, 0.3, (4.2, 1.8, 1.5))))
    path.write_text(change(path.read_text()))
    with pytest.raises(DriveError, match=said):
        open_drive(root)


def test_damaged_files_say_so(tmp_path: Path) -> None:
    root = write_sequence(tmp_path, 2)
    sweep = root / "data_3d_raw" / NAME / "velodyne_points/data/0000000001.bin"
    sweep.write_bytes(sweep.read_bytes()[:-1])
    with pytest.raises(DriveError, match="Cut short"):
        open_drive(root).sweeps[1].read()
    perspective = root / "calibration/perspective.txt"
    whole = perspective.read_text()
    write_text(perspective, whole.replace("R_rect_01", "R_01"))
    with pytest.raises(DriveError, match="lacks the key R_rect_01"):
        open_drive(root)
    write_text(perspective, whole)
    poses = root / "data_poses" / NAME / "poses.txt"
    write_text(poses, "0 1 2 3")
    with pytest.raises(DriveError, match="Not a frame number and 12 numbers"):
        open_drive(root)
    poses.unlink()
    with pytest.raises(DriveError, match="Not found: poses of this sequence"):
        open_drive(root)
