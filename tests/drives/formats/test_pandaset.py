"""PandaSet: a sequence of a few small frames in the release's encoding, what is wrong with others, and the real one."""

from __future__ import annotations

import gzip
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.drives.formats.pandas_pickles import table_pickle
from unveil_core.app.cli import main
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.boxes import TrackedBox
from unveil_core.drives.drive import Drive
from unveil_core.drives.importing.check import check_drive
from unveil_core.drives.importing.whole_drive import import_drive
from unveil_core.drives.moved import moved_ids

REAL = Path(os.environ.get("UNVEIL_REAL_DATA", "/nowhere")) / "pandaset/002"
SIZE = (96, 54)
CAMERAS = ("back_camera", "front_camera")
COUNT = 4
FOCAL, CENTRE = (90.5, 91.25), (47.3, 26.1)
START = 1_557_539_924.5


def vehicle(i: int) -> np.ndarray:
    """World from LiDAR: the world's origin is the first of these."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", 0.02 * i + 0.5).as_matrix()
    pose[:3, 3] = (1.5 * i, 0.3 * i, 0.01 * i)
    return pose


def camera_pose(camera: str, i: int) -> np.ndarray:
    """World from camera: x right, y down, z forward; the LiDAR's y is forward, 1.8 m above the ground."""
    pose = np.eye(4)
    yaw = 0.0 if camera == "front_camera" else np.pi
    forward = np.array([-np.sin(yaw), np.cos(yaw), -0.02])
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = (0.1, 0.6, -0.2)
    return vehicle(i) @ pose


def as_json(pose: np.ndarray) -> dict[str, dict[str, float]]:
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return {
        "position": dict(zip("xyz", pose[:3, 3].tolist(), strict=True)),
        "heading": {"w": w, "x": x, "y": y, "z": z},
    }


def pixel(point: np.ndarray, camera: str, i: int) -> np.ndarray:
    """(2,) as the devkit projects (geometry.projection), counted from the centre of the first pixel."""
    inverse = np.linalg.inv(camera_pose(camera, i))
    k = np.array([[FOCAL[0], 0, CENTRE[0]], [0, FOCAL[1], CENTRE[1]], [0, 0, 1]])
    seen = k @ (inverse @ [*point, 1.0])[:3]
    return seen[:2] / seen[2]


def points(i: int) -> np.ndarray:
    """(P, 3) of a sweep, in the world: ground and a wall along the way."""
    generator = np.random.default_rng(i)
    ground = np.stack([*generator.uniform(-20, 20, (2, 300)), np.full(300, -1.8)], axis=1)
    wall = np.stack([np.full(100, 8.0), generator.uniform(-20, 20, 100), generator.uniform(-1.8, 3, 100)], axis=1)
    return np.concatenate([ground, wall])


CUBOIDS: dict[str, tuple[str, tuple[float, float, float], tuple[float, float, float], float, int, str]] = {
    # uuid: label, centre at frame 0, width, length and height, yaw, sensor, sibling
    "car-front": ("Car", (3.0, 9.0, -1.0), (1.9, 4.5, 1.6), -0.3, 0, "car-front-2"),
    "car-front-2": ("Car", (3.1, 9.1, -1.0), (1.8, 4.4, 1.5), -0.3, 1, "car-front"),
    "moving": ("Pickup Truck", (-4.0, 12.0, -0.9), (2.0, 5.0, 1.8), 0.1, -1, ""),
    "walker": ("Pedestrian", (6.0, 7.0, -0.9), (0.6, 0.5, 1.8), 0.0, -1, ""),
    "cone": ("Cones", (5.0, 5.0, -1.6), (0.3, 0.3, 0.5), 0.0, -1, ""),
}
SHORT = ("car-front-2",)
"""Tracks that end after the first frame."""


