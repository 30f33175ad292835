"""Street Gaussians' segments: each photograph has the pose of its own time, the points are a pickle that runs nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.drives.formats.processed.test_neuralsim import Hostile
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.formats.processed.street_gaussians import _stamps

WIDTH, HEIGHT, FRAMES = 48, 32, 3
FOCAL, CENTRE = (40.0, 41.0), (23.7, 16.2)
OPENCV_AXES = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
ORIGIN = np.array([15_000.0, -800.0, 60.0])
STREET = np.random.default_rng(1).uniform((8, -5, -1), (30, 5, 3), (31, 3)) + ORIGIN
START_S = 1_557_843_345.0
DELAY_S = 0.04


def at(x: float, y: float, z: float, yaw: float = 0.0) -> np.ndarray:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = (x, y, z)
    return pose


def vehicle(time: float) -> np.ndarray:
    return at(*ORIGIN) @ at(5.0 * time, 0.0, 0.0, 0.2 * time)


def mounted(camera: int) -> np.ndarray:
    return at(1.5, 0.0, 1.9, 0.8 * camera) @ OPENCV_AXES


def write_segment(folder: Path, cloud: Any = None) -> Path:
    def save(name: str, numbers: Any) -> None:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(folder / name, numbers)

    points, lines = {}, ["frame_id track_id object_class alpha height width length cx cy cz heading speed"]
    for i in range(FRAMES):
        save(f"ego_pose/{i:06d}.txt", vehicle(0.1 * i))
        back = np.linalg.inv(vehicle(0.1 * i))
        points[i] = (STREET @ back[:3, :3].T + back[:3, 3]).astype(np.float32)
        x, y, z = back[:3, :3] @ (ORIGIN + (12 + 10 * 0.1 * i, 2.0, 0.8)) + back[:3, 3]
        lines.append(f"{i} car-a vehicle -10 1.6 1.9 4.5 {x} {y} {z} {0.3 - 0.2 * 0.1 * i} 10.0")
        lines.append(f"{i} sign-b sign -10 1 1 1 0 0 0 0 0")
        for camera in (0, 1):
            save(f"ego_pose/{i:06d}_{camera}.txt", vehicle(0.1 * i + DELAY_S))
            image = folder / f"images/{i:06d}_{camera}.png"
            image.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(image), np.full((HEIGHT, WIDTH, 3), 60, np.uint8))
    for camera in (0, 1):
        save(f"extrinsics/{camera}.txt", mounted(camera))
        save(f"intrinsics/{camera}.txt", [*FOCAL, *CENTRE, 0.05, -0.02, 0.001, -0.0005, 0.003])
    (folder / "track").mkdir()
    (folder / "track/track_info.txt").write_text("\n".join(lines) + "\n")
    stamps = {
        name: {f"{i:06d}": START_S + 0.1 * i + delay for i in range(FRAMES)}
        for name, delay in (("FRAME", 0.0), ("FRONT", DELAY_S), ("FRONT_LEFT", DELAY_S))
    }
    (folder / "timestamps.json").write_text(json.dumps(stamps))
    held = points if cloud is None else cloud
    np.savez_compressed(folder / "pointcloud.npz", pointcloud=held, camera_projection={0: np.zeros((3, 6), np.int16)})
    return folder


def test_points_project_through_the_pose_of_each_photograph(tmp_path: Path) -> None:
    drive = open_drive(write_segment(tmp_path / "segment"), DriveOptions(cameras=("all",)))
    assert [f.camera_name for f in drive.frames] == ["FRONT"] * FRAMES + ["FRONT_LEFT"] * FRAMES
    for sweep in drive.sweeps:
        assert np.allclose(sweep.read().positions, STREET, atol=1e-4)
    for frame in drive.frames:
        world_to_camera = np.linalg.inv(
            vehicle(0.1 * int(frame.name) + DELAY_S) @ mounted(frame.camera_name != "FRONT")
        )
        local = STREET @ world_to_camera[:3, :3].T + world_to_camera[:3, 3]
        # Waymo counts the principal point from the edge of the first pixel.
        expected = local[:, :2] / local[:, 2:] * FOCAL + CENTRE
        pixels, depth = frame.camera.project(STREET)
        assert np.allclose(pixels[depth > 1], expected[depth > 1], atol=0.01)
        assert frame.distortion is not None


def test_boxes_are_at_the_time_of_photograph_and_sweep(tmp_path: Path) -> None:
    drive = open_drive(write_segment(tmp_path / "segment"))
    for i in range(FRAMES):
        (box,) = drive.sweeps[i].boxes
        assert np.allclose(box.centre, ORIGIN + (12 + i, 2.0, 0.8), atol=1e-6)
        assert (box.class_name, box.size) == ("car", (4.5, 1.9, 1.6))
        assert box.yaw == pytest.approx(0.3)
    (box,) = drive.frames[0].boxes
    assert np.allclose(box.centre, ORIGIN + (12 + 10 * DELAY_S, 2.0, 0.8), atol=1e-4)


def test_a_frame_without_points_is_an_empty_sweep(tmp_path: Path) -> None:
    drive = open_drive(write_segment(tmp_path / "segment", {0: np.ones((4, 3))}))
    assert [len(s.read().positions) for s in drive.sweeps] == [4, 0, 0]


def test_a_hostile_cloud_runs_nothing(tmp_path: Path) -> None:
    target = tmp_path / "written"
    drive = open_drive(write_segment(tmp_path / "segment", {0: Hostile(target)}))
    with pytest.raises(DriveError, match=r"pointcloud\.npz: Not a readable pickle"):
        drive.sweeps[0].read()
    assert not target.exists()


@pytest.mark.parametrize(
    "cloud", [np.zeros((4, 3)), [1, 2], "text", {"a": np.ones((4, 3))}, {0: "text"}, {0: np.ones(3)}]
)
def test_clouds_of_another_kind_are_one_error(tmp_path: Path, cloud: Any) -> None:
    drive = open_drive(write_segment(tmp_path / "segment", cloud))
    with pytest.raises(DriveError, match=r"pointcloud\.npz"):
        drive.sweeps[0].read()


@pytest.mark.parametrize("part", [0.0, 0.5, 0.98])
def test_a_truncated_cloud_is_one_error(tmp_path: Path, part: float) -> None:
    root = write_segment(tmp_path / "segment")
    path = root / "pointcloud.npz"
    path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])
    with pytest.raises(DriveError, match=r"pointcloud\.npz"):
        open_drive(root).sweeps[0].read()


@pytest.mark.parametrize(
    ("name", "text"),
    [("timestamps.json", "[1]"), ("timestamps.json", '{"FRONT": {"a": 1}}'), ("track/track_info.txt", "head\n1 2 3"),
     ("track/track_info.txt", "head\n0 a vehicle x x x x x x x x x"), ("intrinsics/0.txt", "1"),
     ("ego_pose/000000.txt", "1 2")],
)  # fmt: skip
def test_damaged_files_are_one_error_that_names_them(tmp_path: Path, name: str, text: str) -> None:
    root = write_segment(tmp_path / "segment")
    (root / name).write_text(text)
    with pytest.raises(DriveError, match=Path(name).stem):
        open_drive(root)


def test_gaps_are_borne_and_told(tmp_path: Path) -> None:
    root = write_segment(tmp_path / "segment")
    for name in ("ego_pose/000001.txt", "ego_pose/000001_0.txt", "timestamps.json", "track/track_info.txt"):
        (root / name).unlink()
    drive = open_drive(root)
    assert [f.name for f in drive.frames] == ["000000", "000002"]
    assert len(drive.sweeps) == 2
    assert any("1 of 6 photographs have no pose" in n for n in drive.notices)


def test_times_in_milliseconds_are_told_and_converted(tmp_path: Path) -> None:
    root = write_segment(tmp_path / "segment")
    seconds = [f.timestamp for f in open_drive(root).frames]
    file = root / "timestamps.json"
    stamps = {name: {k: 1000 * v for k, v in of.items()} for name, of in json.loads(file.read_text()).items()}
    file.write_text(json.dumps(stamps))
    drive = open_drive(root)
    assert [f.timestamp for f in drive.frames] == pytest.approx(seconds)
    assert "milliseconds and are converted" in drive.notices[-1] and "LiDAR sweeps" in drive.notices[-1]


def test_pictures_of_other_names_are_counted(tmp_path: Path) -> None:
    root = write_segment(tmp_path / "segment")
    (root / "images/000000_7.png").write_bytes(b"")
    assert any("images/: 1 pictures are not named as" in n and "000000_7.png" in n for n in open_drive(root).notices)


def test_a_time_stamp_that_is_no_number_is_named(tmp_path: Path) -> None:
    file = tmp_path / "timestamps.json"
    file.write_text('{"FRAME": {"0": 1e999}}')
    with pytest.raises(DriveError, match="one of them is not finite"):
        _stamps(file)
