"""KITTI odometry and SemanticKITTI: a tiny sequence in the released encoding, and what may be wrong with one."""

from __future__ import annotations

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
from unveil_core.drives.cityscapes import CITYSCAPES
from unveil_core.drives.selecting import DriveOptions

P0 = np.array([[71.8, 0, 30.7, 0], [0, 71.8, 8.5, 0], [0, 0, 1, 0]])
P2 = np.array([[71.8, 0, 30.7, 4.538225], [0, 71.8, 8.5, -0.1130887], [0, 0, 1, 0.003779761]])
AXES = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
TR = rigid(rotation(0.01, -0.02, 0.015) @ AXES, (-0.012, -0.054, -0.292))


def pose(i: int) -> np.ndarray:
    """Of camera 0 at frame i, in its axes at the first: ahead is z."""
    return rigid(rotation(y=0.02 * i, x=0.003 * i), (0.1 * i, -0.02 * i, 1.1 * i))


def points() -> np.ndarray:
    return np.random.default_rng(0).uniform((6, -4, -2), (30, 4, 2), (40, 3)).astype("<f4").astype(np.float64)


def write_sequence(root: Path, name: str = "00", frames: int = 3) -> Path:
    folder = root / "sequences" / name
    text = "".join(f"P{k}: {numbers(P2 if k == 2 else P0)}\n" for k in range(4)) + f"Tr: {numbers(TR[:3])}\n"
    write_text(folder / "calib.txt", text)
    write_text(folder / "times.txt", "\n".join(f"{0.1037 * i:e}" for i in range(frames)))
    write_text(root / "poses" / f"{name}.txt", "\n".join(numbers(pose(i)[:3]) for i in range(frames)))
    for i in range(frames):
        for camera in ("image_0", "image_2"):
            write_picture(folder / camera / f"{i:06d}.png")
        write_sweep(folder / f"velodyne/{i:06d}.bin", points())
    return folder


def test_cameras_see_points_where_the_calibration_says(tmp_path: Path) -> None:
    drive = open_drive(write_sequence(tmp_path), DriveOptions(cameras=("all",)))
    assert [f.camera_name for f in drive.frames] == ["image_2"] * 3 + ["image_0"] * 3
    assert drive.front_cameras == ("image_2",) and not drive.notices
    for frame in drive.frames:
        found = drive.sweeps[int(frame.name)].read().positions
        matrix = P2 if frame.camera_name == "image_2" else P0
        assert np.abs(seen_at(frame, found) - projected(matrix, apply(TR, points()))).max() < 0.01
        assert frame.timestamp == pytest.approx(0.1037 * int(frame.name))


def test_the_drive_is_turned_to_z_up_and_back(tmp_path: Path) -> None:
    drive = open_drive(write_sequence(tmp_path))
    for i, frame in enumerate(drive.frames):
        assert frame.camera.world_to_camera[1, 2] < -0.99  # the picture's down is the drive's down
        in_file = apply(pose(i) @ TR, points())
        assert np.abs(drive.to_world.to_world(drive.sweeps[i].read().positions) - in_file).max() < 1e-9
    assert drive.frames[2].camera.centre[0] == pytest.approx(2.2, abs=0.1)
    again = drive.to_world.camera_to_world(drive.frames[1].camera)
    shift = np.linalg.solve(P2[:, :3], P2[:, 3])
    assert np.abs(again.world_to_camera - rigid(np.eye(3), shift) @ np.linalg.inv(pose(1))).max() < 1e-9


def test_labels_of_points_are_train_ids(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path)
    labels = np.zeros(40, "<u4")
    labels[:8] = [40, 10, 252, 253, 72, 52, 259, 48]
    labels += np.uint32(7 << 16)
    (folder / "labels").mkdir()
    labels.tofile(folder / "labels/000001.label")
    sweeps = open_drive(folder).sweeps
    assert sweeps[0].read().classes is None
    found = sweeps[1].read().classes
    assert found is not None
    names = [CITYSCAPES[c] if c < 19 else None for c in found[:9]]
    assert names == ["road", "car", "car", "rider", "terrain", None, "truck", "sidewalk", None]
    labels[:-1].tofile(folder / "labels/000001.label")
    with pytest.raises(DriveError, match="labels 39 points, the sweep has 40"):
        sweeps[1].read()


def test_the_data_set_holds_sequences_by_name(tmp_path: Path) -> None:
    write_sequence(tmp_path / "dataset", "00")
    write_sequence(tmp_path / "dataset", "07", 2)
    for path in (tmp_path, tmp_path / "dataset", tmp_path / "dataset/sequences"):
        assert len(open_drive(path, DriveOptions(scene="07")).frames) == 2
    with pytest.raises(DriveError, match="holds 2 drives of KITTI odometry .choose one by --scene: 00, 07"):
        open_drive(tmp_path)


def test_sequences_without_poses_say_so_and_take_those_beside_them(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path, "11")
    there = tmp_path / "poses/11.txt"
    there.rename(folder / "poses.txt")
    assert len(open_drive(folder).frames) == 3
    (folder / "poses.txt").unlink()
    with pytest.raises(DriveError, match="sequence 11 has no poses .KITTI gives them for sequences 00 to 10"):
        open_drive(folder)


def test_gaps_are_borne(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path, frames=5)
    lines = (tmp_path / "poses/00.txt").read_text().splitlines()
    lines[1] = " ".join(["nan"] * 12)
    write_text(tmp_path / "poses/00.txt", "\n".join(lines[:4]))
    (folder / "velodyne/000002.bin").unlink()
    (folder / "image_2/000003.png").unlink()
    write_text(folder / "times.txt", "0\n0.1\nnan")
    drive = open_drive(folder)
    assert [f.name for f in drive.frames] == ["000000", "000002"]
    assert [f.timestamp for f in drive.frames] == [0.0, None]
    assert [s.path.stem for s in drive.sweeps] == ["000000", "000003"]
    assert [n.split(":")[0] for n in drive.notices] == ["poses", "image_2", "image_0", "velodyne", "velodyne"]
    write_text(tmp_path / "poses/00.txt", "nan " * 12)
    with pytest.raises(DriveError, match="holds no pose"):
        open_drive(folder)


def test_damaged_files_say_so(tmp_path: Path) -> None:
    folder = write_sequence(tmp_path)
    whole = (folder / "calib.txt").read_text()
    write_text(folder / "calib.txt", whole[: whole.index("Tr")])
    with pytest.raises(DriveError, match="lacks the key Tr"):
        open_drive(folder)
    write_text(folder / "calib.txt", whole.replace("P2: 7", "P2: -7"))
    with pytest.raises(DriveError, match="makes no camera"):
        open_drive(folder)
    write_text(folder / "calib.txt", whole)
    write_text(folder / "times.txt", "soon\n")
    with pytest.raises(DriveError, match="Not numbers in a line"):
        open_drive(folder)
    write_text(folder / "times.txt", "0 0.1")
    (folder / "image_2/000000.png").write_bytes(b"")
    with pytest.raises(DriveError, match="Empty"):
        open_drive(folder)