def cuboids(i: int) -> dict[str, np.ndarray]:
    names = [n for n in CUBOIDS if n not in SHORT or i == 0]
    rows = [CUBOIDS[n] for n in names]
    step = np.array([[0.0, 1.5 * i * (n == "moving"), 0.0] for n in names])
    centres = np.array([r[1] for r in rows]) + step
    sizes = np.array([r[2] for r in rows])
    table: dict[str, np.ndarray] = {
        "uuid": np.array(names, dtype=object),
        "label": np.array([r[0] for r in rows], dtype=object),
        "yaw": np.array([r[3] for r in rows]),
        "stationary": np.array([n != "moving" for n in names]),
        "camera_used": np.full(len(rows), -1, np.int64),
    }
    for k, axis in enumerate("xyz"):
        table[f"position.{axis}"] = centres[:, k]
    for k, axis in enumerate("xyz"):
        table[f"dimensions.{axis}"] = sizes[:, k]
    table["cuboids.sibling_id"] = np.array([r[5] for r in rows], dtype=object)
    table["cuboids.sensor_id"] = np.array([r[4] for r in rows], np.int64)
    return table


def write_table(path: Path, columns: dict[str, np.ndarray]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    content = table_pickle(columns, release="1.0", protocol=4)
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)


def make_pandaset(root: Path, suffix: str = ".pkl.gz") -> Path:
    """Write the sequence."""
    generator = np.random.default_rng(0)
    for camera in CAMERAS:
        folder = root / "camera" / camera
        folder.mkdir(parents=True)
        for i in range(COUNT):
            cv2.imwrite(str(folder / f"{i:02d}.jpg"), generator.integers(0, 255, (*SIZE[::-1], 3), dtype=np.uint8))
        names = dict(zip(("fx", "fy", "cx", "cy"), (*FOCAL, *CENTRE), strict=True))
        (folder / "intrinsics.json").write_text(json.dumps(names))
        (folder / "poses.json").write_text(json.dumps([as_json(camera_pose(camera, i)) for i in range(COUNT)]))
        (folder / "timestamps.json").write_text(json.dumps([START + 0.1 * i for i in range(COUNT)]))
    lidar = root / "lidar"
    for i in range(COUNT):
        xyz = points(i)
        columns = {axis: xyz[:, k] for k, axis in enumerate("xyz")}
        columns |= {"i": np.full(len(xyz), 12.0), "t": np.full(len(xyz), START), "d": np.zeros(len(xyz), np.int64)}
        write_table(lidar / f"{i:02d}{suffix}", columns)
        write_table(root / f"annotations/cuboids/{i:02d}{suffix}", cuboids(i))
        classes = np.where(np.arange(len(xyz)) < 300, 7, 41)
        write_table(root / f"annotations/semseg/{i:02d}{suffix}", {"class": classes})
    (lidar / "poses.json").write_text(json.dumps([as_json(vehicle(i)) for i in range(COUNT)]))
    (lidar / "timestamps.json").write_text(json.dumps([START + 0.05 + 0.1 * i for i in range(COUNT)]))
    return root


@pytest.fixture
def sequence(tmp_path: Path) -> Path:
    return make_pandaset(tmp_path / "pandaset" / "002")


def everything(path: Path) -> Drive:
    return open_drive(path, DriveOptions(cameras=("all",)))


@pytest.mark.parametrize("suffix", [".pkl", ".pkl.gz"])
def test_known_points_lie_where_the_devkit_projects_them(suffix: str, tmp_path: Path) -> None:
    drive = everything(make_pandaset(tmp_path / "002", suffix))
    assert [f.camera_name for f in drive.frames] == ["back_camera"] * COUNT + ["front_camera"] * COUNT
    worst, seen = 0.0, 0
    for frame in drive.frames:
        i = int(frame.name)
        assert frame.timestamp == START + 0.1 * i
        found = drive.sweeps[i].read()
        assert np.array_equal(found.positions, points(i))
        pixels, depth = frame.camera.project(found.positions)
        inside = frame.camera.in_picture(pixels, depth, nearest=0.5)
        wanted = np.array([pixel(p, frame.camera_name, i) for p in points(i)[inside]])
        # Our pixels are counted from the corner of the first.
        worst = max(worst, float(np.abs(pixels[inside] - 0.5 - wanted).max()))
        seen += int(inside.sum())
    assert worst < 0.01 and seen > 100


