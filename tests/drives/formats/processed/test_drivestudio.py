"""DriveStudio's layout: which dataset a scene holds is found from its numbers, and all of them lie where their truth is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.formats.processed.lidar_columns import OF_WAYMO, WITHOUT_ORIGIN, columns_of

WIDTH, HEIGHT, FRAMES = 48, 32, 3
FOCAL, CENTRE = (40.0, 41.0), (23.7, 16.2)
OPENCV_AXES = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
ORIGIN = np.array([15_000.0, -800.0, 60.0])
STREET = np.random.default_rng(1).uniform((8, -5, -1), (30, 5, 3), (31, 3)) + ORIGIN
COLUMNS = {"waymo": 14, "s3gaussian": 10, "nuplan": 6, "pandaset": 5, "argoverse": 4, "kitti": 4, "nuscenes": 4}
PER_FRAME = ("pandaset", "nuscenes")
"""Datasets whose extrinsics are world from camera, frame by frame."""


def at(x: float, y: float, z: float, yaw: float = 0.0) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = (x, y, z)
    return pose


def vehicle(frame: int) -> np.ndarray:
    return at(*ORIGIN) @ at(0.5 * frame, 0.0, 0.0, 0.4 + 0.02 * frame)


LIDAR = at(0.9, 0.0, 1.8, -1.57)


def mounted(camera: int) -> np.ndarray:
    """Ego from camera, with Waymo's axes."""
    return at(1.5, 0.0, 1.9, (0.0, 0.8, -2.9)[camera])


def rows_of(dataset: str, points: np.ndarray) -> np.ndarray:
    """A file's rows, as the preparation of each dataset writes them."""
    generator = np.random.default_rng(5)
    n = len(points)
    rows = np.zeros((n, COLUMNS[dataset]), "<f4")
    intensity, lasers = generator.uniform(0, 200, n), np.arange(n) % 5
    if dataset in ("waymo", "s3gaussian"):
        rows[:, :3], rows[:, 3:6] = (1.4, 0.0, 2.1), points
        rows[:, -4:] = np.stack([np.ones(n), intensity, generator.uniform(0, 1.5, n), lasers], axis=1)
    else:
        rows[:, :3], rows[:, 3] = points, intensity
    if dataset == "nuplan":
        rows[:, 4:] = np.stack([np.arange(n) % 40, lasers], axis=1)
    if dataset == "pandaset":
        rows[:, 4] = lasers % 2
    return rows


def instances(name: str = "Vehicle") -> dict[str, Any]:
    places = [(vehicle(i) @ at(10.0 + i, 2.0, 0.8, 0.1)).tolist() for i in range(1, FRAMES)]
    annotations = {"frame_idx": [1, 2], "obj_to_world": places, "box_size": [[4.5, 1.9, 1.6]] * 2}
    sign = {"frame_idx": [0], "obj_to_world": places[:1], "box_size": [[1, 1, 1]]}
    return {
        "0": {"id": "a", "class_name": name, "frame_annotations": annotations},
        "1": {"id": "b", "class_name": "Sign", "frame_annotations": sign},
    }


def write_scene(folder: Path, dataset: str) -> Path:
    is_waymo = dataset in ("waymo", "s3gaussian")
    cameras = (0, 1, 2)

    def save(name: str, numbers: Any) -> None:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(folder / name, numbers)

    for camera in cameras:
        pose = mounted(camera) if is_waymo else mounted(camera) @ OPENCV_AXES
        coefficients = (0.05, -0.02, 0.001, -0.0005, 0.003) if is_waymo else (0.0,) * 5
        save(f"intrinsics/{camera}.txt", [*FOCAL, *CENTRE, *coefficients])
        for i in range(FRAMES):
            if dataset in PER_FRAME:
                save(f"extrinsics/{i:03d}_{camera}.txt", vehicle(i) @ pose)
            image = folder / f"images/{i:03d}_{camera}.jpg"
            image.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(image), np.full((HEIGHT, WIDTH, 3), 60, np.uint8))
        if dataset not in PER_FRAME:
            save(f"extrinsics/{camera}.txt", pose)
    (folder / "lidar").mkdir()
    for i in range(FRAMES):
        axes = vehicle(i) @ LIDAR if dataset == "nuscenes" else vehicle(i)
        save(f"{'lidar_pose' if dataset == 'nuscenes' else 'ego_pose'}/{i:03d}.txt", axes)
        back = np.linalg.inv(axes)
        rows_of(dataset, STREET @ back[:3, :3].T + back[:3, 3]).tofile(folder / f"lidar/{i:03d}.bin")
    if dataset != "s3gaussian":
        (folder / "instances").mkdir()
        (folder / "instances/instances_info.json").write_text(json.dumps(instances()))
    return folder


