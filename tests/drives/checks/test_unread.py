"""What is no drive, but known, is named with the way out."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from tests.drives.formats.street.all_formats import WRITERS
from tests.drives.formats.street.street import tiny_street
from unveil_core.base.errors import DriveError
from unveil_core.drives import open_drive
from unveil_core.drives.checks.unread import unread

PLACES: dict[str, tuple[tuple[str, ...], str]] = {
    "Waymo v1": (("training/segment-1.tfrecord",), r"Waymo Open version 1.*download version 2"),
    "Waymo v1, flat": (("segment-1.tfrecord",), r"Waymo Open version 1"),
    "Polycam": (
        ("keyframes/corrected_cameras/1.json", "keyframes/images/1.jpg"),
        r"Polycam's raw export.*ns-process-data polycam",
    ),
    "Record3D": (("room.r3d",), r"Record3D.*ns-process-data record3d"),
    "Metashape": (("street.psx", "street.files/0/doc.xml"), r"Metashape.*Export Cameras writes a cameras\.xml"),
    "RealityScan": (("street.rsproj",), r"RealityScan.*Internal/External camera parameters"),
    "Alembic": (("shot.abc", "notes.doc"), r"Blender reads \(import it there.*Use This Shot.*unveil shot FILE"),
    "OpenSfM": (("reconstruction.json", "images/1.jpg"), r"OpenSfM.*export_colmap"),
    "LLFF": (("poses_bounds.npy", "images/1.jpg"), r"poses of LLFF"),
    "a ROS bag": (("drive.mcap",), r"ROS bag"),
    "nuScenes without tables": (("samples/CAM_FRONT/1.jpg",), r"nuScenes without its tables.*v1\.0-trainval_meta\.tgz"),
    "PandaSet without LiDAR": (("camera/front_camera/intrinsics.json",), r"PandaSet without lidar/poses\.json"),
    "KITTI raw without poses": (("image_02/data/1.png",), r"KITTI raw without oxts/data"),
    "KITTI odometry without calibration": (
        ("image_2/000000.png",),
        r"KITTI odometry without calib\.txt.*data_odometry_calib\.zip",
    ),
    "DriveStudio without poses": (
        ("images/000_0.jpg", "intrinsics/0.txt", "extrinsics/0.txt"),
        r"DriveStudio without ego_pose/.*--process_keys",
    ),
    "COLMAP before its mapper": (("database.db", "images/1.jpg"), r"COLMAP without a model.*run its mapper"),
    "archives": (("a.zip", "b.tar.gz"), r"archives alone \(unpack them"),
    "a video": (("drive.MP4",), r"Not a drive: a clip .*unveil solve CLIP"),
    "pictures": (("1.JPG", "2.JPG"), r"pictures alone, without poses .*unveil solve"),
    "a folder of pictures": (("images/1.jpg",), r"pictures alone"),
}


@pytest.mark.parametrize("kind", PLACES)
def test_it_is_one_line_that_says_what_it_is_and_what_to_do(kind: str, tmp_path: Path) -> None:
    files, line = PLACES[kind]
    for name in files:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(DriveError, match=line):
        open_drive(tmp_path)


def test_a_file_is_known_as_well(tmp_path: Path) -> None:
    (tmp_path / "segment.tfrecord").write_bytes(b"")
    (tmp_path / "notes.txt").write_bytes(b"")
    with pytest.raises(DriveError, match="Waymo Open version 1"):
        open_drive(tmp_path / "segment.tfrecord")
    assert unread(tmp_path / "notes.txt") is None


def test_what_nobody_knows_is_answered_as_before(tmp_path: Path) -> None:
    (tmp_path / "something").mkdir()
    with pytest.raises(DriveError, match="Not a drive.*looked for: transforms.json"):
        open_drive(tmp_path)


MISSING = {
    "nuScenes": ("*/LIDAR_TOP", r"LiDAR sweeps are missing.*v1\.0-trainvalNN_blobs\.tgz"),
    "DriveStudio": ("*/lidar", r"the scene has no LiDAR sweeps: lidar/ is missing.*--process_keys"),
    "Argoverse 2": ("**/sensors/lidar", r"no LiDAR: sensors/lidar has no sweeps"),
}


@pytest.mark.parametrize("name", MISSING)
def test_points_that_are_missing_are_named_by_their_archive(name: str, tmp_path: Path) -> None:
    place, line = MISSING[name]
    path = WRITERS[name](tmp_path / "d", tiny_street())
    found = [p for p in tmp_path.glob(f"**/{place.removeprefix('**/').removeprefix('*/')}") if p.is_dir()]
    assert found
    for folder in found:
        shutil.rmtree(folder)
    # Not refused: points can be found in the photographs. But it is told which archive has better ones.
    assert any(re.search(line, told) for told in open_drive(path).notices)