def test_only_the_front_is_read_unless_others_are_asked_for(sequence: Path) -> None:
    assert {f.camera_name for f in open_drive(sequence).frames} == {"front_camera"}


def test_one_of_several_sequences_is_named(sequence: Path) -> None:
    assert len(open_drive(sequence.parent).frames) == COUNT
    make_pandaset(sequence.parent / "011")
    with pytest.raises(DriveError, match=r"2 drives of PandaSet.*--scene: 002, 011"):
        open_drive(sequence.parent)
    assert open_drive(sequence.parent, DriveOptions(scene="011")).root.name == "011"


def test_points_have_their_classes(sequence: Path) -> None:
    found = open_drive(sequence).sweeps[1].read()
    assert found.classes is not None
    assert np.bincount(found.classes).tolist() == [300, 0, 100]  # road and building


def test_boxes_lie_as_annotated_and_siblings_once(sequence: Path) -> None:
    drive = open_drive(sequence)
    assert all(len(f.boxes) == 3 for f in drive.frames), "a car, a pickup truck, a person; no cone, no sibling"
    boxes = {round(b.centre[0], 1): b for b in drive.frames[0].boxes}
    assert set(boxes) == {3.0, -4.0, 6.0}  # of the siblings, that whose track lasts
    car = boxes[3.0]
    assert car.size == (4.5, 1.9, 1.6)
    # The devkit turns a box of width along x and length along y by its yaw.
    width, length, height = CUBOIDS["car-front"][2]
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) / 2
    turn = Rotation.from_euler("z", CUBOIDS["car-front"][3]).as_matrix()
    corners = signs * (width, length, height) @ turn.T + CUBOIDS["car-front"][1]
    assert np.allclose(sorted(map(tuple, np.round(car.corners(), 6))), sorted(map(tuple, np.round(corners, 6))))
    ids = {b.id for f in drive.frames for b in f.boxes}
    assert len(ids) == 3 and moved_ids(drive) == {boxes[-4.0].id}
    assert [s.boxes for s in drive.sweeps] == [f.boxes for f in drive.frames]


def test_sweeps_and_labels_that_are_missing_are_borne_with_a_notice(sequence: Path) -> None:
    for i in (0, 2):
        (sequence / f"lidar/{i:02d}.pkl.gz").unlink()
    (sequence / "annotations/semseg/03.pkl.gz").unlink()
    drive = open_drive(sequence)
    assert drive.notices == ("2 of 4 LiDAR sweeps are there",)
    assert [s.timestamp for s in drive.sweeps] == [START + 0.05 + 0.1 * i for i in (1, 3)]
    assert [s.read().classes is None for s in drive.sweeps] == [False, True]


def test_frames_that_a_camera_lacks_are_borne(sequence: Path) -> None:
    (sequence / "camera/front_camera/01.jpg").unlink()
    (sequence / "camera/front_camera/03.jpg").unlink()
    drive = everything(sequence)
    assert [f.name for f in drive.frames if f.camera_name == "front_camera"] == ["00", "02"]
    assert len([f for f in drive.frames if f.camera_name == "back_camera"]) == COUNT
    assert "2 of 4 photographs of front_camera are there" in drive.notices
    # Cameras of a rig give the same moments.
    found = open_drive(sequence, DriveOptions(cameras=("all",), frames="1:3"))
    assert [(f.camera_name, f.name) for f in found.frames] == [
        ("back_camera", "01"), ("back_camera", "02"), ("front_camera", "02"),
    ]  # fmt: skip