@pytest.mark.parametrize("dataset", COLUMNS)
def test_points_of_each_dataset_project_where_its_truth_does(tmp_path: Path, dataset: str) -> None:
    drive = open_drive(write_scene(tmp_path / "000", dataset), DriveOptions(cameras=("all",)))
    assert (len(drive.frames), len(drive.sweeps)) == (3 * FRAMES, FRAMES)
    for sweep in drive.sweeps:
        assert np.allclose(sweep.read().positions, STREET, atol=1e-4)
    for frame in drive.frames:
        world_to_camera = np.linalg.inv(vehicle(int(frame.name)) @ mounted(int(frame.camera_name)))
        waymo = STREET @ world_to_camera[:3, :3].T + world_to_camera[:3, 3]  # x forward, y left, z up
        u, v = -waymo[:, 1] / waymo[:, 0], -waymo[:, 2] / waymo[:, 0]
        # Waymo counts from the edge of the first pixel, as we do, the others from its centre.
        shift = 0.0 if dataset in ("waymo", "s3gaussian") else 0.5
        expected = np.stack([u * FOCAL[0] + CENTRE[0] + shift, v * FOCAL[1] + CENTRE[1] + shift], axis=1)
        pixels, depth = frame.camera.project(STREET)
        before = waymo[:, 0] > 1
        assert np.allclose(pixels[before], expected[before], atol=0.01)
        assert np.allclose(depth, waymo[:, 0], atol=1e-6)
        assert (frame.distortion is not None) == (shift == 0.0)


def test_boxes_are_those_of_instances(tmp_path: Path) -> None:
    drive = open_drive(write_scene(tmp_path / "000", "waymo"))
    for thing in (drive.frames, drive.sweeps):
        assert thing[0].boxes == ()
        for i in (1, 2):
            (box,) = thing[i].boxes
            assert np.allclose(box.centre, (vehicle(i) @ at(10.0 + i, 2.0, 0.8))[:3, 3])
            assert (box.class_name, box.size) == ("car", (4.5, 1.9, 1.6))
            assert box.yaw == pytest.approx(0.5 + 0.02 * i)


@pytest.mark.parametrize(
    ("name", "class_name"),
    [("Pedestrian", "person"), ("human.pedestrian.adult", "person"), ("vehicle", "car"), ("REGULAR_VEHICLE", "car"),
     ("Tram / Subway", "train"), ("Van", "car"), ("vehicle.bus.rigid", "bus"), ("Cyclist", "rider")],
)  # fmt: skip
def test_names_of_all_datasets_are_known(tmp_path: Path, name: str, class_name: str) -> None:
    root = write_scene(tmp_path / "000", "argoverse")
    (root / "instances/instances_info.json").write_text(json.dumps(instances(name)))
    assert [b.class_name for b in open_drive(root).frames[1].boxes] == [class_name]


def test_scenes_and_times(tmp_path: Path) -> None:
    for scene in ("000", "001"):
        write_scene(tmp_path / "processed_10Hz/mini" / scene, "nuscenes")
    write_scene(tmp_path / "processed/mini/000", "nuscenes")
    write_scene(tmp_path / "waymo", "waymo")
    with pytest.raises(DriveError, match="000, 001"):
        open_drive(tmp_path / "processed_10Hz/mini")
    drive = open_drive(tmp_path / "processed_10Hz/mini", DriveOptions(scene="001"))
    assert {f.camera_name for f in drive.frames} == {"0"}
    assert [f.timestamp for f in drive.frames] == [0.0, 0.1, 0.2]
    assert [s.timestamp for s in open_drive(tmp_path / "processed/mini").sweeps] == [0.0, 0.5, 1.0]
    assert [f.timestamp for f in open_drive(tmp_path / "waymo").frames] == [0.0, 0.1, 0.2]


