"""Argoverse 2: a written log is read back to where its points project, and a real one gives its own counts."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray
from pyarrow import feather
from scipy.spatial.transform import Rotation

from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.drive import Drive
from unveil_core.drives.formats.tables import read_columns
from unveil_core.drives.importing.check import check_drive

EVERY_CAMERA = DriveOptions(cameras=("all",))
REAL = Path(os.environ.get("UNVEIL_REAL_DATA", "")) / "argoverse2"
START = 315_966_253_660_357_000
SWEEPS = [START, START + 100_000_000]
IMAGES = [START + 20_000_000, START + 60_000_000]
CAMERAS = {"ring_front_center": (31, 41), "ring_side_left": (41, 31)}
POINTS = np.array([[12.5, 1.25, 0.5], [20.0, -4.0, 2.0], [8.25, 0.5, -0.25], [-30.0, 5.0, 1.0]])
"""In the vehicle; all of them are half floats exactly."""
Content = dict[str, dict[str, Any]]


def vehicle(stamp: int) -> NDArray[np.float64]:
    """City from vehicle: 10 m/s and a turn of 0.2 rad/s, tilted a little."""
    seconds = (stamp - START) / 1e9
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", (0.01, -0.02, 2.9 + 0.2 * seconds)).as_matrix()
    pose[:3, 3] = (5172.668 - 10 * seconds, 2419.1028 + seconds, 66.93)
    return pose


def extrinsic(camera: str) -> NDArray[np.float64]:
    """Vehicle from camera: forward, and to the left for the other."""
    pose = np.eye(4)
    pose[:3, :3] = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    pose[:3, :3] = Rotation.from_euler("z", 0.0 if "front" in camera else 1.5).as_matrix() @ pose[:3, :3]
    pose[:3, 3] = (1.635, 0.003, 1.398)
    return pose


def se3(poses: list[NDArray[np.float64]]) -> dict[str, list[float]]:
    x, y, z, w = Rotation.from_matrix([p[:3, :3] for p in poses]).as_quat().T
    t = np.array([p[:3, 3] for p in poses]).T
    names = ("qw", "qx", "qy", "qz", "tx_m", "ty_m", "tz_m")
    return {n: v.tolist() for n, v in zip(names, (w, x, y, z, *t), strict=True)}


@pytest.fixture
def content() -> Content:
    stamps = sorted([*SWEEPS, *IMAGES, START - 5_000_000, START + 105_000_000])
    names = list(CAMERAS)
    boxes = [np.eye(4) for _ in range(3)]
    boxes[0][:3, 3] = (12.0, 1.0, 0.5)
    boxes[1][:3, 3] = (13.0, 1.0, 0.5)  # a second later, seen from a vehicle that went on
    boxes[1][:3, :3] = Rotation.from_euler("z", 0.1).as_matrix()
    boxes[2][:3, 3] = (5.0, 5.0, 0.0)
    return {
        "city_SE3_egovehicle": {"timestamp_ns": stamps, **se3([vehicle(t) for t in stamps])},
        "calibration/egovehicle_SE3_sensor": {
            "sensor_name": [*names, "up_lidar"],
            **se3([*(extrinsic(n) for n in names), np.eye(4)]),
        },
        "calibration/intrinsics": {
            "sensor_name": names,
            "fx_px": [40.0, 41.0],
            "fy_px": [40.0, 41.0],
            "cx_px": [15.2, 20.4],
            "cy_px": [20.3, 14.9],
            "k1": [-0.24] * 2,
            "k2": [-0.21] * 2,
            "k3": [0.33] * 2,
            "height_px": pa.array([CAMERAS[n][1] for n in names], pa.uint16()),
            "width_px": pa.array([CAMERAS[n][0] for n in names], pa.uint16()),
        },
        "annotations": {
            "timestamp_ns": [SWEEPS[0], SWEEPS[1], SWEEPS[0]],
            "track_uuid": ["car", "car", "cone"],
            "category": ["REGULAR_VEHICLE", "REGULAR_VEHICLE", "CONSTRUCTION_CONE"],
            "length_m": [4.5] * 3,
            "width_m": [2.0] * 3,
            "height_m": [1.5] * 3,
            **se3(boxes),
            "num_interior_pts": [3, 2, 1],
        },
        **{
            f"sensors/lidar/{stamp}": {
                **{a: pa.array(POINTS[:, k].astype(np.float16)) for k, a in enumerate("xyz")},
                "intensity": pa.array([10] * len(POINTS), pa.uint8()),
                "offset_ns": pa.array([0] * len(POINTS), pa.int32()),
            }
            for stamp in SWEEPS
        },
    }


def write(root: Path, content: Content, *, shuffled: bool = False) -> Path:
    for number, (name, columns) in enumerate(content.items()):
        table = pa.table(columns)
        if shuffled:
            table = table.take(np.random.default_rng(number).permutation(table.num_rows))
        path = root / f"{name}.feather"
        path.parent.mkdir(parents=True, exist_ok=True)
        feather.write_feather(table, str(path), compression="zstd")
    for camera, (width, height) in CAMERAS.items():
        for stamp in IMAGES:
            path = root / f"sensors/cameras/{camera}/{stamp}.jpg"
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), np.full((height, width, 3), 99, np.uint8))
    return root


@pytest.fixture
def drive(tmp_path: Path, content: Content) -> Drive:
    return open_drive(write(tmp_path, content), EVERY_CAMERA)


def test_photographs_have_names_times_and_sizes(drive: Drive) -> None:
    assert [(f.camera_name, f.name) for f in drive.frames] == [(c, str(t)) for c in CAMERAS for t in IMAGES]
    assert [f.timestamp for f in drive.frames] == [t / 1e9 for t in IMAGES] * 2
    for frame in drive.frames:
        assert (frame.camera.width, frame.camera.height) == CAMERAS[frame.camera_name]
        assert frame.distortion is None and frame.image_path.is_file()
        assert frame.ego_rows == (5 if frame.camera_name == "ring_front_center" else 0)  # 250 of 2048 rows
    assert drive.front_cameras == ("ring_front_center",) and drive.notices == () and len(drive.sources) == 4


def test_points_of_the_sweeps_project_where_they_should(drive: Drive) -> None:
    seen = 0
    for stamp, sweep in zip(SWEEPS, drive.sweeps, strict=True):
        positions = sweep.read().positions
        assert positions.dtype == np.float64 and sweep.timestamp == stamp / 1e9
        for number, frame in enumerate(drive.frames):
            to_camera = np.linalg.inv(vehicle(IMAGES[number % 2]) @ extrinsic(frame.camera_name)) @ vehicle(stamp)
            f, c = (40.0, (15.2, 20.3)) if number < 2 else (41.0, (20.4, 14.9))
            for point, found in zip(POINTS, positions, strict=True):
                x, y, z, _ = to_camera @ [*point, 1.0]
                if z < 1:
                    continue
                seen += 1
                # A calibration counts from the centre of the first pixel, a Camera from its edge.
                wanted = (f * x / z + c[0] + 0.5, f * y / z + c[1] + 0.5)
                camera = frame.camera
                u, v, w = camera.world_to_camera[:3, :3] @ found + camera.world_to_camera[:3, 3]
                shown = (camera.fx * u / w + camera.cx, camera.fy * v / w + camera.cy)
                np.testing.assert_allclose(shown, wanted, rtol=0, atol=0.01)
    assert seen > 10


def test_boxes_are_interpolated_at_the_photographs(drive: Drive) -> None:
    (first,), (second,) = (s.boxes for s in drive.sweeps)  # the cone stays in the street
    np.testing.assert_allclose(first.centre, (vehicle(SWEEPS[0]) @ [12, 1, 0.5, 1])[:3])
    np.testing.assert_allclose(second.centre, (vehicle(SWEEPS[1]) @ [13, 1, 0.5, 1])[:3])
    assert first.yaw == pytest.approx(2.9, abs=1e-3) and second.yaw == pytest.approx(3.02, abs=1e-3)
    (shown,) = drive.frames[0].boxes
    assert shown.class_name == "car" and shown.id == first.id == second.id
    assert shown.size == pytest.approx((4.5, 2.0, 1.5))
    wanted = 0.8 * np.array(first.centre) + 0.2 * np.array(second.centre)
    np.testing.assert_allclose(shown.centre, wanted, atol=1e-5)
    assert shown.yaw == pytest.approx(0.8 * first.yaw + 0.2 * second.yaw, abs=1e-6)


def described(drive: Drive) -> list[Any]:
    return [
        *((f.name, f.camera.world_to_camera.tolist(), f.boxes) for f in drive.frames),
        *((np.sort(s.read().positions, axis=0).tolist(), s.boxes) for s in drive.sweeps),
        drive.notices,
    ]


def test_order_of_rows_and_types_do_not_matter(tmp_path: Path, content: Content, drive: Drive) -> None:
    content["city_SE3_egovehicle"]["timestamp_ns"] = pa.array(
        content["city_SE3_egovehicle"]["timestamp_ns"], pa.timestamp("ns", "Europe/Berlin")
    )
    content["annotations"]["category"] = pa.array(content["annotations"]["category"]).dictionary_encode()
    content["calibration/intrinsics"]["width_px"] = content["calibration/intrinsics"]["width_px"].cast(pa.float64())
    other = write(tmp_path / "logs/train/7fab2350", content, shuffled=True)
    assert described(open_drive(other, EVERY_CAMERA)) == described(drive)
    for above in (other.parent, other.parent.parent):
        assert described(open_drive(above, DriveOptions("7fab2350", ("all",)))) == described(drive)


def test_poses_that_are_missing_are_interpolated(tmp_path: Path, content: Content) -> None:
    gone = content["city_SE3_egovehicle"]["timestamp_ns"].index(IMAGES[0])
    for values in content["city_SE3_egovehicle"].values():
        del values[gone]
    # One quaternion the other way round is the same rotation.
    for name in ("qw", "qx", "qy", "qz"):
        content["city_SE3_egovehicle"][name][1] *= -1
    drive = open_drive(write(tmp_path, content), EVERY_CAMERA)
    assert drive.notices == ("2 poses are interpolated: city_SE3_egovehicle.feather lacks their stamps",)
    wanted = vehicle(IMAGES[0]) @ extrinsic("ring_front_center")
    np.testing.assert_allclose(drive.frames[0].camera.camera_to_world, wanted, atol=1e-4)


def test_photographs_beyond_the_poses_are_left_out(tmp_path: Path, content: Content) -> None:
    write(tmp_path, content)
    camera = tmp_path / "sensors/cameras/ring_front_center"
    (camera / f"{IMAGES[0]}.jpg").rename(camera / f"{START + 10**10}.jpg")
    drive = open_drive(tmp_path)
    assert [f.name for f in drive.frames] == [str(IMAGES[1])]
    assert "1 photographs have no pose and are left out" in drive.notices


def test_a_camera_without_calibration_is_left_out(tmp_path: Path, content: Content) -> None:
    for name, values in content["calibration/intrinsics"].items():
        content["calibration/intrinsics"][name] = values[:1]
    drive = open_drive(write(tmp_path, content), EVERY_CAMERA)
    assert {f.camera_name for f in drive.frames} == {"ring_front_center"}
    assert "camera ring_side_left is left out: the calibration does not have it" in drive.notices


def test_what_is_missing_is_told(tmp_path: Path, content: Content) -> None:
    write(tmp_path, content)
    (tmp_path / "annotations.feather").unlink()
    for file in (tmp_path / "sensors/lidar").iterdir():
        file.unlink()
    drive = open_drive(tmp_path)
    assert drive.notices == (
        "no boxes of objects: annotations.feather is missing",
        "no LiDAR: sensors/lidar has no sweeps",
    )
    assert not drive.sweeps and not drive.frames[0].boxes
    (tmp_path / "calibration/intrinsics.feather").unlink()
    with pytest.raises(DriveError, match="intrinsics.feather: Not found"):
        open_drive(tmp_path)


def test_a_log_without_photographs_opens_and_is_not_imported(tmp_path: Path, content: Content) -> None:
    write(tmp_path, content)
    (tmp_path / "sensors/cameras").rename(tmp_path / "elsewhere")
    drive = open_drive(tmp_path)
    assert not drive.frames and len(drive.sweeps) == 2 and len(drive.sweeps[0].boxes) == 1
    with pytest.raises(DriveError, match=r"has no frames \(no images: sensors/cameras has none\)"):
        check_drive(drive)


@pytest.mark.parametrize("name", ["city_SE3_egovehicle", "annotations", "calibration/intrinsics"])
def test_a_table_that_is_cut_short_is_told(tmp_path: Path, content: Content, name: str) -> None:
    path = write(tmp_path, content) / f"{name}.feather"
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(DriveError, match=f"{name}.feather: Cut short or damaged"):
        open_drive(tmp_path)


def test_a_damaged_sweep_is_told_when_it_is_read(tmp_path: Path, content: Content) -> None:
    path = write(tmp_path, content) / f"sensors/lidar/{SWEEPS[1]}.feather"
    path.write_bytes(path.read_bytes()[:100])
    drive = open_drive(tmp_path)
    drive.sweeps[0].read()
    with pytest.raises(DriveError, match=f"{SWEEPS[1]}.feather: Cut short or damaged"):
        drive.sweeps[1].read()


@pytest.mark.skipif(not REAL.is_dir(), reason="UNVEIL_REAL_DATA names no folder with argoverse2")
def test_boxes_of_a_real_log_hold_as_many_points_as_it_says() -> None:
    drive = open_drive(REAL)
    assert drive.notices == ("no images: sensors/cameras has none",) and len(drive.sweeps) == 2
    table = read_columns(
        drive.root / "annotations.feather", ("timestamp_ns", "category", "num_interior_pts", "length_m")
    )
    for sweep in drive.sweeps:
        stamps, categories = table.integers("timestamp_ns", "ns"), table.words("category")
        kept = {"BOLLARD", "SIGN", "STOP_SIGN", "CONSTRUCTION_CONE", "CONSTRUCTION_BARREL"}
        rows = [i for i in np.nonzero(stamps == int(sweep.path.stem))[0] if categories[i] not in kept]
        counts = sorted(zip(table.numbers("length_m")[rows], table.integers("num_interior_pts")[rows], strict=True))
        points = sweep.read().positions
        found = sorted((b.size[0], int((np.abs(b.local(points)) <= 1).all(axis=1).sum())) for b in sweep.boxes)
        assert [length for length, _ in found] == pytest.approx([length for length, _ in counts]) and len(found) > 50
        # A box is upright in the city, so of a tilted one some points by the ground are taken or lost.
        differences = [abs(a - b) for (_, a), (_, b) in zip(found, counts, strict=True)]
        assert sum(differences) < 0.04 * sum(n for _, n in counts)