def test_annotations_may_be_missing(sequence: Path) -> None:
    for path in sorted((sequence / "annotations").rglob("*"), reverse=True):
        path.unlink() if path.is_file() else path.rmdir()
    (sequence / "annotations").rmdir()
    drive = open_drive(sequence)
    assert not any(f.boxes for f in drive.frames) and drive.sweeps[0].read().classes is None
    assert drive.notices == ("the sequence has no boxes of objects: annotations/cuboids holds none",)


def test_cameras_and_pictures_that_are_not_read_are_told(sequence: Path) -> None:
    (sequence / "camera/back_camera/intrinsics.json").unlink()
    (sequence / "camera/front_camera/preview.jpg").write_bytes(b"")
    assert open_drive(sequence).notices == (
        "camera back_camera is left out: it has no intrinsics.json",
        "front_camera/ holds 5 pictures, frames are named by numbers as 4 of them: 1 are not read, the first preview.jpg",
    )


def test_time_stamps_out_of_order_are_told_and_frames_come_by_time(sequence: Path) -> None:
    stamps = [START + t for t in (0.0, 0.3, 0.1, 0.2)]
    (sequence / "camera/front_camera/timestamps.json").write_text(json.dumps(stamps))
    drive = open_drive(sequence)
    assert [f.name for f in drive.frames] == ["00", "02", "03", "01"]
    assert any("front_camera" in n and "by time" in n for n in drive.notices)


def test_the_ego_vehicle_is_told(sequence: Path, tmp_path: Path) -> None:
    done = import_drive(everything(sequence), tmp_path / "ws/drive")
    rows = {f.camera_name: f.ego_rows for f in everything(sequence).frames}
    assert rows == {"back_camera": round(250 * 54 / 1080), "front_camera": 0}
    assert all((f.ego_path is not None) == (f.camera_name == "back_camera") for f in done.frames)


# --------------------------------------------------------------------------------------------------------------- what is wrong