def test_numbers_without_zeros_before_them_count_as_numbers(tmp_path: Path) -> None:
    root = write_scene(tmp_path / "000", "waymo")
    for path in [p for p in root.rglob("00*") if p.is_file()]:
        path.rename(path.with_name(f"{int(path.name[:3]) + 8}{path.name[3:]}"))
    (root / "images/thumbnail.jpg").write_bytes(b"")
    drive = open_drive(root)
    assert [f.name for f in drive.frames] == ["8", "9", "10"]
    assert [s.path.name for s in drive.sweeps] == ["8.bin", "9.bin", "10.bin"]
    assert "images/: 1 pictures are not named as 000_0.jpg, the first thumbnail.jpg" in drive.notices


def test_gaps_are_borne_and_told(tmp_path: Path) -> None:
    root = write_scene(tmp_path / "000", "waymo")
    (root / "ego_pose/001.txt").unlink()
    (root / "lidar/002.bin").unlink()
    (root / "instances/instances_info.json").unlink()
    drive = open_drive(root)
    assert [f.name for f in drive.frames] == ["000", "002"]
    assert [s.path.name for s in drive.sweeps] == ["000.bin"]
    assert any("1 of 3 photographs have no pose" in n for n in drive.notices)
    assert any("no boxes" in n for n in drive.notices)


def test_without_any_pose_there_is_one_error(tmp_path: Path) -> None:
    root = write_scene(tmp_path / "000", "waymo")
    for path in (root / "ego_pose").iterdir():
        path.unlink()
    with pytest.raises(DriveError, match="no poses"):
        open_drive(root)


def test_cameras_that_lie_on_their_side_are_not_guessed_at(tmp_path: Path) -> None:
    root = write_scene(tmp_path / "000", "argoverse")
    side = np.eye(4)
    side[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # neither y down nor z up
    np.savetxt(root / "extrinsics/0.txt", side)
    with pytest.raises(DriveError, match=r"extrinsics/0\.txt: has axes that are neither"):
        open_drive(root)


def test_columns_are_told_apart_whatever_the_number_of_points() -> None:
    for dataset, width in COLUMNS.items():
        for count in range(3, 150):
            points = np.random.default_rng(count).uniform(-60, 60, (count, 3))
            widths = OF_WAYMO if width > 6 else WITHOUT_ORIGIN
            numbers = rows_of(dataset, points).ravel()
            assert columns_of(numbers, widths) == width, (dataset, count)
            if count > 50:
                cut = [columns_of(numbers[:-k], widths) for k in range(1, width)]
                assert cut == [None] * (width - 1), (dataset, count)


def test_damaged_sweeps_are_one_error(tmp_path: Path) -> None:
    first, second, third = open_drive(write_scene(tmp_path / "000", "waymo")).sweeps
    first.path.write_bytes(first.path.read_bytes()[:-8])
    second.path.write_bytes(second.path.read_bytes()[:-3])
    np.full(140, np.nan, "<f4").tofile(third.path)
    for sweep in (first, second, third):
        with pytest.raises(DriveError, match="Cut short"):
            sweep.read()


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("intrinsics/0.txt", "1 2"),
        ("intrinsics/0.txt", "40 40 nan 1"),
        ("intrinsics/0.txt", "a b c d"),
        ("ego_pose/000.txt", "1 2 3"),
        ("ego_pose/000.txt", " ".join(["2"] * 16)),
        ("extrinsics/0.txt", " ".join(["nan"] * 16)),
        ("instances/instances_info.json", "["),
        ("instances/instances_info.json", "[1]"),
        ("instances/instances_info.json", '{"0": {"class_name": "Vehicle"}}'),
        ("instances/instances_info.json", '{"0": {"class_name": "Vehicle", "frame_annotations": {"frame_idx": [0], '
         '"obj_to_world": [[1]], "box_size": [[1, 1, 1]]}}}'),
        ("images/000_0.jpg", "no picture"),
    ],
)  # fmt: skip
def test_damaged_files_are_one_error_that_names_them(tmp_path: Path, name: str, text: str) -> None:
    root = write_scene(tmp_path / "000", "waymo")
    (root / name).write_text(text)
    with pytest.raises(DriveError, match=name.split("/")[1].replace(".", r"\.")):
        open_drive(root)
