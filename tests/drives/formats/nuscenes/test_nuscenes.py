"""nuScenes: points, boxes and cameras lie where an independent computation puts them; gaps and damage are told."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.drives.formats.nuscenes.tiny_nuscenes import (
    START_US,
    K,
    car_centre,
    ego_from_sensor,
    ego_pose,
    global_points,
    make_nuscenes,
)
from unveil_core.base.drive_options import DriveOptions
from unveil_core.base.errors import DriveError, SettingsError
from unveil_core.drives import open_drive
from unveil_core.drives.cityscapes import train_id
from unveil_core.drives.formats.nuscenes import tables

SCENE = "scene-0061"


def options(**chosen: object) -> DriveOptions:
    return DriveOptions(scene=SCENE, **chosen)  # type: ignore[arg-type]


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return make_nuscenes(tmp_path / "nuscenes")


def edit(root: Path, table: str, change: Callable[[list[dict[str, object]]], object]) -> None:
    path = root / "v1.0-mini" / f"{table}.json"
    rows = json.loads(path.read_text())
    changed = change(rows)
    path.write_text(json.dumps(rows if changed is None else changed, indent=0))


def test_points_project_where_their_own_poses_put_them(root: Path) -> None:
    drive = open_drive(root, options(cameras=("all",)))
    assert {f.camera_name for f in drive.frames} == {"CAM_FRONT", "CAM_BACK"}
    points = drive.sweeps[0].read().positions
    for frame in drive.frames:
        assert frame.timestamp is not None
        time = round(frame.timestamp * 1e6)
        to_camera = np.linalg.inv(ego_pose(time) @ ego_from_sensor(frame.camera_name))
        local = points @ to_camera[:3, :3].T + to_camera[:3, 3]
        opencv = (local / local[:, 2:]) @ np.array(K).T
        pixels, depth = frame.camera.project(points)
        assert np.allclose(pixels, opencv[:, :2] + 0.5, atol=0.01)
        assert np.allclose(depth, local[:, 2], atol=1e-6)
        assert (frame.camera.width, frame.camera.height, frame.distortion) == (64, 36, None)


def test_sweeps_agree_in_the_global_frame_without_the_vehicles_own_points(root: Path) -> None:
    drive = open_drive(root, options())
    truth = global_points()
    assert [round(s.timestamp * 1e6) - START_US for s in drive.sweeps if s.timestamp] == [250_000 * i for i in range(5)]
    for sweep in drive.sweeps:
        found = sweep.read()
        # Of a labelled sweep the point of noise is gone, too.
        expected = np.delete(truth, 2, axis=0) if sweep.annotated else truth
        assert found.positions.dtype == np.float64
        assert np.allclose(found.positions, expected, atol=2e-5)


def test_points_carry_the_classes_that_category_json_numbers(root: Path) -> None:
    sweep = open_drive(root, options()).sweeps[0].read()
    assert sweep.classes is not None
    names = ["car", "building", None] + ["road"] * 36
    assert sweep.classes.tolist() == [train_id(n) for n in names]
    assert open_drive(root, options()).sweeps[1].read().classes is None


def test_without_labels_no_point_has_a_class(tmp_path: Path) -> None:
    drive = open_drive(make_nuscenes(tmp_path, lidarseg=False), options())
    assert all(s.read().classes is None for s in drive.sweeps)


def test_boxes_are_interpolated_in_time_and_cones_stay(root: Path) -> None:
    drive = open_drive(root, options(cameras=("all",)))
    for thing in (*drive.frames, *drive.sweeps):
        (box,) = thing.boxes
        assert thing.timestamp is not None
        time = min(round(thing.timestamp * 1e6), START_US + 1_000_000)
        assert np.allclose(box.centre, car_centre(time), atol=1e-5)
        assert (box.class_name, box.size, box.id) == ("car", (4.6, 1.9, 1.7), 1)
        assert box.yaw == pytest.approx(0.7)


def test_front_camera_and_key_frames_are_selected(root: Path) -> None:
    drive = open_drive(root, options())
    assert [f.camera_name for f in drive.frames] == ["CAM_FRONT"] * 5
    keys = open_drive(root, options(sweeps="key"))
    assert (len(keys.frames), len(keys.sweeps)) == (3, 3)
    assert all("samples" in f.image_path.parts for f in keys.frames)
    assert all("samples" in s.path.parts for s in keys.sweeps)


def test_a_scene_is_chosen_by_name_from_the_root_or_its_tables(root: Path) -> None:
    with pytest.raises(DriveError, match="scene-0061, scene-0103"):
        open_drive(root)
    with pytest.raises(SettingsError, match="scene-0061, scene-0103"):
        open_drive(root, DriveOptions(scene="scene-1"))
    other = open_drive(root / "v1.0-mini", DriveOptions(scene="scene-0103"))
    assert all("scene-0103" in f.name for f in other.frames)
    assert len(other.frames) == 5


def test_tables_and_labels_count_as_sources(root: Path) -> None:
    named = set(open_drive(root, options()).sources)
    assert {root / "v1.0-mini" / f"{t}.json" for t in tables.TABLES} <= named
    assert {p for p in (root / "lidarseg").rglob("*.bin") if SCENE in p.name} == {
        p for p in named if p.suffix == ".bin"
    }


def test_a_scene_of_two_versions_is_read_from_the_smaller(root: Path) -> None:
    make_nuscenes(root, version="v1.0-trainval", indent=4)
    assert [p.name for p in tables.table_folders(root)] == ["v1.0-mini", "v1.0-trainval"]
    assert open_drive(root, options()).sources[0].parent.name == "v1.0-mini"


def test_opening_reads_no_sweep_and_tables_once(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for path in root.rglob("*.pcd.bin"):
        path.write_bytes(b"no floats")
    open_drive(root, options())
    monkeypatch.setattr(tables, "json_rows", lambda *_: pytest.fail("read again"))
    assert len(open_drive(root, options()).frames) == 5


def test_changed_tables_are_read_again(root: Path) -> None:
    open_drive(root, options())
    edit(root, "sample_annotation", lambda rows: [])
    drive = open_drive(root, options())
    assert all(not f.boxes for f in drive.frames)
    assert any("no boxes" in n for n in drive.notices)


def test_missing_files_are_skipped_and_told(root: Path) -> None:
    next((root / "sweeps/CAM_FRONT").glob(f"{SCENE}*")).unlink()
    for path in (root / "sweeps/LIDAR_TOP").iterdir():
        path.unlink()
    drive = open_drive(root, options())
    assert (len(drive.frames), len(drive.sweeps)) == (4, 3)
    assert any("1 of 5 photographs of CAM_FRONT" in n for n in drive.notices)
    assert any("2 of 5 LiDAR sweeps" in n for n in drive.notices)


def test_without_photographs_there_is_one_error(root: Path) -> None:
    for path in root.rglob("*.jpg"):
        path.unlink()
    with pytest.raises(DriveError, match="no photographs of scene-0061"):
        open_drive(root, options())


@pytest.mark.parametrize("table", ["sample", "ego_pose", "calibrated_sensor", "sensor", "instance", "category"])
def test_a_missing_table_is_named(root: Path, table: str) -> None:
    (root / "v1.0-mini" / f"{table}.json").unlink()
    with pytest.raises(DriveError, match=f"{table}.json: Not found"):
        open_drive(root, options())


@pytest.mark.parametrize(
    "table", ["sample", "sample_data", "ego_pose", "sample_annotation", "calibrated_sensor", "scene"]
)
def test_a_table_that_is_cut_short_is_one_error(root: Path, table: str) -> None:
    path = root / "v1.0-mini" / f"{table}.json"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 3])
    with pytest.raises(DriveError):
        open_drive(root, options())


DAMAGE: dict[str, tuple[str, Callable[[list[dict[str, object]]], object]]] = {
    "pose missing": ("ego_pose", lambda rows: [r for r in rows if "CAM_FRONT" not in str(r["token"])]),
    "quaternion of three": ("ego_pose", lambda rows: [{**r, "rotation": [1, 0, 0]} for r in rows]),
    "no rotation": ("calibrated_sensor", lambda rows: [{**r, "rotation": None} for r in rows]),
    "no intrinsics": ("calibrated_sensor", lambda rows: [{**r, "camera_intrinsic": []} for r in rows]),
    "intrinsics of text": ("calibrated_sensor", lambda rows: [{**r, "camera_intrinsic": "K"} for r in rows]),
    "box of text": ("sample_annotation", lambda rows: [{**r, "size": "large"} for r in rows]),
    "time of text": ("sample", lambda rows: [{**r, "timestamp": "noon"} for r in rows]),
    "no file name": ("sample_data", lambda rows: [{k: v for k, v in r.items() if k != "filename"} for r in rows]),
    "no key": ("sensor", lambda rows: [{"token": r["token"]} for r in rows]),
    "rows of numbers": ("calibrated_sensor", lambda rows: [1, 2]),
    "no list": ("category", lambda rows: {"a": 1}),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_rows_are_one_error(root: Path, damage: str) -> None:
    edit(root, *DAMAGE[damage])
    with pytest.raises(DriveError):
        open_drive(root, options())


@pytest.mark.parametrize("table", ["scene", "sample_data"])
def test_tables_of_endless_lists_are_one_error(root: Path, table: str) -> None:
    (root / "v1.0-mini" / f"{table}.json").write_text(
        '[{"sample_token": "scene-0061-sample0", "x": ' + "[" * 100_000 + "}]"
    )
    with pytest.raises(DriveError, match=f"{table}.json"):
        open_drive(root, options())


def test_damaged_sweeps_and_labels_are_one_error_when_read(root: Path) -> None:
    first, second, *_ = open_drive(root, options()).sweeps
    second.path.write_bytes(second.path.read_bytes()[:-4])
    with pytest.raises(DriveError, match="Cut short"):
        second.read()
    for path in (root / "lidarseg/v1.0-mini").iterdir():
        path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(DriveError, match="labels 42 points, the sweep has 43"):
        first.read()
    first.path.unlink()
    with pytest.raises(DriveError, match="cannot be read"):
        first.read()
