"""Waymo Open v2: a written segment is read back to where its points project, however its tables are written."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pytest

from tests.drives.formats import tiny_waymo as tiny
from tests.drives.formats.tiny_waymo import NAME, STAMPS
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.drives import open_drive
from unveil_core.drives.cityscapes import train_id
from unveil_core.drives.drive import Drive, Frame
from unveil_core.drives.formats.waymo.segment import segment_at, vehicle_poses

EVERY_CAMERA = DriveOptions(cameras=("all",))
REAL = Path(os.environ.get("UNVEIL_REAL_DATA", "")) / "waymo_v2"
Content = dict[str, dict[str, Any]]


@pytest.fixture
def content() -> Content:
    return tiny.tables()


@pytest.fixture
def drive(tmp_path: Path, content: Content) -> Drive:
    return open_drive(tiny.write(tmp_path, content), EVERY_CAMERA)


def projected(frame: Frame, points: np.ndarray) -> np.ndarray:
    """(P, 2) pixels of the file on disk, counted from the edge of the first."""
    camera, distortion = frame.camera, frame.distortion
    assert distortion is not None
    k = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    in_camera = points @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
    return cv2.projectPoints(in_camera, np.zeros(3), np.zeros(3), k, np.array(distortion.coefficients))[0][:, 0]


def in_view(frame: Frame, points: np.ndarray) -> np.ndarray:
    depth = points @ frame.camera.world_to_camera[2, :3] + frame.camera.world_to_camera[2, 3]
    return points[depth > 2]


def test_photographs_have_names_times_and_bytes(drive: Drive) -> None:
    assert [(f.camera_name, f.name) for f in drive.frames] == [
        (c, str(s)) for c in ("FRONT", "FRONT_LEFT") for s in STAMPS
    ]
    for number, frame in enumerate(drive.frames):
        camera, i = number // 3 + 1, number % 3
        assert frame.image_bytes is not None and frame.image_bytes() == tiny.photograph(i, camera)
        assert frame.image_path.stem == frame.name and frame.image_path.suffix == ".jpg"
        assert frame.timestamp == pytest.approx(STAMPS[i] / 1e6 + 0.01 * camera, abs=1e-6)
        assert (frame.camera.width, frame.camera.height) == tiny.SIZE
    assert drive.front_cameras == ("FRONT",) and drive.notices == ("2 of 6 photographs are labelled",)
    assert drive.semantic_classes == "cityscapes" and len(drive.sources) == len(tiny.tables())


def test_points_of_the_sweeps_project_where_they_should(drive: Drive) -> None:
    seen = 0
    for i, sweep in enumerate(drive.sweeps):
        assert sweep.timestamp == STAMPS[i] / 1e6
        positions, expected = sweep.read().positions, np.array(tiny.points(i))
        np.testing.assert_allclose(positions, expected, rtol=0, atol=1e-6)
        for number, frame in enumerate(drive.frames):
            camera = number // 3 + 1
            shown = in_view(frame, positions)
            wanted = np.array([tiny.pixel(p, number % 3 + 0.1 * camera, camera) for p in in_view(frame, expected)])
            inside = ((wanted > 0) & (wanted < tiny.SIZE)).all(axis=1)
            seen += int(inside.sum())
            np.testing.assert_allclose(projected(frame, shown)[inside], wanted[inside], rtol=0, atol=0.01)
    assert seen > 50


def test_boxes_stand_in_the_world(drive: Drive) -> None:
    first, second = drive.frames[0].boxes, drive.frames[1].boxes
    assert drive.frames[3].boxes == first == drive.sweeps[0].boxes and drive.frames[2].boxes == ()
    assert {b.class_name for b in first} == {"person", "car"}  # the sign stays
    parked, later = next(b for b in first if b.class_name == "car"), second[0]
    assert parked.id == later.id and parked.size == (4.5, 3.5, 2.5)
    np.testing.assert_allclose(parked.centre, (tiny.vehicle(0) @ [12, 13, 14, 1])[:3])
    assert parked.yaw == pytest.approx(2.0 + 0.3, abs=2e-3)  # but for the vehicle's tilt
    assert later.yaw == pytest.approx(2.02 + 0.28, abs=2e-3)


def test_labels_are_brought_to_cityscapes(drive: Drive) -> None:
    with_labels = [f for f in drive.frames if f.labels is not None]
    assert [(f.camera_name, f.name) for f in with_labels] == [("FRONT", str(s)) for s in STAMPS[1:]]
    first, second = (f.labels() for f in with_labels if f.labels is not None)
    road, car = train_id("road"), train_id("car")
    assert first.semantic[30, 50] == road and first.semantic[12, 12] == first.semantic[12, 32] == car
    assert first.semantic[2, 2] == first.semantic[60, 3] == 255
    assert first.ego is not None and first.ego[50:].all() and not first.ego[:50].any()
    assert first.instance is not None and second.instance is not None
    assert first.instance[12, 12] == second.instance[12, 12] > 0  # one object in both, though its number has no 16 bits
    assert len({first.instance[12, 12], first.instance[12, 32], second.instance[12, 32], 0}) == 4
    assert first.instance[30, 50] == 0


def test_points_are_labelled_where_the_segment_has_labels(drive: Drive) -> None:
    assert drive.sweeps[0].read().classes is None
    classes = drive.sweeps[1].read().classes
    assert classes is not None
    counts = [(tiny.ranges(1, laser, part)[..., 0] > 0).sum() for laser in tiny.LASERS for part in (1, 2)]
    kinds = [train_id("road"), train_id("car"), 255, 255]
    np.testing.assert_array_equal(classes, np.repeat(kinds, counts))


def described(drive: Drive) -> list[Any]:
    found: list[Any] = [
        (
            f.camera_name,
            f.name,
            f.timestamp,
            f.camera.world_to_camera.round(3).tolist(),
            f.image_bytes and f.image_bytes(),
        )
        for f in drive.frames
    ]
    labels = [f.labels() for f in drive.frames if f.labels is not None]
    found += [(x.semantic.tolist(), None if x.instance is None else x.instance.tolist()) for x in labels]
    found += [[(b.id, b.class_name, b.size) for b in f.boxes] for f in drive.frames]
    return found + [np.sort(s.read().positions, axis=0).round(3).tolist() for s in drive.sweeps]


def test_order_of_rows_does_not_matter(tmp_path: Path, content: Content, drive: Drive) -> None:
    other = open_drive(tiny.write(tmp_path / "other/training", content, shuffled=True).parent, EVERY_CAMERA)
    assert described(other) == described(drive)


def test_types_of_columns_do_not_matter(tmp_path: Path, content: Content, drive: Drive) -> None:
    names = {1: "FRONT", 2: "FRONT_LEFT"}
    for component, columns in content.items():
        for name in list(columns):
            if name == "key.camera_name":
                columns[name] = pa.array([names[int(str(v))] for v in columns[name]]).dictionary_encode()
            elif name == "key.segment_context_name":
                columns[name] = pa.array(columns[name]).dictionary_encode()
            elif name == "key.frame_timestamp_micros":
                columns[name] = pa.array(columns[name], pa.timestamp("us", "America/Los_Angeles"))
            elif name.endswith("transform") and component != "vehicle_pose":
                columns[name] = pa.array(columns[name].to_pylist(), pa.list_(pa.float64()))
            elif name.endswith("shape"):
                columns[name] = pa.array(columns[name].to_pylist(), pa.list_(pa.int64()))
            elif name.endswith("range_image_return1.values") and component == "lidar":
                columns[name] = pa.array(columns[name].to_pylist(), pa.list_(pa.float64()))
    assert described(open_drive(tiny.write(tmp_path / "other", content), EVERY_CAMERA)) == described(drive)


def test_rows_of_other_segments_are_left_out(tmp_path: Path, content: Content, drive: Drive) -> None:
    for columns in content.values():
        for name, values in columns.items():
            plain = values.to_pylist() if isinstance(values, pa.Array) else list(values)
            twice = ["another"] * len(plain) + plain if name == "key.segment_context_name" else plain * 2
            if name.endswith("transform"):  # of the other segment something else
                twice[: len(plain)] = [np.eye(4).ravel().tolist()] * len(plain)
            columns[name] = pa.array(twice, values.type if isinstance(values, pa.Array) else None)
    assert described(open_drive(tiny.write(tmp_path / "other", content), EVERY_CAMERA)) == described(drive)


def test_without_an_own_pose_a_photograph_has_the_frames(tmp_path: Path, content: Content) -> None:
    del content["camera_image"]["[CameraImageComponent].pose.transform"]
    del content["camera_image"]["[CameraImageComponent].pose_timestamp"]
    frame = open_drive(tiny.write(tmp_path, content)).frames[2]
    np.testing.assert_allclose(frame.camera.centre, (tiny.vehicle(2) @ tiny.camera_extrinsic(1)[:, 3])[:3])
    assert frame.timestamp == STAMPS[2] / 1e6


@pytest.mark.parametrize(
    ("missing", "said", "counts"),
    [
        ("lidar", "no LiDAR: the table lidar is missing", (6, 0)),
        ("lidar_calibration", "no LiDAR: the table lidar_calibration is missing", (6, 0)),
        ("lidar_pose", "not corrected for the vehicle's motion", (6, 3)),
        ("vehicle_pose", "3 of 3 LiDAR sweeps have no vehicle_pose", (6, 0)),
        ("camera_image", "no images: the table camera_image is missing", (0, 3)),
        ("lidar_box", "2 of 6 photographs are labelled", (6, 3)),
        ("camera_segmentation", "", (6, 3)),
    ],
)
def test_missing_tables_leave_gaps(
    tmp_path: Path, content: Content, missing: str, said: str, counts: tuple[int, int]
) -> None:
    del content[missing]
    drive = open_drive(tiny.write(tmp_path, content), EVERY_CAMERA)
    assert (len(drive.frames), len(drive.sweeps)) == counts
    assert said in " ".join(drive.notices)
    assert all(len(s.read().positions) for s in drive.sweeps)


def test_photographs_without_calibration_are_told(tmp_path: Path, content: Content) -> None:
    calibration = content.pop("camera_calibration")
    with pytest.raises(DriveError, match="has photographs but no camera_calibration"):
        open_drive(tiny.write(tmp_path / "none", content))
    content["camera_calibration"] = {name: values[:1] for name, values in calibration.items()}
    drive = open_drive(tiny.write(tmp_path / "one", content), EVERY_CAMERA)
    assert {f.camera_name for f in drive.frames} == {"FRONT"}
    assert "camera FRONT_LEFT is left out: camera_calibration does not have it" in drive.notices


def test_frames_without_a_pose_are_left_out(tmp_path: Path, content: Content) -> None:
    poses = content["camera_image"]["[CameraImageComponent].pose.transform"]
    content["camera_image"]["[CameraImageComponent].pose.transform"] = pa.array(
        [None] * len(poses), pa.list_(pa.float64())
    )
    content["vehicle_pose"] = {name: values[1:] for name, values in content["vehicle_pose"].items()}
    drive = open_drive(tiny.write(tmp_path, content), EVERY_CAMERA)
    assert len(drive.frames) == 4 and len(drive.sweeps) == 2
    assert "2 photographs have no pose and are left out" in drive.notices


@pytest.mark.parametrize("component", ["vehicle_pose", "camera_image", "lidar_box", "lidar", "camera_segmentation"])
def test_a_table_that_is_cut_short_is_told(tmp_path: Path, content: Content, component: str) -> None:
    path = tiny.write(tmp_path, content) / component / f"{NAME}.parquet"
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(DriveError, match=f"{component}.*Cut short or damaged"):
        open_drive(tmp_path)


def test_numbers_that_make_no_sense_are_told(tmp_path: Path, content: Content) -> None:
    shapes = content["lidar"]["[LiDARComponent].range_image_return1.shape"]
    content["lidar"]["[LiDARComponent].range_image_return1.shape"] = pa.array([[4, 13, 4]] * 6, shapes.type)
    content["camera_image"]["[CameraImageComponent].image"][0] = None
    drive = open_drive(tiny.write(tmp_path / "a", content))
    with pytest.raises(DriveError, match="has a range image of 192 numbers"):
        drive.sweeps[0].read()
    image = drive.frames[0].image_bytes
    with pytest.raises(DriveError, match=f"{STAMPS[0]}.jpg: Empty"):
        assert image is not None and image()
    stretched = np.diag([1.0, 1.0, 1.2, 1.0]).ravel().tolist()
    poses = content["vehicle_pose"]["[VehiclePoseComponent].world_from_vehicle.transform"]
    content["vehicle_pose"]["[VehiclePoseComponent].world_from_vehicle.transform"] = pa.array(
        [stretched] * 3, poses.type
    )
    with pytest.raises(DriveError, match="Not a rotation"):
        open_drive(tiny.write(tmp_path / "b", content))


def test_one_of_several_segments_is_chosen(tmp_path: Path, content: Content) -> None:
    root = tiny.write(tmp_path / "waymo/validation", content).parent
    for component in content:
        path = root / "validation" / component / f"{NAME}.parquet"
        (root / "training" / component).mkdir(parents=True)
        (root / "training" / component / "999_0_1.parquet").write_bytes(path.read_bytes())
    with pytest.raises(DriveError, match=rf"holds 2 drives of Waymo Open v2 \(choose one by --scene: {NAME}, 999_0_1"):
        open_drive(root)
    with pytest.raises(SettingsError, match="has no scene 7"):
        open_drive(root, DriveOptions(scene="7"))
    for scene in (NAME, "999_0_1"):  # a file may have another name than its rows
        assert len(open_drive(root, DriveOptions(scene=scene)).frames) == 3


@pytest.mark.skipif(not REAL.is_dir(), reason="UNVEIL_REAL_DATA names no folder with waymo_v2")
def test_a_real_table_opens() -> None:
    drive = open_drive(REAL)
    assert not drive.frames and "no images: the table camera_image is missing" in drive.notices
    (name,) = [p.stem for p in (REAL / "vehicle_pose").glob("*.parquet")]
    poses = vehicle_poses(segment_at(REAL, name))
    way = np.array([poses[stamp][:3, 3] for stamp in sorted(poses)])
    assert len(poses) == 199 and np.abs(way[0] - (860.5948, 15568.675, -651.441)).max() < 0.01
    assert np.linalg.norm(np.diff(way, axis=0), axis=1).max() < 2.0