def halved(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def changed(name: str, change: Callable[[Any], Any]) -> Callable[[Path], None]:
    def do(root: Path) -> None:
        path = root / name
        path.write_text(json.dumps(change(json.loads(path.read_text()))))

    return do


def smaller(root: Path) -> None:
    path = root / "camera/front_camera/02.jpg"
    cv2.imwrite(str(path), np.zeros((20, 30, 3), np.uint8))


FRONT = "camera/front_camera"
WRONG: dict[str, tuple[Callable[[Path], object], str]] = {
    "a sweep cut short": (lambda r: halved(r / "lidar/01.pkl.gz"), r"lidar/01\.pkl\.gz.*Cut short"),
    "cuboids cut short": (lambda r: halved(r / "annotations/cuboids/02.pkl.gz"), r"cuboids/02\.pkl\.gz.*Cut short"),
    "labels cut short": (lambda r: halved(r / "annotations/semseg/02.pkl.gz"), r"semseg/02\.pkl\.gz.*Cut short"),
    "an empty sweep file": (lambda r: (r / "lidar/01.pkl.gz").write_bytes(b""), r"lidar/01\.pkl\.gz"),
    "labels of another sweep": (
        lambda r: write_table(r / "annotations/semseg/01.pkl.gz", {"class": np.zeros(3, np.int64)}),
        r"semseg/01\.pkl\.gz.*labels 3 points, the sweep has 400",
    ),
    "a sweep without z": (
        lambda r: write_table(r / "lidar/01.pkl.gz", {"x": np.zeros(3), "y": np.zeros(3)}),
        r"lidar/01\.pkl\.gz.*Not a sweep",
    ),
    "cuboids without a column": (
        lambda r: write_table(r / "annotations/cuboids/01.pkl.gz", {"uuid": np.array(["a"], dtype=object)}),
        r"cuboids/01\.pkl\.gz.*lacks the column label",
    ),
    "a JPEG of no bytes": (lambda r: (r / FRONT / "01.jpg").write_bytes(b""), r"01\.jpg.*Empty"),
    "a JPEG cut short": (lambda r: halved(r / FRONT / "01.jpg"), r"01\.jpg"),
    "no time stamps": (lambda r: (r / FRONT / "timestamps.json").unlink(), r"timestamps\.json"),
    "no poses": (lambda r: (r / FRONT / "poses.json").unlink(), r"poses\.json"),
    "intrinsics cut short": (lambda r: halved(r / FRONT / "intrinsics.json"), r"intrinsics\.json"),
    "intrinsics of zero": (changed(f"{FRONT}/intrinsics.json", lambda k: {**k, "fx": 0}), r"intrinsics\.json"),
    "intrinsics without cx": (changed(f"{FRONT}/intrinsics.json", lambda k: {"fx": 1, "fy": 1}), r"intrinsics.*cx"),
    "fewer poses than frames": (changed(f"{FRONT}/poses.json", lambda p: p[:2]), r"poses\.json.*frame 02"),
    "a pose of NaN": (
        changed(f"{FRONT}/poses.json", lambda p: [*p[:3], {**p[3], "position": {"x": float("nan"), "y": 0, "z": 0}}]),
        r"poses\.json.*frame 03",
    ),
    "a heading of zero": (
        changed(f"{FRONT}/poses.json", lambda p: [{**p[0], "heading": dict.fromkeys("wxyz", 0)}, *p[1:]]),
        r"poses\.json.*frame 00",
    ),
    "poses that are a dict": (changed(f"{FRONT}/poses.json", lambda p: {"poses": p}), r"poses\.json.*Not a list"),
    "time stamps of text": (changed(f"{FRONT}/timestamps.json", lambda t: ["soon"] * 4), r"timestamps\.json"),
    "a time stamp of infinity": (
        changed(f"{FRONT}/timestamps.json", lambda t: [*t[:3], float("inf")]),
        r"timestamps\.json.*not finite",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_is_one_line_and_exit_code_2(
    what: str, sequence: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change, message = WRONG[what]
    change(sequence)
    workspace = tmp_path / "ws"
    assert main(["run", str(sequence), "-o", str(workspace), "--quality", "draft"]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if "error" in line]
    assert len({line.split("error: ")[-1].strip() for line in said}) == 1 and re.search(message, said[-1]), said
    assert "Traceback" not in " ".join(said) and not workspace.exists()


def test_pictures_of_several_sizes_have_cameras_of_their_own(sequence: Path) -> None:
    smaller(sequence)
    drive = open_drive(sequence)
    assert [(f.camera.width, f.camera.height) for f in drive.frames] == [SIZE, SIZE, (30, 20), SIZE]
    check_drive(drive)


# -------------------------------------------------------------------------------------------------------------------- real


@pytest.mark.skipif(not REAL.is_dir(), reason="UNVEIL_REAL_DATA names no folder with pandaset/002")
def test_the_real_sequence_fits_together(tmp_path: Path) -> None:
    """Points in boxes of cars are labelled car, and those of the ground lie below the cameras."""
    drive = everything(REAL)
    assert {f.camera_name for f in drive.frames} == {"front_camera", "front_left_camera"} and len(drive.frames) == 160
    assert all((f.camera.width, f.camera.height) == (1920, 1080) for f in drive.frames)
    assert drive.notices == ("9 of 80 LiDAR sweeps are there",)
    stamps = [f.timestamp for f in drive.frames[:80]]
    assert np.diff(stamps).min() > 0.09 and np.diff(stamps).max() < 0.11  # type: ignore[arg-type]
    cars, hits = 0, 0
    for sweep in drive.sweeps:
        found = sweep.read()
        assert found.classes is not None and len(found.positions) > 100_000
        for box in sweep.boxes:
            if box.class_name == "car":
                own = inside(box, found.positions)
                cars += int(own.sum())
                hits += int((found.classes[own] == 13).sum())
    assert cars > 5000 and hits > 0.9 * cars
    assert len(moved_ids(drive)) > 3


def inside(box: TrackedBox, positions: np.ndarray) -> np.ndarray:
    local = box.local(positions)
    return (np.abs(local[:, :2]) < 0.9).all(axis=1) & (np.abs(local[:, 2]) < 0.7)
